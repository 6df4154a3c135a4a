"""Files that others wrote, read in bounded time and memory; files written whole or not at all."""

import os
import stat
import tempfile
from contextlib import contextmanager
from pathlib import Path

from model.errors import UserError

__all__ = ["beside", "check_output", "list_names", "read_octets", "unused_files"]

#: How many names are listed.
_NAMED = 5


def _octets(path, most):
    """Contents of a regular file up to ``most`` octets and one more, or why not, in words."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        return None, "is not a file"
    # It may have become something else by now, so nothing is waited for.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            return None, "is not a file"
        if status.st_size > most:
            return None, f"has {status.st_size} octets, more than the {most} that are read"
        data = file.read(most + 1)
    if data is None or len(data) > most:  # the kernel's own files do not tell their size
        return None, "never ends, or keeps its reader waiting"
    return data, None


def read_octets(path, advice, most, name=None):
    """All octets of a file.

    Only regular files are read, and only up to a limit: nothing that blocks or never ends.

    Parameters
    ----------
    path : path
        What to read.
    advice : :class:`str`
        What to do when that fails, as the end of a sentence.
    most : :class:`int`
        Octets that such a file may have.
    name : :class:`str` or None
        What to call it in messages; the path if None.

    Raises
    ------
    UserError
        If it is missing, unreadable, larger, or no regular file.
    """
    try:
        data, fault = _octets(path, most)
    except FileNotFoundError:
        fault = "does not exist"
    except NotADirectoryError:
        fault = "is not a file"
    except OSError as error:
        fault = f"cannot be read ({error.strerror})"
    if fault:
        raise UserError(f"{name or path} {fault}: {advice}.")
    return data


def list_names(names, most=_NAMED):
    """The first of some names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def unused_files(folder, used):
    """Notes on the files of a folder that are not ``used``, by name; hidden ones do not count."""
    names = sorted(entry.name for entry in folder.iterdir()
                   if entry.name not in used and not entry.name.startswith("."))
    return [f"not used in {folder}: {list_names(names)}"] if names else []


def check_output(path):
    """Refuse a file that :func:`beside` could not write, before any work is done."""
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise UserError(f"{path} is not a file: name another one to write.")
    except FileNotFoundError:
        folder = Path(os.path.realpath(path)).parent
        if not folder.is_dir():
            raise UserError(f"{path} cannot be written: the folder {folder} does not exist."
                            ) from None
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror}.") from error


@contextmanager
def beside(path):
    """A binary file to write that becomes ``path`` when all went well, and nothing if not.

    Where ``path`` is a link, what it leads to is replaced; devices are refused.
    """
    final = Path(os.path.realpath(path))
    try:
        check_output(path)
        handle, part = tempfile.mkstemp(dir=final.parent, prefix=f".{final.name}."[:80])
        try:
            with os.fdopen(handle, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(part, 0o666 & ~mask)
            os.replace(part, final)
        except BaseException:
            os.unlink(part)
            raise
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror}.") from error
