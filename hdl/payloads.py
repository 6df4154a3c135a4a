"""Payloads of the streams that join the blocks.

Fields stand in the order of their bits, the first one in the least significant bits. Image
coordinates are fixed-point pixels, see :func:`hdl.protocol.fraction_bits`; what carries an ``end``
flag closes a frame with it, and all its other fields are then zero.
"""

from amaranth.hdl import signed, unsigned
from amaranth.lib import data, enum
from amaranth.utils import bits_for

from hdl.protocol import COORDINATE_BITS, MOST_BEAMS

__all__ = [
    "COORDINATE_BITS", "BEAM_BITS", "AREA_LIMIT", "AREA_CODE_BITS",
    "CONTRAST_FRACTION_BITS", "NOISE_BITS", "Marker", "GreyPixel", "ContrastPixel", "MaskPixel",
    "Spot", "QueuedSpot", "Counts", "Centre", "Undistorted", "Status", "Match", "Point",
    "FrameInfo", "Detection", "FrameTag", "PacketOctet", "MemoryCommand", "StoredFrame",
    "OverlaySpot",
]

#: Bits behind the binary point of a pixel's contrast in grey values.
CONTRAST_FRACTION_BITS = 4
#: Bits of the number of a beam.
BEAM_BITS = bits_for(MOST_BEAMS - 1)
#: Bits of a frame's noise, in eighths of a grey value.
NOISE_BITS = 9
#: An area counter stops here: the component has more pixels than any spot may have.
AREA_LIMIT = 1024
#: Bits of an area's code: the area below 256 pixels, 128 + area // 2 below 512, 256 + area // 4
#: from there on.
AREA_CODE_BITS = 9

_AREA_BITS = 11
_WEIGHT_BITS = 18  # 1,023 pixels of weight 256
_SUM_BITS = 28  # 261,888 times a row or column below 1024


class Marker(data.Struct):
    """Where a pixel stands in its frame.

    ``frame_end`` comes with ``line_end``. ``broken`` comes with both, on a beat without a pixel:
    the frame lost synchronism and ends here, wherever that is.
    """

    line_end: 1
    frame_end: 1
    broken: 1


class GreyPixel(data.Struct):
    """A pixel of the imager."""

    grey: 8
    marker: Marker


class ContrastPixel(data.Struct):
    """A pixel against its surroundings.

    ``difference`` is the grey value less the local mean, signed Q8.4, ``smooth`` that of the
    smoothed image, signed Q8.3. A
    ``dent`` parts two spots. ``border`` pixels, in the outermost rows and the last column, have no
    ``smooth``.
    ``saturated`` ones are at the sensor's maximum.
    """

    difference: signed(9 + CONTRAST_FRACTION_BITS)
    smooth: signed(8 + CONTRAST_FRACTION_BITS)
    dent: 1
    border: 1
    saturated: 1
    marker: Marker


class MaskPixel(data.Struct):
    """A pixel that is lit or dark.

    ``excess`` is the grey value above the level; it has no meaning where the pixel is dark. A
    component without any ``core`` pixel is no spot. ``saturated`` pixels are at the sensor's
    maximum; preset ``paper`` has none.
    """

    lit: 1
    core: 1
    saturated: 1
    excess: 8
    marker: Marker


class Spot(data.Struct):
    """What a component's pixels add up to, or (``end``) the end of a frame's components.

    ``area`` stops at :data:`AREA_LIMIT`; the sums of such a component read zero, so that no sum
    that is ever used has wrapped. ``core`` and ``saturated``: a pixel is; ``border``: a pixel
    stands in an outermost row or column.
    """

    end: 1
    broken: 1
    core: 1
    saturated: 1
    border: 1
    area: _AREA_BITS
    weight: unsigned(_WEIGHT_BITS)
    sum_u: unsigned(_SUM_BITS)
    sum_v: unsigned(_SUM_BITS)


