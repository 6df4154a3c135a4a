"""A recording of the line, read as a port is."""

import os
import select

from model.errors import UserError

__all__ = ["Replay"]

_CHUNK = 1 << 16
#: Seconds to wait for a file that gives nothing; those on a disk never make one wait.
_PATIENCE = 5.0


class Replay:
    """A file to read from; a context manager.

    Parameters
    ----------
    path : path
        A regular file.

    Attributes
    ----------
    size, done : :class:`int`
        Octets that the file has, and those that were read.
    """

    live = False

    def __init__(self, path):
        self._path, self.done = path, 0
        self._file = open(path, "rb", buffering=0)  # noqa: SIM115
        self.size = os.fstat(self._file.fileno()).st_size

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def read(self):
        """The next octets, None at the end.

        Raises
        ------
        UserError
            If it cannot be read.
        """
        try:
            if not select.select([self._file], [], [], _PATIENCE)[0]:
                return None
            octets = self._file.read(_CHUNK)
        except OSError as error:
            raise UserError(f"{self._path} cannot be read: {error.strerror or error}.") from error
        self.done += len(octets)
        return octets or None
