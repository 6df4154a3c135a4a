"""The golden model of the whole chip: frames in, points and counts out, bit for bit."""

from dataclasses import replace

import numpy as np

from model.link.point_limiter import limit_points
from model.link.points import PatternFrame
from model.preprocessing.front_chain import find_spots, learn_noise, lit_level
from model.reconstruction import reconstruct

__all__ = ["Capsule", "checked"]


def checked(image, width, height):
    """The image as an array; ValueError unless it has the sensor's size and 8 bits."""
    image = np.asarray(image)
    if image.shape != (height, width) or image.dtype != np.uint8:
        raise ValueError(f"A frame must have {width} x {height} pixels of 8 bits, "
                         f"not {image.shape[::-1]} of {image.dtype}")
    return image


class Capsule:
    """Frames in their order, each to what the chip would send of it.

    The only state between frames is the noise, learnt on the frame before, the number of its ok
    points, and the frame's number. Queues never overflow: if the chip's buffer is full and it drops
    spots, its points are a part of these.

    Parameters
    ----------
    settings : :class:`model.settings.Settings`
        Registers and tables.
    width, height : :class:`int`
        Sensor size in pixels.
    points_max : :class:`int`
        Ok points of a frame that are sent; 0 is no limit.
    """

    def __init__(self, settings, width, height, points_max=0):
        self.settings, self.width, self.height = settings, width, height
        self.points_max = points_max
        self.number = 0
        self._noise = None
        self._ok = 0

    def frame(self, image):
        """What the chip sends of ``image``.

        Parameters
        ----------
        image : array (height, width) of uint8
            Grey values.

        Returns
        -------
        :class:`model.link.points.PatternFrame`
            Points and counts.

        Raises
        ------
        ValueError
            If the image is not of the sensor's size and 8 bits.
        """
        image = checked(image, self.width, self.height)
        settings = self.settings
        noise = settings.fixed_noise or self._noise
        before, self._ok = self._ok, 0
        if noise is None:
            result = PatternFrame(learning=True)
            learnt = learn_noise(image, settings)
        else:
            spots, counts, learnt = find_spots(image, noise, settings)
            points = reconstruct(spots, settings, self.width, self.height)
            self._ok = int(np.count_nonzero(points["status"] == 0))
            points, dropped = limit_points(points, self.points_max, before)
            result = PatternFrame(
                points=points, grey_noise=noise, level=lit_level(noise, settings),
                dropped=dropped, spots=counts["spots"], rejected=counts["rejected"])
        self._noise = learnt
        number, self.number = self.number, (self.number + 1) & 0xFFFF
        saturated = int(np.count_nonzero(image >= settings.saturation))
        return replace(result, number=number, saturated=saturated)
