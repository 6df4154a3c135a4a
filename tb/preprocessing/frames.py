"""Frames as the words of pixel streams, and back."""

import numpy as np

from hdl.payloads import GreyPixel, MaskPixel
from tb.native_block import pack

__all__ = ["BROKEN_GREY", "BROKEN_MASK", "grey_words", "mask_words"]

_BROKEN = {"marker_line_end": [1], "marker_frame_end": [1], "marker_broken": [1]}
BROKEN_GREY = pack(GreyPixel, **_BROKEN)
BROKEN_MASK = pack(MaskPixel, **_BROKEN)


def _marks(shape):
    line_end = np.zeros(shape, bool)
    line_end[:, -1] = True
    frame_end = np.zeros(shape, bool)
    frame_end[-1, -1] = True
    return {"marker_line_end": line_end.ravel(), "marker_frame_end": frame_end.ravel()}


def grey_words(image):
    """Words of a whole frame of grey pixels."""
    return pack(GreyPixel, grey=image.ravel(), **_marks(image.shape))


def mask_words(lit, core, excess):
    """Words of a whole frame of mask pixels."""
    return pack(MaskPixel, lit=lit.ravel(), core=core.ravel(), excess=excess.ravel(),
                **_marks(lit.shape))
