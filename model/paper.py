"""The golden model of the preset ``paper``: frames in, points and counts out, bit for bit."""

import numpy as np

from model.capsule import checked
from model.link.point_limiter import limit_points
from model.link.points import PatternFrame
from model.preprocessing.front_chain import find_corrected_spots, measure_level
from model.preprocessing.spot_queue import COUNT_LIMIT
from model.reconstruction import reconstruct

__all__ = ["LABELS", "Paper"]

#: Provisional labels of a frame in the preset.
LABELS = 1023


class Paper:
    """Frames in their order, each to what the chip would send of it.

    The only state between frames is the frame's number: the threshold is measured on the frame
    itself. Queues never overflow: if the chip's buffer is full and it drops spots, its points are a
    part of these.

    Parameters
    ----------
    settings : :class:`model.settings.Settings`
        Registers and tables.
    width, height : :class:`int`
        Sensor size in pixels.
    labels : :class:`int`
        Provisional labels of a frame.
    points_max : :class:`int`
        Ok points of a frame that are sent; 0 is no limit.
    """

    def __init__(self, settings, width, height, labels=LABELS, points_max=0):
        self.settings, self.width, self.height = settings, width, height
        self.labels, self.points_max = labels, points_max
        self.number = self._ok = 0

    def frame(self, image):
        """What the chip sends of ``image``.

        Parameters
        ----------
        image : array (height, width) of uint8
            Grey values.

        Returns
        -------
        :class:`model.link.points.PatternFrame`
            Points and counts; u and v are positions in the corrected image.

        Raises
        ------
        ValueError
            If the image is not of the sensor's size and 8 bits.
        """
        image = checked(image, self.width, self.height)
        settings = self.settings
        level = settings.level_fixed
        if level is None:
            level = measure_level(image, settings)
        spots, counts = find_corrected_spots(image, level, settings, self.labels)
        points = reconstruct(spots, settings, self.width, self.height)
        before, self._ok = self._ok, int(np.count_nonzero(points["status"] == 0))
        points, beyond = limit_points(points, self.points_max, before)
        dropped = min(counts["dropped"] + beyond, COUNT_LIMIT)
        number, self.number = self.number, (self.number + 1) & 0xFFFF
        return PatternFrame(points=points, number=number, level=level << 4, spots=counts["spots"],
                            rejected=counts["rejected"], dropped=dropped)
