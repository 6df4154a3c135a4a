"""One frame, stored as it arrives and then read in any order."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel

__all__ = ["ImageBank"]

#: Pixels of the largest memory block of the Virtex-II Pro, one bit wide.
_PAGE = 1 << 14


class ImageBank(wiring.Component):
    """Stores a frame and keeps it until ``stored`` is taken.

    Takes a pixel in every clock. A frame may begin while ``free`` is high; from its first pixel
    until ``stored`` is taken the bank belongs to it. ``stored`` is valid from the clock after its
    last pixel, or after it breaks off. Any pixel of it may then be read in any clock. Frames must
    have the bank's size, as those of :class:`hdl.acquisition.camera.Camera` do.

    The memory is cut into pages of 16,384 pixels, so that it needs no more blocks than its bits
    do: 50 RAMB16 for 352 x 288. Reset empties the bank.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel, always_ready=True))`
        Frames.
    free : :py:`Out(1)`
        A frame may begin.
    stored : :py:`Out(stream.Signature(1))`
        The frame; high if it lost synchronism.
    address, read : :py:`In(18)`, :py:`In(1)`
        Pixel to read in this clock, row after row. Beyond the frame, ``grey`` is undefined.
    grey : :py:`Out(8)`
        Its grey value, one clock later.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``address`` to ``grey``.
    """

    latency = 1

    def __init__(self, width, height):
        for name, value in [("width", width), ("height", height)]:
            if not isinstance(value, int) or not 2 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
        self.width, self.height = width, height
        super().__init__({
            "i": In(stream.Signature(GreyPixel, always_ready=True)),
            "free": Out(1, init=1),
            "stored": Out(stream.Signature(1)),
            "address": In(18),
            "read": In(1),
            "grey": Out(8),
        })

    def elaborate(self, platform):
        m = Module()
        pixels = self.width * self.height
        position = Signal(range(pixels))
        with m.If(self.stored.ready & self.stored.valid):
            m.d.sync += [self.stored.valid.eq(0), self.free.eq(1)]
        with m.If(self.i.valid):
            m.d.sync += [position.eq(position + 1), self.free.eq(0)]
            with m.If(self.i.p.marker.frame_end):
                m.d.sync += [
                    position.eq(0), self.stored.valid.eq(1),
                    self.stored.payload.eq(self.i.p.marker.broken),
                ]

        page_bits = (_PAGE - 1).bit_length()
        pages = -(-pixels // _PAGE)
        page = Signal(range(max(2, pages)))
        with m.If(self.read):
            m.d.sync += page.eq(self.address[page_bits:])
        with m.Switch(page):
            for number in range(pages):
                memory = Memory(shape=8, depth=min(_PAGE, pixels - number * _PAGE), init=[])
                m.submodules[f"page_{number}"] = memory
                write, read = memory.write_port(), memory.read_port()
                m.d.comb += [
                    write.addr.eq(position[:page_bits]),
                    write.data.eq(self.i.p.grey),
                    write.en.eq(self.i.valid & (position[page_bits:] == number)),
                    read.addr.eq(self.address[:page_bits]),
                    read.en.eq(self.read),
                ]
                with m.Case(number):
                    m.d.comb += self.grey.eq(read.data)
        return m
