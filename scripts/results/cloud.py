"""Points as other programs read them, PLY and PCD: of a frame, or of a whole recording."""

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from scripts.results.mesh import triangles, vertex_normals
from scripts.results.outputs import whole_file
from scripts.results.points import OK, STATUS

__all__ = ["UNKNOWN", "VERTEX", "CloudFiles", "colours_at", "pcd_head", "pcd_lines", "ply_head",
           "ply_lines", "surface_triangles", "vertices", "write_ply"]

#: Grey of points whose pixel never came.
UNKNOWN = 128
_COLOURS = ("red", "green", "blue")
#: A point in a file: mm, unit normal, colour, and seconds since the first frame.
VERTEX = np.dtype([
    *((name, np.float64) for name in ("x", "y", "z", "nx", "ny", "nz")),
    *((name, np.uint8) for name in _COLOURS),
    ("beam", np.uint16), ("frame", np.int64), ("status", np.uint8), ("time", np.float64)])
#: Types in the files, and how many of VERTEX's fields are millimetres or normals.
_PLY_TYPES = ("float",) * 6 + ("uchar",) * 3 + ("ushort", "int", "uchar", "double")
_PCD_FIELDS = {
    **dict.fromkeys(("x", "y", "z", "normal_x", "normal_y", "normal_z"), ("4", "F")),
    "rgb": ("4", "U"), "beam": ("2", "U"), "frame": ("4", "I"), "status": ("1", "U"),
    "time": ("8", "F")}
_NUMBERS = ("%.4f",) * 6 + ("%d",) * 6 + ("%.6f",)
_PCD_LINE = " ".join(("%.4f",) * 6 + ("%d",) * 4 + ("%.6f",)) + "\n"
_COMMENTS = (
    "unit mm; x right, y down, z along the optical axis, camera at the origin",
    "normals towards the camera; 0 0 0 where a point has no neighbour on the surface",
    "beam = row * columns + column of the laser mesh; status "
    + " ".join(f"{code} {name}" for code, name in enumerate(STATUS)))
_COLOUR_COMMENT = f"colours of the image without laser at the spot, {UNKNOWN} where none came yet"
_ROWS = 1 << 12


def colours_at(points, picture, came):
    """Red, green and blue of a picture at each spot, :data:`UNKNOWN` where nothing ``came`` yet.

    An array (n, 3) of uint8; ``picture`` is grey or has three colours.
    """
    height, width = came.shape
    if not picture.size:
        return np.full((len(points), 3), UNKNOWN, np.uint8)
    row = np.clip(np.rint(points["v"]).astype(int), 0, height - 1)
    column = np.clip(np.rint(points["u"]).astype(int), 0, width - 1)
    colours = picture.reshape(height, width, -1)[row, column]
    colours = np.where(came[row, column][:, None], colours, UNKNOWN)
    return np.broadcast_to(colours, (len(points), 3)).astype(np.uint8)


def surface_triangles(points, columns):
    """Triangles between the ok points of a frame, see :func:`scripts.results.mesh.triangles`."""
    ok = np.flatnonzero((points["status"] == OK) & np.isfinite(points["z"]))
    if not len(ok):
        return np.zeros((0, 3), int)
    inverse = 1 / points["z"][ok]
    ray = np.stack([points["x"][ok] * inverse, points["y"][ok] * inverse], axis=-1)
    return ok[triangles(points["beam"][ok], ray, inverse, columns)]


def vertices(points, triangle, colours, seconds=0.0):
    """Rows for a file.

    Parameters
    ----------
    points : array (n,) of :data:`scripts.results.points.POINT`
        Of one frame, all with coordinates.
    triangle : array (m, 3) of :class:`int`
        The surface between them, which gives the normals.
    colours : array (n, 3) of uint8
        Their red, green and blue.
    seconds : :class:`float`
        The frame's time.

    Returns
    -------
    array (n,) of :data:`VERTEX`
    """
    rows = np.zeros(len(points), VERTEX)
    for name in ("x", "y", "z", "beam", "frame", "status"):
        rows[name] = points[name]
    xyz = np.stack([points[name] for name in "xyz"], axis=-1)
    normals = vertex_normals(xyz, triangle) + 0.0
    for axis, name in enumerate(("nx", "ny", "nz")):
        rows[name] = normals[:, axis]
    _paint(rows, colours)
    rows["time"] = seconds
    return rows


def _paint(rows, colours):
    for index, name in enumerate(_COLOURS):
        rows[name] = colours[:, index]


def ply_head(count, source, faces=None, names=VERTEX.names, colours=_COLOUR_COMMENT):
    """Everything before the first point of a PLY, as text.

    Parameters
    ----------
    count, faces : :class:`int`
        Points and triangles that follow; ``faces`` is None where there is no surface.
    source : :class:`str`
        What was measured, for a comment.
    names : sequence of :class:`str`
        Fields of :data:`VERTEX` from the first on.
    colours : :class:`str`
        What the colours are, for a comment.
    """
    printable = source.encode("ascii", "replace").decode().replace("\n", " ")
    surface = [] if faces is None else [
        f"element face {faces}", "property list uchar int vertex_indices"]
    return "\n".join([
        "ply", "format ascii 1.0", f"comment cyclope, points measured in {printable}",
        *(f"comment {each}" for each in (*_COMMENTS, colours)), f"element vertex {count}",
        *(f"property {kind} {name}" for kind, name in zip(_PLY_TYPES, names, strict=False)),
        *surface, "end_header", ""])


