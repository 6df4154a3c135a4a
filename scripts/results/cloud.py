"""A point cloud that grows, and is written as a whole at the end."""

import tempfile

import numpy as np

from scripts.results.outputs import ply_header, ply_line, whole_file
from scripts.results.points import POINT

__all__ = ["PointCloud"]


class PointCloud:
    """Points with coordinates, kept in a file without a name, of which nothing is left.

    Parameters
    ----------
    folder : path
        Where there is room for that file.
    size : tuple of two :class:`int`
        Width and height of the sensor.
    """

    def __init__(self, folder, size):
        width, height = size
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._count = 0
        self._under = np.zeros((height, width), bool)  # pixels under the points

    def clear(self):
        """Forget all points."""
        self._file.seek(0)
        self._file.truncate()
        self._count = 0
        self._under[:] = False

    def add(self, points):
        """Add points, an array of :data:`scripts.results.points.POINT`."""
        if len(points):
            self._file.write(points.tobytes())
            self._count += len(points)
            self._under[self._pixels(points)] = True

    def write(self, path, texture):
        """Write ``points.ply``.

        Intensities are those of the texture; they are left out if that lacks the pixel of any
        point.

        Parameters
        ----------
        path : path
            File to create.
        texture : :class:`scripts.host.image_assembly.ImageAssembly`
            What came of the texture; of the sensor's size if there are points.
        """
        intensity = self._count > 0 and not (self._under & ~texture.came).any()
        self._file.seek(0)
        with whole_file(path) as file:
            file.write(ply_header(self._count, "frames from the link", intensity).encode())
            while octets := self._file.read(POINT.itemsize << 12):
                points = np.frombuffer(octets, POINT).copy()
                if intensity:
                    points["intensity"] = texture.image[self._pixels(points)]
                file.write("".join(ply_line(point, intensity) for point in points).encode())

    def close(self):
        """Forget the file."""
        self._file.close()

    def _pixels(self, points):
        height, width = self._under.shape
        return (np.clip(np.rint(points["v"]).astype(int), 0, height - 1),
                np.clip(np.rint(points["u"]).astype(int), 0, width - 1))
