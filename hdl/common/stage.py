"""A register between two blocks."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import Undistorted

__all__ = ["Stage"]


class Stage(wiring.Component):
    """Holds one word, so that the block before can go on to the next while this one waits.

    One word a clock while ``o.ready`` stays high. Reset empties it.

    Parameters
    ----------
    shape : shape-like
        Payload.

    Members
    -------
    i : :py:`In(stream.Signature(shape))`
        Words.
    o : :py:`Out(stream.Signature(shape))`
        The same words in the same order.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a word at ``i`` to the same at ``o``.
    """

    latency = 1

    def __init__(self, shape=Undistorted):
        super().__init__({
            "i": In(stream.Signature(shape)),
            "o": Out(stream.Signature(shape)),
        })

    def elaborate(self, platform):
        m = Module()

        m.d.comb += self.i.ready.eq(~self.o.valid | self.o.ready)
        with m.If(self.i.ready):
            m.d.sync += [self.o.valid.eq(self.i.valid), self.o.payload.eq(self.i.payload)]

        return m
