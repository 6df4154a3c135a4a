"""Spots with their beam to points."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import BEAM_BITS, Match, Point, Status

__all__ = ["Depth"]

_FRACTION_BITS = 12


class Depth(wiring.Component):
    """Computes the inverse depth of the spots whose beam is known.

    The inverse depth is ``(alpha * x + beta + 2**11) >> 12`` with the beam's alpha and beta. A
    spot whose inverse depth is below 1 or above ``2**18 - 1`` becomes rejected. Spots of any other
    status than ok, and end markers, pass unchanged, in the same time.

    A spot waits at ``i`` until its point is taken at ``o``, so a spot takes ``latency + 1`` clocks
    or more. Reset discards the spot under way.

    Paper, section on the 3-D unit: the depth block, identical to the estimation block; here one
    multiplier and one adder for all beams, beta first.

    Members
    -------
    i : :py:`In(stream.Signature(Match))`
        Spots and end markers.
    o : :py:`Out(stream.Signature(Point))`
        The same, in the same order.
    table_address : :py:`Out(10)`
        Word to be read: ``2 * beam`` for alpha (signed 18 bits, Q5.12), ``2 * beam + 1`` for
        beta (signed 36 bits, 12 fraction bits).
    table_data : :py:`In(36)`
        That word, one clock later.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a spot at ``i`` to its point at ``o``.
    """

    latency = 5

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Match)),
            "o": Out(stream.Signature(Point)),
            "table_address": Out(1 + BEAM_BITS),
            "table_data": In(36),
        })

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p

        # Starts at one half, takes beta, then the product. Adding y is written as subtracting ~y,
        # which adds one more: a multiplexer before a subtrahend costs nothing on a carry chain,
        # before an addend it may. Spots that have no depth are set back to the start before they
        # are shown, and so read zero.
        start = (1 << (_FRACTION_BITS - 1)) - 2
        total = Signal(signed(37), init=start)
        addend = Signal(signed(37))
        integer = total[_FRACTION_BITS:]

        # One-hot: beta is there, alpha is there, the total is there, it is checked.
        step = Signal(4)
        takes = Signal()
        m.d.comb += [
            self.table_address.eq(Cat(~step[0], spot.beam)),
            addend.eq(Mux(step[0], self.table_data.as_signed(),
                          self.table_data[:18].as_signed() * spot.x)),
            takes.eq(self.o.valid & self.o.ready),
        ]
        m.d.sync += step.eq(Cat(self.i.valid & ~step.any() & ~self.o.valid, step[:3]))

        # The check of the range gets a clock for its parts and one for the whole.
        zero = Signal(5)
        above = Signal(2)
        ok = Signal()
        far = Signal()
        m.d.sync += [
            *(zero[n].eq(integer[4 * n:min(4 * n + 4, 18)] == 0) for n in range(5)),
            *(above[n].eq(integer[18 + 4 * n:22 + 4 * n] != 0) for n in range(2)),
        ]
        m.d.comb += [
            ok.eq(~spot.end & (spot.status == Status.OK)),
            far.eq(zero.all() | above.any()),
        ]

        failed = Signal()
        with m.If(step[0] | step[1]):
            m.d.sync += total.eq(total - ~addend)
        with m.If(takes | (step[3] & (~ok | far))):
            m.d.sync += total.eq(start)
        with m.If(step[3]):
            m.d.sync += [self.o.valid.eq(1), failed.eq(ok & far)]
        with m.If(takes):
            m.d.sync += self.o.valid.eq(0)

        m.d.comb += [
            self.i.ready.eq(takes),
            self.o.p.end.eq(spot.end),
            self.o.p.status.eq(Mux(failed, Status.REJECTED, spot.status)),
            self.o.p.beam.eq(Mux(failed, 0, spot.beam)),
            self.o.p.area.eq(spot.area),
            self.o.p.saturated.eq(spot.saturated),
            self.o.p.border.eq(spot.border),
            self.o.p.u.eq(spot.u),
            self.o.p.v.eq(spot.v),
            self.o.p.inverse_z.eq(integer),
        ]
        return m
