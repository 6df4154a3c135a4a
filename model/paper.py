"""The golden model of the preset ``paper``: frames in, points and counts out, bit for bit."""

from model.capsule import checked
from model.link.point_limiter import limit_points
from model.link.points import PatternFrame
from model.preprocessing.binarise import binarise
from model.preprocessing.erosion import erode
from model.preprocessing.histogram import histogram
from model.preprocessing.remap import remap
from model.preprocessing.spot_queue import filter_spots
from model.preprocessing.threshold import threshold
from model.preprocessing.two_pass_labelling import label_in_two_passes
from model.reconstruction import reconstruct

__all__ = ["LABELS", "Paper", "corrected_spots"]

#: Provisional labels of a frame in the preset.
LABELS = 1023
_COUNT_LIMIT = 0xFFFF


def corrected_spots(image, settings, labels=LABELS):
    """Level of an image, and the components of its corrected image as the spot queue keeps them.

    The level is learnt on the image itself, all of it, before it is corrected. All pixels weigh 1.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values.
    settings : :class:`model.settings.Settings`
        Registers and tables.
    labels : :class:`int`
        Provisional labels of a frame.

    Returns
    -------
    level, spots, counts
        The latter two from :func:`model.preprocessing.spot_queue.filter_spots`; components that
        found no label are among ``spots`` and ``dropped``.
    """
    level = settings.level_fixed
    if level is None:
        level = int(threshold(histogram(image, whole=True), settings.threshold_alpha))
    lit, _ = binarise(remap(image, settings.remap), level)
    lit, core = erode(lit, settings.erosion)
    found, unlabelled = label_in_two_passes(lit, core, labels)
    spots, counts = filter_spots(found, settings)
    for name in ("spots", "dropped"):
        counts[name] = min(counts[name] + unlabelled, _COUNT_LIMIT)
    return level, spots, counts


class Paper:
    """Frames in their order, each to what the chip would send of it.

    Nothing but the frame's number lasts from one frame to the next. Queues are without end: where
    the chip has to drop spots for want of room, its points are a part of these.

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
        self.number = 0

    def frame(self, image):
        """What the chip sends of ``image``.

        Parameters
        ----------
        image : array (height, width) of uint8
            Grey values.

        Returns
        -------
        :class:`model.link.points.PatternFrame`
            Points and counts; u and v are places in the corrected image.

        Raises
        ------
        ValueError
            If the image is not of the sensor's size and 8 bits.
        """
        image = checked(image, self.width, self.height)
        settings = self.settings
        level, spots, counts = corrected_spots(image, settings, self.labels)
        points = reconstruct(spots, settings, self.width, self.height)
        points, beyond = limit_points(points, self.points_max)
        dropped = min(counts["dropped"] + beyond, _COUNT_LIMIT)
        number, self.number = self.number, (self.number + 1) & 0xFFFF
        return PatternFrame(points=points, number=number, level=level, spots=counts["spots"],
                            rejected=counts["rejected"], dropped=dropped)
