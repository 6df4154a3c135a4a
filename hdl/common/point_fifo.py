"""A FIFO for points, in one dual-port block RAM."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import Point

__all__ = ["PointFIFO"]

_WORD_BITS = 36
_PLACES = 256


class PointFIFO(wiring.Component):
    """Queues 256 points, besides the one that shows at ``o``.

    Each half of a point takes a port of the memory, so both sides take turns and writing goes
    first: a point comes out two clocks after it went in if no other one comes in meanwhile. While
    full, ``i`` waits; nothing is lost. Reset empties it.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end markers.
    o : :py:`Out(stream.Signature(Point))`
        The same, in the same order.
    """

    depth = _PLACES + 1

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Point)),
            "o": Out(stream.Signature(Point)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.points = memory = Memory(shape=_WORD_BITS, depth=2 * _PLACES, init=[])

        # `level` counts what is in the memory; its top bit means full.
        level = Signal(range(_PLACES + 1))
        write_place = Signal(range(_PLACES))
        read_place = Signal(range(_PLACES))
        place = Signal(range(_PLACES))
        push = Signal()
        fetch = Signal()
        m.d.comb += [
            self.i.ready.eq(~level[-1]),
            push.eq(self.i.valid & self.i.ready),
            fetch.eq(~push & (level != 0) & (~self.o.valid | self.o.ready)),
            place.eq(Mux(push, write_place, read_place)),
        ]
        word = Value.cast(self.i.p)
        halves = []
        for half in range(2):
            write = memory.write_port()
            read = memory.read_port()
            m.d.comb += [
                write.addr.eq(Cat(place, C(half, 1))),
                write.data.eq(word[half * _WORD_BITS:(half + 1) * _WORD_BITS]),
                write.en.eq(push),
                read.addr.eq(Cat(place, C(half, 1))),
                read.en.eq(fetch),
            ]
            halves.append(read.data)
        m.d.comb += Value.cast(self.o.p).eq(Cat(halves))

        with m.If(push):
            m.d.sync += [write_place.eq(write_place + 1), level.eq(level + 1)]
        with m.If(fetch):
            m.d.sync += [read_place.eq(read_place + 1), level.eq(level - 1), self.o.valid.eq(1)]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)

        return m
