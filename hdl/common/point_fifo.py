"""A FIFO for points, in block RAM with one write port and one read port."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import Point

__all__ = ["PointFIFO"]

#: A point takes three words.
_PARTS = 3
_WORD_BITS = -(-Point.as_shape().size // _PARTS)
#: Words of a block RAM.
_BLOCK_WORDS = 512


class PointFIFO(wiring.Component):
    """Queues points, one word of the memory after the other.

    A point is taken with its third word, and given after its three words were read. While the
    memory is full, ``i`` stalls; nothing is lost. Reset empties it.

    Parameters
    ----------
    blocks : :class:`int`
        Block RAMs of 512 words: one holds 170 points, two hold 341.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end markers, one in three clocks.
    o : :py:`Out(stream.Signature(Point))`
        The same, in the same order, one in four clocks.

    Attributes
    ----------
    depth : :class:`int`
        Points that it holds, the one at ``o`` included.
    latency : :class:`int`
        Clocks from a point at ``i`` to the same at ``o``, if it is empty.
    """

    latency = 6

    def __init__(self, blocks=1):
        if not isinstance(blocks, int) or blocks < 1:
            raise ValueError(f"Blocks must be a positive integer, not {blocks!r}")
        self.slots = blocks * _BLOCK_WORDS // _PARTS
        self.depth = self.slots + 1
        super().__init__({
            "i": In(stream.Signature(Point)),
            "o": Out(stream.Signature(Point)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.points = memory = Memory(
            shape=_WORD_BITS, depth=_PARTS * self.slots, init=[])
        write, read = memory.write_port(), memory.read_port()

        # `level` counts the whole points in the memory; part n of all of them stands together.
        level = Signal(range(self.slots + 1))
        write_index = Signal(range(self.slots))
        write_part = Signal(range(_PARTS))
        read_index = Signal(range(self.slots))
        read_part = Signal(range(_PARTS))
        room = Signal()
        push = Signal()
        reading = Signal()
        fetch = Signal()
        word = Value.cast(self.i.p)
        got = Signal(_WORD_BITS)
        kept = [Signal(_WORD_BITS, name=f"kept_{n}") for n in range(_PARTS - 1)]
        m.d.comb += [
            room.eq(level != self.slots),
            self.i.ready.eq(room & (write_part == _PARTS - 1)),
            push.eq(self.i.valid & self.i.ready),
            reading.eq((level != 0) & ~self.o.valid),
            fetch.eq(reading & (read_part == _PARTS - 1)),
            write.addr.eq(write_index + self._base(write_part)),
            write.data.eq(word.word_select(write_part, _WORD_BITS)),
            write.en.eq(self.i.valid & room),
            read.addr.eq(read_index + self._base(read_part)),
            read.en.eq(reading),
            Value.cast(self.o.p).eq(Cat(*kept, got)),
            got.eq(read.data),
        ]
        with m.If(write.en):
            m.d.sync += write_part.eq(Mux(push, 0, write_part + 1))
        with m.If(push):
            m.d.sync += write_index.eq(self._next(write_index))
        with m.If(reading):
            m.d.sync += read_part.eq(Mux(fetch, 0, read_part + 1))
        for n, part in enumerate(kept):
            with m.If(reading & (read_part == n + 1)):
                m.d.sync += part.eq(got)
        with m.If(fetch):
            m.d.sync += [read_index.eq(self._next(read_index)), self.o.valid.eq(1)]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        m.d.sync += level.eq(level + push - fetch)
        return m

    def _base(self, part):
        """Where a part of all points begins in the memory."""
        return Mux(part == 0, 0, Mux(part == 1, self.slots, 2 * self.slots))

    def _next(self, index):
        return Mux(index == self.slots - 1, 0, index + 1)
