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
        Grey values and marks, as in :func:`.camera.camera`.
    """
    greys, marks = [np.zeros(0, np.uint8)], [np.zeros(0, np.uint8)]
    for image, pixels in frames:
        height, width = image.shape
        mark = np.zeros((height, width), np.uint8)
        mark[:, -1] = LINE_END
        mark[-1, -1] |= FRAME_END
        greys.append(image.ravel()[:pixels])
        marks.append(mark.ravel()[:pixels])
        if pixels < height * width:
            greys.append(np.array([BAD_SYNC], np.uint8))
            marks.append(np.array([LINE_END | FRAME_END | BROKEN], np.uint8))
    return np.concatenate(greys), np.concatenate(marks)


def conversions(width, height, interval, read):
    """Clocks of the conversion strobes of a frame whose ``sensor_read`` rises in clock ``read``,
    if nothing waits."""
    return read + interval * np.arange(1, width * height + 1)
