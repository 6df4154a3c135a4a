"""Pattern frames to spots that wait for their centres: the chain up to the spot queue, once."""

from .background import background
from .binarise import binarise
from .erosion import erode
from .histogram import histogram
from .hysteresis import hysteresis
from .labelling import label
from .noise import frame_noise, levels
from .remap import remap
from .spot_queue import COUNT_LIMIT, filter_spots
from .threshold import threshold
from .two_pass_labelling import label_in_two_passes

__all__ = [
    "find_corrected_spots", "find_spots", "learn_noise", "lit_level", "lit_pixels",
    "measure_level"]


def learn_noise(image, settings):
    """The noise that a frame teaches, in eighths of a grey value; preset ``capsule``.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    settings : :class:`model.settings.Settings`
        ``mean_window``.
    """
    return frame_noise(background(image, settings.mean_window, 0)[0])


def lit_level(noise, settings):
    """Difference to the local mean from which on a pixel is lit, unsigned Q8.4."""
    return _levels(noise, settings).lit


def _levels(noise, settings):
    return levels(noise, settings.lit_gain, settings.core_gain, settings.dent_gain)


def lit_pixels(image, noise, settings):
    """Pixels that stand out of their surroundings; preset ``capsule``.

    Parameters
    ----------
    image, noise, settings
        As for :func:`find_spots`.

    Returns
    -------
    lit, core, excess
        As from :func:`.hysteresis.hysteresis`.
    difference : array of int64
        As from :func:`.background.background`.
    """
    chosen = _levels(noise, settings)
    difference, smooth, dents = background(image, settings.mean_window, chosen.dent)
    return *hysteresis(difference, smooth, dents, chosen), difference


def find_spots(image, noise, settings):
    """Components of a frame that have a core, as the spot queue keeps them; preset ``capsule``.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    noise : :class:`int`
        In eighths of a grey value, of the frame before or fixed.
    settings : :class:`model.settings.Settings`
        Window, gains, saturation, weighting and area limits.

    Returns
    -------
    spots, counts
        As from :func:`.spot_queue.filter_spots`.
    learnt : :class:`int`
        The noise that the frame teaches, as from :func:`learn_noise`.
    """
    lit, core, excess, difference = lit_pixels(image, noise, settings)
    components = label(
        lit, core, excess, image >= settings.saturation, settings.weighted)
    spots, counts = filter_spots(components[components["core"]], settings)
    return spots, counts, frame_noise(difference)


def measure_level(image, settings):
    """The threshold that a frame gives; preset ``paper``.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    settings : :class:`model.settings.Settings`
        ``threshold_alpha``.

    Returns
    -------
    :class:`int`
        Smallest grey value that is lit.
    """
    return int(threshold(histogram(image, whole=True), settings.threshold_alpha))


def find_corrected_spots(image, level, settings, labels):
    """Components of a corrected frame as the spot queue keeps them; preset ``paper``.

    The image is corrected by the remap table, labelled in two passes, and all pixels weigh 1.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values as the imager sent them.
    level : :class:`int`
        Smallest grey value that is lit.
    settings : :class:`model.settings.Settings`
        Remap table, erosion and area limits.
    labels : :class:`int`
        Provisional labels.

    Returns
    -------
    spots, counts
        As from :func:`.spot_queue.filter_spots`; components that found no label are among
        ``spots`` and ``dropped``.
    """
    lit, _ = binarise(remap(image, settings.remap), level)
    lit, core = erode(lit, settings.erosion)
    components, unlabelled = label_in_two_passes(lit, core, labels)
    spots, counts = filter_spots(components, settings)
    for name in ("spots", "dropped"):
        counts[name] = min(counts[name] + unlabelled, COUNT_LIMIT)
    return spots, counts
