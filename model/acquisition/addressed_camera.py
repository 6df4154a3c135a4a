"""The beats that an imager with addressed pixels becomes, and when they are converted."""

import numpy as np

from .camera import BAD_SYNC, BROKEN, FRAME_END, LINE_END

__all__ = ["addressed_camera", "conversions"]


def addressed_camera(frames):
    """Beats of frames of which the last ones' ends may be missing.

    Parameters
    ----------
    frames : list of (image, number of pixels)
        Images as the converter gives them, and how many of their pixels were converted before the
        next read-out began.

    Returns
    -------
    tuple of two arrays
        Grey values and markers, as in :func:`.camera.camera`.
    """
    greys, markers = [np.zeros(0, np.uint8)], [np.zeros(0, np.uint8)]
    for image, pixels in frames:
        height, width = image.shape
        marker = np.zeros((height, width), np.uint8)
        marker[:, -1] = LINE_END
        marker[-1, -1] |= FRAME_END
        greys.append(image.ravel()[:pixels])
        markers.append(marker.ravel()[:pixels])
        if pixels < height * width:
            greys.append(np.array([BAD_SYNC], np.uint8))
            markers.append(np.array([LINE_END | FRAME_END | BROKEN], np.uint8))
    return np.concatenate(greys), np.concatenate(markers)


def conversions(width, height, interval, read):
    """Clocks of the conversion strobes of a frame whose ``sensor_read`` rises in clock ``read``,
    if nothing waits."""
    return read + interval * np.arange(1, width * height + 1)
