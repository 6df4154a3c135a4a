"""An image put together from the fragments that the link carries."""

import numpy as np

from hdl.protocol import SENSOR_PIXELS

__all__ = ["ImageAssembly"]


class ImageAssembly:
    """The image that fragments add up to.

    Parameters
    ----------
    size : tuple of two :class:`int` or None
        Width and height; None if they are not known yet: the image is then as large as what
        came, and never complete.

    Attributes
    ----------
    image : 2-D ``uint8`` array
        The last state; black where nothing came yet.
    came : 2-D :class:`bool` array
        Where something came.
    outside : :class:`int`
        Fragments that do not lie on the sensor.
    """

    def __init__(self, size=None):
        self.size, self.outside = size, 0
        width, height = size or (0, 0)
        self.image = np.zeros((height, width), np.uint8)
        self.came = np.zeros((height, width), bool)
        self._fresh = np.zeros((height, width), bool)

    @property
    def part(self):
        """Part of the image that ever came, 0 to 1."""
        return float(self.came.mean()) if self.came.size else 0.0

    @property
    def fresh(self):
        """Part of the image that came since it was complete for the last time, 0 to 1."""
        return float(self._fresh.mean()) if self._fresh.size else 0.0

    def resize(self, size):
        """Take the size, which was not known."""
        width, height = size
        rows, columns = min(height, len(self.image)), min(width, self.image.shape[1])
        for name in ("image", "came", "_fresh"):
            old = getattr(self, name)
            new = np.zeros((height, width), old.dtype)
            new[:rows, :columns] = old[:rows, :columns]
            setattr(self, name, new)
        self.size = size

    def add(self, fragment):
        """Add a fragment; whether the whole image has been refreshed with it."""
        end = fragment.column + len(fragment.pixels)
        width, height = self.size or (SENSOR_PIXELS[1], SENSOR_PIXELS[1])
        if fragment.row >= height or end > width:
            self.outside += 1
            return False
        if self.size is None and (
                fragment.row >= len(self.image) or end > self.image.shape[1]):
            self.resize((max(end, self.image.shape[1]), max(fragment.row + 1, len(self.image))))
            self.size = None
        self.image[fragment.row, fragment.column:end] = fragment.pixels
        for known in (self._fresh, self.came):
            known[fragment.row, fragment.column:end] = True
        if self.size is None or not self._fresh.all():
            return False
        self._fresh[:] = False
        return True