class QueuedSpot(data.Struct):
    """A component that waits for its centre; ``area`` is a code, see :data:`AREA_CODE_BITS`."""

    end: 1
    rejected: 1
    area: AREA_CODE_BITS
    saturated: 1
    border: 1
    weight: unsigned(_WEIGHT_BITS)
    sum_u: unsigned(_SUM_BITS)
    sum_v: unsigned(_SUM_BITS)


class Counts(data.Struct):
    """What became of a frame's components before their centres were known."""

    spots: 16
    rejected: 16
    dropped: 16
    broken: 1


class Centre(data.Struct):
    """A spot's centre in the image, unsigned."""

    end: 1
    rejected: 1
    area: AREA_CODE_BITS
    saturated: 1
    border: 1
    u: unsigned(COORDINATE_BITS)
    v: unsigned(COORDINATE_BITS)


class Undistorted(data.Struct):
    """A :class:`Centre` with its undistorted place, signed, about the image centre."""

    end: 1
    rejected: 1
    area: AREA_CODE_BITS
    saturated: 1
    border: 1
    u: unsigned(COORDINATE_BITS)
    v: unsigned(COORDINATE_BITS)
    x: signed(COORDINATE_BITS)
    y: signed(COORDINATE_BITS)


class Status(enum.Enum, shape=2):
    """What a spot turned out to be."""

    OK = 0
    NOISE = 1
    AMBIGUOUS = 2
    REJECTED = 3


class Match(data.Struct):
    """A spot with the beam that made it; ``beam`` is zero unless the status is ok."""

    end: 1
    status: Status
    beam: BEAM_BITS
    area: AREA_CODE_BITS
    saturated: 1
    border: 1
    u: unsigned(COORDINATE_BITS)
    v: unsigned(COORDINATE_BITS)
    x: signed(COORDINATE_BITS)


class Point(data.Struct):
    """A spot with its inverse depth, in units that the calibration chose.

    ``beam`` and ``inverse_z`` are zero unless the status is ok, and ``inverse_z`` is not zero where
    it is.
    """

    end: 1
    status: Status
    beam: BEAM_BITS
    area: AREA_CODE_BITS
    saturated: 1
    border: 1
    u: unsigned(COORDINATE_BITS)
    v: unsigned(COORDINATE_BITS)
    inverse_z: unsigned(18)


class FrameTag(data.Struct):
    """How the sensor exposed a frame; set before it sends the frame, stable until the next one.

    ``laser`` tells that the laser was lit at any time of the integration, not that it was asked
    for. ``timestamp_us`` is the start of the integration.
    """

    texture: 1
    laser: 1
    capture: 1
    exposure_us: 16
    timestamp_us: 24


class FrameInfo(data.Struct):
    """What is known of a frame when its first pixel passes.

    ``tripped`` tells that the laser guard holds a cause, ``tables_valid`` that a set of tables was
    committed and checked. ``every`` is the register ``pattern_every``.
    """

    number: 16
    skipped: 8
    tag: FrameTag
    tripped: 1
    tables_valid: 1
    every: 4


class Detection(data.Struct):
    """How a frame's spots were separated from its background, known when its last pixel has passed.

    ``learning`` tells that there was no level yet. ``level`` is the one from which on pixels were
    lit, unsigned Q8.4, ``noise`` what it is a multiple of, in eighths of a grey value.
    ``saturated`` counts pixels at the sensor's maximum.
    """

    learning: 1
    level: 8 + CONTRAST_FRACTION_BITS
    noise: NOISE_BITS
    saturated: 21


class PacketOctet(data.Struct):
    """An octet of a packet: its kind first, then the body, ``last`` with the body's last octet."""

    data: 8
    last: 1


class MemoryCommand(data.Struct):
    """An access to the external memory; ``lanes`` tells which bytes a write changes."""

    write: 1
    address: 19
    data: 32
    lanes: 4


class StoredFrame(data.Struct):
    """What a frame store keeps of a frame besides its pixels."""

    number: 16
    texture: 1


class OverlaySpot(data.Struct):
    """A spot to be drawn over the picture, or (``end``) the end of a frame's spots."""

    end: 1
    ok: 1
    u: unsigned(COORDINATE_BITS)
    v: unsigned(COORDINATE_BITS)
