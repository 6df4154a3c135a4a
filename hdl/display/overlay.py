"""Diamonds around spots, drawn row by row over the picture."""

from amaranth import *
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..acquisition.frame_banks import FrameBanks
from ..payloads import COORDINATE_BITS, OverlaySpot
from ..protocol import SMALL_SENSOR, fraction_bits

__all__ = ["DIAMONDS", "OverlayColour", "Overlay"]

#: Spots of a frame that are drawn.
DIAMONDS = 128
_COUNT_BITS = 8
_FRACTION_BITS = fraction_bits(SMALL_SENSOR, SMALL_SENSOR)
_POSITION_BITS = COORDINATE_BITS - _FRACTION_BITS + 1  # the last half pixel rounds up


class OverlayColour(enum.Enum, shape=2):
    """What a pixel shows."""

    NONE = 0
    OK = 1
    OTHER = 2


class _List(data.Struct):
    """The frame of a list of diamonds, and their number."""

    number: 16
    count: _COUNT_BITS


class _Diamond(data.Struct):
    """The middle of a diamond, and the status of its spot."""

    ok: 1
    column: _POSITION_BITS
    row: _POSITION_BITS


class Overlay(wiring.Component):
    """Keeps lists of spots, one for each frame, and draws open diamonds around them.

    Lists come in the domain ``sync``, a spot in a clock if need be, and are drawn in the domain
    ``display``; a :class:`.FrameBanks` of three banks is between them, so no list is ever
    refused, and none is shown before its end. A diamond has the pixels at a distance ``reach`` from
    the pixel of its spot's centre, rows and columns added; what is outside the picture is not
    drawn. So each diamond has two pixels in a row, and a row is drawn in ``width`` +
    2 ``DIAMONDS`` + 6 clocks at most, while the row before is shown. Where
    diamonds meet, the later one is on top.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    reach : :class:`int`, optional
        Distance from the middle of a diamond to its corners, 1 to 15. By default 5, or 3 where the
        frame is not wider than 128.

    Members
    -------
    i : :py:`In(stream.Signature(OverlaySpot, always_ready=True))`
        Spots of a frame, then an end marker.
    number : :py:`In(16)`
        Number of that frame, sampled with the ``end``.
    undrawn : :py:`Out(8)`
        Spots beyond the 128th of their list, which are not drawn. It stops at 255.
    acquire : :py:`In(1)`
        Change to the newest list (``display``, as all that follow).
    held : :py:`Out(1)`
        There is one.
    list_number : :py:`Out(16)`
        Number of its frame, while ``held``.
    prepare : :py:`In(1)`
        Draw a row; only when the last one is done.
    prepare_row : :py:`In(range(height))`
        Number of that row. There is a buffer for odd rows and one for even ones.
    enable : :py:`In(1)`
        If low in the clock of ``prepare``, that row gets no diamonds.
    odd : :py:`In(1)`
        Which of the two rows to show.
    column : :py:`In(range(width))`
        Which of its pixels.
    colour : :py:`Out(OverlayColour)`
        Its colour, two clocks later.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``column`` to ``colour``.
    """

    latency = 2

    def __init__(self, width, height, reach=None):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 2 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
        reach = (3 if width <= 128 else 5) if reach is None else reach
        if not isinstance(reach, int) or not 1 <= reach <= 15:
            raise ValueError(
                f"The reach of a diamond must be an integer from 1 to 15, not {reach!r}")
        self.width, self.height, self.reach = width, height, reach
        super().__init__({
            "i": In(stream.Signature(OverlaySpot, always_ready=True)),
            "number": In(16),
            "undrawn": Out(_COUNT_BITS),
            "acquire": In(1),
            "held": Out(1),
            "list_number": Out(16),
            "prepare": In(1),
            "prepare_row": In(range(height)),
            "enable": In(1),
            "odd": In(1),
            "column": In(range(width)),
            "colour": Out(OverlayColour),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.banks = banks = FrameBanks(3, _List)
        m.submodules.diamonds = diamonds = Memory(shape=_Diamond, depth=4 * DIAMONDS, init=[])
        row_bits = (self.width - 1).bit_length()
        m.submodules.pixels = pixels = Memory(shape=OverlayColour, depth=2 << row_bits, init=[])

        # Lists.
        count = Signal(range(DIAMONDS + 1))
        put = diamonds.write_port()
        half = 1 << (_FRACTION_BITS - 1)
        m.d.comb += [
            banks.closes.eq(self.i.valid & self.i.p.end),
            banks.info.number.eq(self.number),
            banks.info.count.eq(count),
            put.addr.eq(Cat(count[:-1], banks.write_bank)),
            put.data.ok.eq(self.i.p.ok),
            put.data.column.eq((self.i.p.u + half) >> _FRACTION_BITS),
            put.data.row.eq((self.i.p.v + half) >> _FRACTION_BITS),
            put.en.eq(self.i.valid & ~self.i.p.end & (count != DIAMONDS)),
        ]
        with m.If(self.i.valid):
            with m.If(self.i.p.end):
                m.d.sync += count.eq(0)
            with m.Elif(count != DIAMONDS):
                m.d.sync += count.eq(count + 1)
            with m.Else():
                m.d.sync += self.undrawn.eq(self.undrawn + ~self.undrawn.all())

        # A row is cleared, then each diamond takes two clocks: it is fetched, and its two pixels
        # are written while the next one is fetched.
        m.d.comb += [
            banks.acquire.eq(self.acquire),
            self.held.eq(banks.held),
            self.list_number.eq(banks.frame.number),
        ]
        row = Signal(range(self.height))
        total = Signal(range(DIAMONDS + 1))  # diamonds of the row
        index = Signal(range(max(self.width, DIAMONDS + 1)))
        wiping = Signal()
        drawing = Signal()
        second = Signal()
        fetch = diamonds.read_port(domain="display")
        m.d.comb += [fetch.addr.eq(Cat(index[:DIAMONDS.bit_length() - 1], banks.read_bank)),
                     fetch.en.eq(1)]
        with m.If(self.prepare):
            m.d.display += [
                row.eq(self.prepare_row), index.eq(0), wiping.eq(1), drawing.eq(0),
                total.eq(Mux(self.enable & banks.held, banks.frame.count, 0)),
            ]
        with m.Elif(wiping):
            m.d.display += index.eq(index + 1)
            with m.If(index == self.width - 1):
                m.d.display += [index.eq(0), wiping.eq(0), drawing.eq(total != 0), second.eq(0)]
        with m.Elif(drawing):
            m.d.display += second.eq(~second)
            with m.If(second):
                m.d.display += index.eq(index + 1)
                with m.If(index == total - 1):
                    m.d.display += drawing.eq(0)

        diamond = fetch.data
        down = Signal(signed(_POSITION_BITS + 1))
        away = Signal(range(self.reach + 1))
        left = Signal(signed(_POSITION_BITS + 2))
        right = Signal(signed(_POSITION_BITS + 2))
        colour = Signal(OverlayColour)
        hits = Signal(2)  # how many of the two pixels are still to be written
        m.d.comb += [
            down.eq(row - diamond.row),
            away.eq(self.reach - Mux(down < 0, -down, down)),
        ]
        with m.If(drawing & second):
            m.d.display += [
                left.eq(diamond.column - away), right.eq(diamond.column + away),
                colour.eq(Mux(diamond.ok, OverlayColour.OK, OverlayColour.OTHER)),
                hits.eq(((down <= self.reach) & (down >= -self.reach)).replicate(2)),
            ]
        with m.Else():
            m.d.display += [left.eq(right), hits.eq(hits >> 1)]

        # Pixels.
        write, read = pixels.write_port(domain="display"), pixels.read_port(domain="display")
        m.d.comb += [
            write.addr.eq(Cat(Mux(wiping, index, left)[:row_bits], row[0])),
            write.data.eq(Mux(wiping, OverlayColour.NONE, colour)),
            write.en.eq(wiping | (hits[0] & (left >= 0) & (left < self.width))),
            read.addr.eq(Cat(self.column, self.odd)),
            read.en.eq(1),
        ]
        m.d.display += self.colour.eq(read.data)
        return m
