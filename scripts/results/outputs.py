"""Tables and point clouds on disk, and the folder that they appear in all at once."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from model.errors import UserError
from scripts.results.points import STATUS

__all__ = ["CSV_HEADER", "check_folder", "csv_line", "new_folder", "ply_header", "ply_line",
           "write_csv", "write_ply"]

CSV_HEADER = "frame,beam,u_px,v_px,area_px,x_mm,y_mm,z_mm,status"


def check_folder(path):
    """Refuse a folder that :func:`new_folder` could not create, before any work is done."""
    path = Path(path)
    if path.is_dir():
        if any(path.iterdir()):
            raise UserError(f"{path} already holds files: name a new or an empty folder.")
        if os.path.ismount(path):
            raise UserError(f"{path} is a mount point: name a new folder inside it.")
    elif path.exists() or path.is_symlink():
        raise UserError(f"{path} is not a folder: name a new or an empty one.")
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir():
        raise UserError(f"{path} cannot be created, because {parent} is not a folder.")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise UserError(f"{path} cannot be created: {parent} is not writable.")


@contextmanager
def new_folder(path):
    """A folder to write into that becomes ``path`` when all went well.

    Until then it stands beside ``path`` under a hidden name; after an error, or an interrupt,
    nothing is left of it.
    """
    check_folder(path)
    final = Path(path).absolute()
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{final.name}.", suffix=".part", dir=final.parent))
        mask = os.umask(0)
        os.umask(mask)
        part.chmod(0o777 & ~mask)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from error
    try:
        yield part
        try:
            os.replace(part, final)
        except OSError as error:
            raise UserError(
                f"{path} was filled by something else meanwhile: name a new folder.") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _number(value, digits):
    return "" if np.isnan(value) else f"{value:.{digits}f}"


def csv_line(point, names=STATUS):
    """The row of a spot; fields without a value are empty."""
    beam = "" if point["beam"] < 0 else str(point["beam"])
    place = ",".join(_number(point[name], 4) for name in "xyz")
    return (f"{point['frame']},{beam},{point['u']:.4f},{point['v']:.4f},{point['area']},"
            f"{place},{names[point['status']]}\n")


def write_csv(path, points):
    """``points.csv``: a row per spot, in the order found."""
    with open(path, "w", newline="\n") as file:
        file.write(CSV_HEADER + "\n")
        for point in points:
            file.write(csv_line(point))


def ply_header(count, source):
    """Everything before the first point.

    Parameters
    ----------
    count : :class:`int`
        Points that follow.
    source : :class:`str`
        What was measured, for a comment.
    """
    printable = source.encode("ascii", "replace").decode().replace("\n", " ")
    return "\n".join([
        "ply", "format ascii 1.0",
        f"comment cyclope, points measured in {printable}",
        "comment unit mm; x right, y down, z along the optical axis, camera at the origin",
        "comment beam = row * columns + column of the laser mesh; status "
        + " ".join(f"{code} {name}" for code, name in enumerate(STATUS)),
        "comment intensity is the grey value of the image at the spot",
        f"element vertex {count}",
        "property float x", "property float y", "property float z",
        "property ushort beam", "property int frame", "property uchar status",
        "property uchar intensity", "end_header", ""])


def ply_line(point):
    """A point that has a place."""
    return (f"{point['x']:.4f} {point['y']:.4f} {point['z']:.4f} {point['beam']} "
            f"{point['frame']} {point['status']} {point['intensity']}\n")


def write_ply(path, points, source):
    """``points.ply``: the points that have a place, as text.

    Parameters
    ----------
    path : path
        File to write.
    points : array of :data:`scripts.results.points.POINT`
        Spots; those without coordinates are left out.
    source : :class:`str`
        What was measured, for a comment.
    """
    placed = points[~np.isnan(points["z"])]
    frames = np.unique(placed["frame"])
    span = f"{len(frames)} frames, {frames[0]} to {frames[-1]}" if len(frames) else "no frame"
    with open(path, "w", newline="\n") as file:
        file.write(ply_header(len(placed), f"{source} ({span})"))
        for point in placed:
            file.write(ply_line(point))
