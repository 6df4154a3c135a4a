"""The stored frame on a screen."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import OverlaySpot, StoredFrame
from .overlay import Overlay, OverlayColour

__all__ = ["COLUMNS", "ROWS", "VGA"]

#: Size of the screen.
COLUMNS, ROWS = 640, 480
_FRONT, _SYNC, _BACK = 16, 96, 48
_FRONT_ROWS, _SYNC_ROWS, _BACK_ROWS = 10, 2, 33
_LINE = COLUMNS + _FRONT + _SYNC + _BACK
_LINES = ROWS + _FRONT_ROWS + _SYNC_ROWS + _BACK_ROWS
#: Clocks from a position on the screen to its pixel: the address, the store, the pins.
_ADDRESS, _STORE, _PINS = 1, 2, 1


class VGA(wiring.Component):
    """Shows frames on a screen of 640 x 480, 60 times a second at 25.175 MHz.

    Everything works in the domain ``display`` except the spots of the overlay, which arrive in
    ``sync``. The picture is enlarged by the largest whole factor that fits, and centred on a black
    border. A new frame is requested once in each vertical blanking, after the last line has been
    shown; if none has arrived by the line before the picture, the display stays black. So no
    picture is ever made of two frames. The frame's spots are drawn over it, green where they are
    ok and red otherwise, see :class:`.Overlay`; they are drawn over the texture frame with the next
    number too. Until that frame's list has ended, its picture has no overlay.

    Both sync pulses are low, as the VESA timing has them: 16, 96 and 48 clocks of front porch,
    sync and back porch, and 10, 2 and 33 lines, counted from the leading edge of the horizontal
    pulse. The pins come from flip-flops.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels, at most 512 x 480.
    colour_bits : :class:`int`
        Bits of each colour, 1 to 8.

    Members
    -------
    overlay : :py:`In(stream.Signature(OverlaySpot, always_ready=True))`
        Spots of a frame, then an end marker (``sync``).
    overlay_number : :py:`In(16)`
        Number of that frame, sampled with the ``end``.
    undrawn : :py:`Out(8)`
        Spots beyond the 128th of their frame. It stops at 255.
    acquire : :py:`Out(1)`
        Requests the newest frame from the store, for a clock; the one before is not read any more.
    held : :py:`In(1)`
        The store has answered.
    frame : :py:`In(StoredFrame)`
        The frame's information.
    fetch, fetch_row : :py:`Out(1)`, :py:`Out(range(height))`
        That row will be shown from the next line of the screen on, which begins 800 clocks later:
        for stores that have to fetch it.
    turn : :py:`Out(1)`
        High for a clock when the first pixel of a row may be read, once for each fetched row.
    row, column, address : :py:`Out(range(height))`, :py:`Out(range(width))`, \
    :py:`Out(range(width * height))`
        Pixel to be read; ``address`` is row * width + column.
    data : :py:`In(8)`
        Its grey value, two clocks later.
    hsync, vsync : :py:`Out(1)`
        Sync pins.
    visible : :py:`Out(1)`
        High outside the blankings, for converters that need it.
    red, green, blue : :py:`Out(colour_bits)`
        Colour pins, zero in the blankings.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a position on the screen to its pixel at the pins.
    """

    latency = _ADDRESS + _STORE + _PINS

    def __init__(self, width, height, colour_bits=8):
        for name, value, most in (("width", width, 512), ("height", height, ROWS)):
            if not isinstance(value, int) or not 2 <= value <= most:
                raise ValueError(
                    f"Frame {name} must be an integer from 2 to {most}, not {value!r}")
        if not isinstance(colour_bits, int) or not 1 <= colour_bits <= 8:
            raise ValueError(
                f"Bits of a colour must be an integer from 1 to 8, not {colour_bits!r}")
        self.width, self.height, self.colour_bits = width, height, colour_bits
        self.scale = min(COLUMNS // width, ROWS // height)
        super().__init__({
            "overlay": In(stream.Signature(OverlaySpot, always_ready=True)),
            "overlay_number": In(16),
            "undrawn": Out(8),
            "acquire": Out(1),
            "held": In(1),
            "frame": In(StoredFrame),
            "fetch": Out(1),
            "fetch_row": Out(range(height)),
            "turn": Out(1),
            "row": Out(range(height)),
            "column": Out(range(width)),
            "address": Out(range(width * height)),
            "data": In(8),
            "hsync": Out(1, init=1),
            "vsync": Out(1, init=1),
            "visible": Out(1),
            "red": Out(colour_bits),
            "green": Out(colour_bits),
            "blue": Out(colour_bits),
        })

    def elaborate(self, platform):
        m = Module()
        width, height, scale = self.width, self.height, self.scale
        left = (COLUMNS - width * scale) // 2
        top = (ROWS - height * scale) // 2

        # The position on the screen, which starts in the vertical blanking, before the first row.
        x = Signal(range(_LINE))
        y = Signal(range(_LINES), init=ROWS)
        line_ends = Signal()
        m.d.comb += line_ends.eq(x == _LINE - 1)
        m.d.display += x.eq(Mux(line_ends, 0, x + 1))
        with m.If(line_ends):
            m.d.display += y.eq(Mux(y == _LINES - 1, 0, y + 1))

        # The frame's row there, and how often it has been shown.
        row = Signal(range(height))
        row_address = Signal(range(width * height))
        row_repeat = Signal(range(max(2, scale)))
        rows = Signal()
        first_row_next = Signal()
        next_row_next = Signal()
        m.d.comb += [
            first_row_next.eq(y == (top - 1) % _LINES),
            next_row_next.eq(rows & (row_repeat == scale - 1) & (row != height - 1)),
        ]
        with m.If(line_ends):
            with m.If(first_row_next):
                m.d.display += [rows.eq(1), row.eq(0), row_address.eq(0), row_repeat.eq(0)]
            with m.Elif(next_row_next):
                m.d.display += [row.eq(row + 1), row_address.eq(row_address + width),
                                row_repeat.eq(0)]
            with m.Elif(row_repeat == scale - 1):
                m.d.display += rows.eq(0)
            with m.Else():
                m.d.display += row_repeat.eq(row_repeat + 1)
        m.d.display += [
            self.fetch.eq((x == 0) & (first_row_next | next_row_next)),
            self.fetch_row.eq(Mux(first_row_next, 0, row + 1)),
        ]

        # The frame's column there, likewise.
        column = Signal(range(width))
        column_repeat = Signal(range(max(2, scale)))
        columns = Signal()
        with m.If(x == (left - 1) % _LINE):
            m.d.display += [columns.eq(1), column.eq(0), column_repeat.eq(0)]
        with m.Elif(column_repeat == scale - 1):
            m.d.display += column_repeat.eq(0)
            with m.If(column == width - 1):
                m.d.display += columns.eq(0)
            with m.Else():
                m.d.display += column.eq(column + 1)
        with m.Else():
            m.d.display += column_repeat.eq(column_repeat + 1)
        m.d.display += [
            self.turn.eq((x == 0) & rows & (row_repeat == 0)),
            self.row.eq(row), self.column.eq(column), self.address.eq(row_address + column)]

        # Frames and their overlays change in the blanking only. What came by the line before the
        # picture is shown in all of it.
        m.submodules.overlay = overlay = Overlay(width, height)
        showing = Signal()
        m.d.display += self.acquire.eq((y == ROWS) & (x == 0))
        with m.If((x == 0) & first_row_next):
            m.d.display += [
                showing.eq(self.held),
                overlay.enable.eq(overlay.held & (
                    overlay.list_number == (self.frame.number - self.frame.texture)[:16])),
            ]
        m.d.comb += [
            Value.cast(overlay.i.p).eq(Value.cast(self.overlay.p)),
            overlay.i.valid.eq(self.overlay.valid),
            overlay.number.eq(self.overlay_number),
            self.undrawn.eq(overlay.undrawn),
            overlay.acquire.eq(self.acquire),
            overlay.prepare.eq(self.fetch),
            overlay.prepare_row.eq(self.fetch_row),
            overlay.odd.eq(self.row[0]),
            overlay.column.eq(self.column),
        ]

        # Flags are delayed as their pixel is. The vertical pulse begins and ends with a horizontal
        # one.
        vsync = Signal(init=1)
        with m.If(x == COLUMNS + _FRONT - 1):
            m.d.display += vsync.eq((y < ROWS + _FRONT_ROWS - 1)
                                    | (y >= ROWS + _FRONT_ROWS + _SYNC_ROWS - 1))
        flags = Signal(4)
        m.d.comb += flags.eq(Cat(
            rows & columns & showing,
            (x < COLUMNS) & (y < ROWS),
            (x < COLUMNS + _FRONT) | (x >= COLUMNS + _FRONT + _SYNC),
            vsync,
        ))
        for clock in range(_ADDRESS + _STORE):
            later = Signal(4, name=f"flags_{clock + 1}", init=0b1100)
            m.d.display += later.eq(flags)
            flags = later
        full = (1 << self.colour_bits) - 1
        grey = self.data[8 - self.colour_bits:]
        m.d.display += [
            Cat(self.visible, self.hsync, self.vsync).eq(flags[1:]),
            *(pin.eq(Mux(flags[0], grey, 0)) for pin in (self.red, self.green, self.blue)),
        ]
        with m.If(flags[0] & (overlay.colour != OverlayColour.NONE)):
            m.d.display += [
                self.red.eq(Mux(overlay.colour == OverlayColour.OK, 0, full)),
                self.green.eq(Mux(overlay.colour == OverlayColour.OK, full, 0)),
                self.blue.eq(0),
            ]
        return m
