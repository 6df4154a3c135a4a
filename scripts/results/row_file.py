"""A table on disk that grows by whole rows."""

import os
from pathlib import Path

from model.errors import UserError

__all__ = ["RowFile"]


class RowFile:
    """A new text file; what was flushed outlives the program, however that ends.

    Each flush is one write of whole rows. If the disk takes only a part of them, the file is cut
    back to the last whole row.

    Parameters
    ----------
    path : path
        The file to create.
    header : :class:`str`
        Its first row.

    Raises
    ------
    UserError
        If it is there already, or cannot be written; :meth:`flush` raises it too.
    """

    def __init__(self, path, header):
        self.path, self._size, self._rows = Path(path), 0, [header]
        try:
            self._handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL,
                                   0o666)
        except OSError as error:
            raise self._error(error) from error
        self.flush()

    def append(self, row):
        """Add a row, its line end included; :meth:`flush` writes it."""
        self._rows.append(row)

    def flush(self):
        """Write all rows that were added."""
        if not self._rows:
            return
        octets, self._rows = "".join(self._rows).encode(), []
        written = 0
        try:
            while written < len(octets):
                written += os.write(self._handle, octets[written:])
        except OSError as error:
            self._size += octets.rfind(b"\n", 0, written) + 1
            os.ftruncate(self._handle, self._size)
            raise self._error(error) from error
        self._size += written

    def sync(self):
        """Have the system put on the disk what was written."""
        os.fdatasync(self._handle)

    def close(self):
        """Flush, and end it."""
        if self._handle is not None:
            try:
                self.flush()
            finally:
                handle, self._handle = self._handle, None
                os.close(handle)

    def _error(self, error):
        return UserError(f"{self.path} cannot be written: {error.strerror or error}.")
