"""A register between two blocks."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import Undistorted

__all__ = ["Stage"]


class Stage(wiring.Component):
    """Holds one word, so that the block before can go on to the next while this one waits.

    A word leaves one clock after it came; one word a clock is kept up while ``o.ready`` stays
    high.

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
