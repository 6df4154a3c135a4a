"""Tables and point clouds on disk, and the folder in which they appear all at once."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np

from model.errors import UserError
from scripts.results.points import STATUS

__all__ = ["CSV_HEADER", "TIMED_CSV_HEADER", "check_folder", "csv_line", "new_folder",
           "take_folder", "whole_file", "write_csv"]

CSV_HEADER = "frame,beam,u_px,v_px,area_px,x_mm,y_mm,z_mm,status,saturated,border"
#: Where frames have a time.
TIMED_CSV_HEADER = f"{CSV_HEADER},time_us"


def check_folder(path):
    """Refuse a folder that :func:`new_folder` could not create, before any work is done."""
    path = Path(path)
    if path.is_dir():
        if any(path.iterdir()):
            raise UserError(f"{path} already holds files: name a new or an empty folder.")
        if not os.access(path, os.W_OK | os.X_OK):
            raise UserError(f"{path} is not writable.")
        return
    if path.is_symlink():
        raise UserError(f"{path} is a link to nowhere: name a new or an empty folder.")
    if path.exists():
        raise UserError(f"{path} is not a folder: name a new or an empty one.")
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir():
        raise UserError(f"{path} cannot be created, because {parent} is not a folder.")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise UserError(f"{path} cannot be created: {parent} is not writable.")


def _part_of(path, final):
    """A new hidden folder beside ``final``, or inside it where only that can be written."""
    home = final.parent
    if final.is_dir() and (os.path.ismount(final) or not os.access(home, os.W_OK | os.X_OK)):
        home = final
    try:
        home.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{final.name}.", suffix=".part", dir=home))
        mask = os.umask(0)
        os.umask(mask)
        part.chmod(0o777 & ~mask)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from error
    return part


def _publish(part, final):
    """Give ``part`` the name ``final``, or move what it holds there; whether that was possible."""
    try:
        if part.parent == final:
            if any(each != part for each in final.iterdir()):
                return False
            for each in part.iterdir():
                each.rename(final / each.name)
        else:
            os.replace(part, final)
    except OSError:
        return False
    return True


def take_folder(path):
    """Create ``path``, or take it if it is an empty folder.

    For results that have to be under their name from the start.

    Returns
    -------
    (:class:`~pathlib.Path`, :class:`bool`)
        The folder, and whether it was created.
    """
    check_folder(path)
    path = Path(path)
    created = not path.exists()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{path} cannot be created: {error.strerror or error}.") from error
    return path, created


@contextmanager
def new_folder(path):
    """A folder to write into that becomes ``path`` when all went well.

    Until then it has a hidden name beside ``path``; after an error, or an interrupt, nothing is
    left of it. If something else fills ``path`` meanwhile, the results get the first free name
    like ``path-2`` beside it, and a :class:`UserError` says so.
    """
    check_folder(path)
    final = Path(os.path.realpath(path))
    part = _part_of(path, final)
    try:
        yield part
        if not _publish(part, final):
            home = part.parent
            spare = next(spare for number in count(2)
                         if not (spare := home / f"{final.name}-{number}").exists())
            part.rename(spare)
            raise UserError(f"{path} was filled by something else meanwhile: the results are in "
                            f"{spare}.")
    except KeyboardInterrupt as interrupt:
        interrupt.add_note("Nothing was written.")
        raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def whole_file(path):
    """A new file, open for octets, that appears as ``path`` when all of it is written.

    Raises
    ------
    UserError
        If there is something of that name, or it cannot be written.
    """
    path = Path(path)
    part = path.with_name(f"{path.name}.part")
    try:
        try:
            with open(part, "wb") as file:
                yield file
            if path.exists():
                raise UserError(f"{path} is there already, from something else: move it away.")
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from error


def _number(value, digits):
    return "" if np.isnan(value) else f"{value:.{digits}f}"


def csv_line(point, names=STATUS, time_us=None):
    """The row of a spot; fields without a value are empty.

    Parameters
    ----------
    point : element of an array of :data:`scripts.results.points.POINT`
        The spot.
    names : sequence of :class:`str`
        Words for its status.
    time_us : :class:`str`, optional
        For the column of :data:`TIMED_CSV_HEADER`; without it the row has no such column.
    """
    beam = "" if point["beam"] < 0 else str(point["beam"])
    coordinates = ",".join(_number(point[name], 4) for name in "xyz")
    return (f"{point['frame']},{beam},{point['u']:.4f},{point['v']:.4f},{point['area']},"
            f"{coordinates},{names[point['status']]},{int(point['saturated'])},"
            f"{int(point['border'])}{'' if time_us is None else f',{time_us}'}\n")


def write_csv(path, points):
    """``points.csv``: a row per spot, in the order found."""
    with open(path, "w", newline="\n") as file:
        file.write(CSV_HEADER + "\n")
        for point in points:
            file.write(csv_line(point))
