"""Pattern frames to spots that wait for their centres: the chain up to the spot queue, once."""

from .binarise import binarise
from .erosion import erode
from .histogram import histogram
from .labelling import label
from .remap import remap
from .spot_queue import COUNT_LIMIT, filter_spots
from .threshold import threshold
from .two_pass_labelling import label_in_two_passes

__all__ = ["find_spots", "measure_level"]


def measure_level(image, settings, whole=False):
    """The threshold that a frame gives.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    settings : :class:`model.settings.Settings`
        ``threshold_alpha``.
    whole : :class:`bool`
        All pixels count, as in the preset ``paper``; otherwise the middle rows.

    Returns
    -------
    :class:`int`
        Smallest grey value that is lit.
    """
    return int(threshold(histogram(image, whole), settings.threshold_alpha))


def find_spots(image, level, settings, labels=None):
    """Components of a frame as the spot queue keeps them.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    level : :class:`int`
        Smallest grey value that is lit.
    settings : :class:`model.settings.Settings`
        Erosion, weighting, area limits; with ``labels`` the remap table too.
    labels : :class:`int` or None
        None for the preset ``capsule``. A number for the preset ``paper``: the image is corrected,
        labelled in two passes with so many provisional labels, and all pixels weigh 1.

    Returns
    -------
    spots, counts
        As from :func:`.spot_queue.filter_spots`; components that found no label are among
        ``spots`` and ``dropped``.
    """
    if labels is not None:
        image = remap(image, settings.remap)
    lit, excess = binarise(image, level)
    lit, core = erode(lit, settings.erosion)
    if labels is None:
        return filter_spots(label(lit, core, excess, settings.weighted), settings)
    components, unlabelled = label_in_two_passes(lit, core, labels)
    spots, counts = filter_spots(components, settings)
    for name in ("spots", "dropped"):
        counts[name] = min(counts[name] + unlabelled, COUNT_LIMIT)
    return spots, counts