def ply_lines(rows):
    """Rows of :data:`VERTEX`, or of its first fields, as lines of a PLY."""
    line = " ".join(_NUMBERS[:len(rows.dtype.names)]) + "\n"
    return "".join([line % row for row in rows.tolist()])


def pcd_head(count, source):
    """Everything before the first point of a PCD; the same fields as a PLY has."""
    printable = source.encode("ascii", "replace").decode().replace("\n", " ")
    sizes, types = zip(*_PCD_FIELDS.values(), strict=True)
    return "\n".join([
        f"# cyclope, points measured in {printable}",
        *(f"# {each}" for each in (*_COMMENTS, _COLOUR_COMMENT)), "VERSION 0.7",
        f"FIELDS {' '.join(_PCD_FIELDS)}", f"SIZE {' '.join(sizes)}", f"TYPE {' '.join(types)}",
        f"COUNT {' '.join('1' * len(_PCD_FIELDS))}", f"WIDTH {count}", "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {count}", "DATA ascii", ""])


def pcd_lines(rows):
    """Rows of :data:`VERTEX` as lines of a PCD."""
    return "".join([_PCD_LINE % (*row[:6], row[6] << 16 | row[7] << 8 | row[8], *row[9:])
                    for row in rows.tolist()])


def write_ply(path, points, columns, source):
    """``points.ply`` of frames without a time: the points that have coordinates.

    Parameters
    ----------
    path : path
        File to write.
    points : array of :data:`scripts.results.points.POINT`
        Spots of frame after frame; those without coordinates are left out.
    columns : :class:`int`
        Of the mesh.
    source : :class:`str`
        What was measured, for a comment.
    """
    located = points[~np.isnan(points["z"])]
    frames = np.unique(located["frame"])
    span = f"{len(frames)} frames, {frames[0]} to {frames[-1]}" if len(frames) else "no frame"
    names = list(VERTEX.names[:-1])
    ends = [0, *(np.flatnonzero(np.diff(located["frame"])) + 1), len(located)]
    with open(path, "w", newline="\n") as file:
        file.write(ply_head(len(located), f"{source} ({span})", names=names,
                            colours="colours are the grey value of the image at the spot"))
        for begin, end in pairwise(ends):
            some = located[begin:end]
            file.write(ply_lines(vertices(
                some, surface_triangles(some, columns),
                np.repeat(some["intensity"][:, None], 3, axis=1))[names]))


class CloudFiles:
    """Points of frames as they come, with the colours that the picture has then.

    The last frame gets the picture as it is at the end: what the page shows of it.

    Parameters
    ----------
    folder : path
        Where to write. A file without a name is there meanwhile, of which nothing is left.
    which : :class:`str`
        ``all``: ``points.ply`` has all frames; ``last``: the last one that has points; ``each``:
        ``points/NNNN.ply`` for each frame that has, as they come.
    pcd : :class:`bool`
        The same as PCD too.

    Attributes
    ----------
    written : set of :class:`~pathlib.Path`
        Files and folders that were created.
    """

    def __init__(self, folder, which="all", pcd=False):
        self._folder, self._which = Path(folder), which
        self._kinds = ("ply", "pcd") if pcd else ("ply",)
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._newest = None
        self.written = set()

    def add(self, points, columns, seconds, picture, came):
        """Add a frame.

        Parameters
        ----------
        points : array of :data:`scripts.results.points.POINT`
            Those of it that have coordinates.
        columns : :class:`int`
            Of the mesh.
        seconds : :class:`float`
            The frame's time.
        picture, came : arrays
            The picture, (height, width) or with three colours, and where there is one.
        """
        self._settle()
        self._newest = points, vertices(points, surface_triangles(points, columns),
                                        colours_at(points, picture, came), seconds)

    def finish(self, picture, came):
        """Write what is to be written at the end, with the picture as it is now."""
        if self._newest is not None:
            points, rows = self._newest
            _paint(rows, colours_at(points, picture, came))
        self._settle()
        self._newest = None
        if self._which != "each":
            count = self._file.tell() // VERTEX.itemsize
            for kind in self._kinds:
                self._file.seek(0)
                blocks = iter(lambda: self._file.read(_ROWS * VERTEX.itemsize), b"")
                self._write(self._folder / f"points.{kind}", kind, count, "frames from the link",
                            (np.frombuffer(block, VERTEX) for block in blocks))

    def close(self):
        """Forget the points."""
        self._file.close()

    def _settle(self):
        """The newest frame's picture is not going to change any more."""
        if self._newest is None or not len(self._newest[1]):
            return
        rows = self._newest[1]
        if self._which == "each":
            home, index = self._folder / "points", rows["frame"][0]
            if home not in self.written:
                home.mkdir()
                self.written.add(home)
            for kind in self._kinds:
                self._write(home / f"{index:04}.{kind}", kind, len(rows), f"frame {index}", [rows])
            return
        if self._which == "last":
            self._file.seek(0)
            self._file.truncate()
        self._file.write(rows.tobytes())

    def _write(self, path, kind, count, source, blocks):
        head, lines = {"ply": (ply_head, ply_lines), "pcd": (pcd_head, pcd_lines)}[kind]
        with whole_file(path) as file:
            file.write(head(count, source).encode())
            for rows in blocks:
                file.write(lines(rows).encode())
        self.written.add(path)
