"""A FIFO for points, in one dual-port block RAM."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import Point

__all__ = ["PointFIFO"]

_WORD_BITS = 36
_SLOTS = 256


class PointFIFO(wiring.Component):
    """Queues 256 points, besides the one at ``o``.

    Each half of a point takes a port of the memory, so writing and reading take turns, and writing
    goes first. While the memory is full, ``i`` stalls; nothing is lost. Reset empties it.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end markers.
    o : :py:`Out(stream.Signature(Point))`
        The same, in the same order.

    Attributes
    ----------
    depth : :class:`int`
        Points that it holds.
    latency : :class:`int`
        Clocks from a point at ``i`` to the same at ``o``, if it is empty and no other point follows
        at once.
    """

    depth = _SLOTS + 1
    latency = 2

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Point)),
            "o": Out(stream.Signature(Point)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.points = memory = Memory(shape=_WORD_BITS, depth=2 * _SLOTS, init=[])

        # `level` counts what is in the memory; its top bit means full.
        level = Signal(range(_SLOTS + 1))
        write_index = Signal(range(_SLOTS))
        read_index = Signal(range(_SLOTS))
        index = Signal(range(_SLOTS))
        push = Signal()
        fetch = Signal()
        m.d.comb += [
            self.i.ready.eq(~level[-1]),
            push.eq(self.i.valid & self.i.ready),
            fetch.eq(~push & (level != 0) & (~self.o.valid | self.o.ready)),
            index.eq(Mux(push, write_index, read_index)),
        ]
        word = Value.cast(self.i.p)
        halves = []
        for half in range(2):
            write = memory.write_port()
            read = memory.read_port()
            m.d.comb += [
                write.addr.eq(Cat(index, C(half, 1))),
                write.data.eq(word[half * _WORD_BITS:(half + 1) * _WORD_BITS]),
                write.en.eq(push),
                read.addr.eq(Cat(index, C(half, 1))),
                read.en.eq(fetch),
            ]
            halves.append(read.data)
        m.d.comb += Value.cast(self.o.p).eq(Cat(halves))

        with m.If(push):
            m.d.sync += [write_index.eq(write_index + 1), level.eq(level + 1)]
        with m.If(fetch):
            m.d.sync += [read_index.eq(read_index + 1), level.eq(level - 1), self.o.valid.eq(1)]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)

        return m
