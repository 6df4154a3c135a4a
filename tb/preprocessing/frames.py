"""Frames as the words of pixel streams, and the spots that come of them."""

import numpy as np

from hdl.payloads import GreyPixel, MaskPixel, Spot
from model.preprocessing.labelling import SPOT_DTYPE
from tb.native_block import pack, unpack

__all__ = ["BROKEN_GREY", "BROKEN_MASK", "check_spots", "grey_words", "mask_words", "spot_frames",
           "spot_tuples"]

_BROKEN = {"marker_line_end": [1], "marker_frame_end": [1], "marker_broken": [1]}
BROKEN_GREY = pack(GreyPixel, **_BROKEN)
BROKEN_MASK = pack(MaskPixel, **_BROKEN)


def _words(shape, images, **fields):
    """Words of ``images``, whose last two dimensions are height and width."""
    line_end, frame_end = np.zeros(images.shape, bool), np.zeros(images.shape, bool)
    line_end[..., -1] = True
    frame_end[..., -1, -1] = True
    words = pack(shape, marker_line_end=line_end.ravel(), marker_frame_end=frame_end.ravel(),
                 **{name: np.ravel(values) for name, values in fields.items()})
    return words.reshape(*images.shape[:-2], -1, words.shape[-1])


def grey_words(image):
    """Words of a whole frame of grey pixels, or of several."""
    return _words(GreyPixel, image, grey=image)


def mask_words(lit, core, excess, saturated=0):
    """Words of a whole frame of mask pixels, or of several."""
    return _words(MaskPixel, lit, lit=lit, core=core, excess=excess, saturated=saturated)


def spot_frames(fields):
    """Unpacked spots, parted after each end marker: [(spots, broken), ...]."""
    ends = np.flatnonzero(fields["end"])
    assert len(ends) == 0 or ends[-1] == len(fields) - 1, "spots after the last end marker"
    frames = []
    for first, last in zip([0, *(ends[:-1] + 1)], ends, strict=True):
        close, spots = fields[last], np.zeros(last - first, SPOT_DTYPE)
        for name in SPOT_DTYPE.names:
            assert close[name] == 0, f"{name} of an end marker is {close[name]}"
            spots[name] = fields[name][first:last]
        assert not fields["broken"][first:last].any()
        frames.append((spots, bool(close["broken"])))
    return frames


def check_spots(got, wanted, what):
    """Assert that two arrays of :data:`model.preprocessing.labelling.SPOT_DTYPE` are equal."""
    assert len(got) == len(wanted), f"{what}: {len(got)} spots, not {len(wanted)}"
    for index in np.flatnonzero(got != wanted)[:1]:
        raise AssertionError(f"{what}, spot {index}: expected {wanted[index]}, got {got[index]}")


def spot_tuples(words):
    """Tuples of the fields of SPOT_DTYPE, or "end" or "broken", of spot words."""
    parts = [[word >> 32 * part & 0xFFFFFFFF for part in range(3)] for word in words]
    fields = unpack(Spot, np.array(parts, dtype=np.uint32).reshape(-1, 3))
    return [("broken" if spot["broken"] else "end") if spot["end"]
            else tuple(int(spot[name]) for name in SPOT_DTYPE.names) for spot in fields]
