"""The recording of the line, safe while it grows."""

import errno
import os
import threading
from pathlib import Path

from model.errors import UserError

__all__ = ["LinkFile"]

#: Seconds from one time that the disk is asked to hold all that was written to the next.
_SYNC_SECONDS = 0.5
#: What a file system answers that cannot do that.
_NOT_SUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)


class LinkFile:
    """A new file that holds octets as soon as they are written: nothing is buffered here.

    Parameters
    ----------
    path : path
        The file to create.
    sync : :class:`bool`
        Have the system put on the disk, twice a second, what was written: it then outlives a loss
        of power too.

    Attributes
    ----------
    size : :class:`int`
        Octets that it holds.

    Raises
    ------
    UserError
        If it is there already, or cannot be written; :meth:`write` raises it too.
    """

    def __init__(self, path, sync=False):
        self.path, self.size = Path(path), 0
        try:
            self._handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o666)
        except OSError as error:
            raise self._error(error) from error
        self._failed, self._ended, self._thread = None, threading.Event(), None
        if sync:
            self._thread = threading.Thread(target=self._sync, daemon=True)
            self._thread.start()

    def write(self, octets):
        """Append octets; as many as the disk takes are kept if it does not take all."""
        if self._failed:
            raise self._error(self._failed)
        try:
            while octets:
                written = os.write(self._handle, octets)
                self.size += written
                octets = octets[written:]
        except OSError as error:
            raise self._error(error) from error

    def truncate(self, size):
        """Cut what is behind the first ``size`` octets."""
        os.ftruncate(self._handle, size)
        self.size = size

    def close(self):
        """End it."""
        if self._handle is not None:
            self._ended.set()
            if self._thread is not None:
                self._thread.join()
            handle, self._handle = self._handle, None
            os.close(handle)

    def _sync(self):
        synced, last = 0, False
        while not last:
            last = self._ended.wait(_SYNC_SECONDS)
            if self.size != synced:
                synced = self.size
                try:
                    os.fdatasync(self._handle)
                except OSError as error:
                    if error.errno not in _NOT_SUPPORTED:
                        self._failed = error
                    return

    def _error(self, error):
        return UserError(f"{self.path} cannot be written: {error.strerror or error}.")
