"""Records that are written one after the other, and read again at will, on the disk."""

import os
import tempfile
import weakref
from array import array

from model.errors import UserError

__all__ = ["Spool"]


class Spool:
    """Records in a file without a name, of which nothing is left in the end.

    In memory each takes eight octets.

    Parameters
    ----------
    folder : path or None
        Where the file is; None for the system's temporary folder.
    """

    def __init__(self, folder=None):
        self._folder = folder
        try:
            file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise self._failed(error) from error
        self._number = file.fileno()
        self._ends = array("q", [0])
        weakref.finalize(self, file.close)

    def __len__(self):
        return len(self._ends) - 1

    def add(self, octets):
        """Append a record.

        Raises
        ------
        UserError
            If it cannot be written; it is not there then.
        """
        at = self._ends[-1]
        try:
            while octets:
                done = os.pwrite(self._number, octets, at)
                octets, at = octets[done:], at + done
        except OSError as error:
            raise self._failed(error) from error
        self._ends.append(at)

    def read(self, first, count=1):
        """The octets of so many records."""
        begin, end = self._ends[first], self._ends[first + count]
        parts = []
        while begin < end:
            part = os.pread(self._number, end - begin, begin)
            if not part:
                raise UserError("The end of a temporary file is missing.")
            parts.append(part)
            begin += len(part)
        return b"".join(parts)

    def clear(self):
        """Forget all records, and give their room back."""
        os.ftruncate(self._number, 0)
        self._ends = array("q", [0])

    def _failed(self, error):
        where = self._folder or tempfile.gettempdir()
        return UserError(f"{where} takes no temporary file: {error.strerror or error}.")
