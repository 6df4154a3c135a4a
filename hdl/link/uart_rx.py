"""A serial line to octets."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

__all__ = ["UARTReceiver"]


class UARTReceiver(wiring.Component):
    """Receives octets from an asynchronous serial line: start bit, eight bits, stop bit.

    The line passes two flip-flops and a filter, the majority of its last three levels, which
    removes glitches of one clock. A start bit counts if the line is still low in its middle.
    Bits are sampled in their middles, counted from the falling edge of the start bit, and the next
    start bit may come from the middle of the stop bit on: with a divisor of 12 or more the baud
    rates may differ by 3 %, with 4 or more by 1 %, with 2 or 3 not at all.

    An octet is at ``o`` for one clock, :attr:`latency` clocks after the middle of its stop bit; it
    cannot wait. A character without a stop bit gives a pulse of ``framing`` and no octet, and the
    next start bit counts once the line has been high: a break is one character. Reset discards
    the character in progress.

    Members
    -------
    rx : :py:`In(1)`
        The line.
    divisor : :py:`In(16)`
        Clocks per bit, 2 or more. Sampled with each bit.
    o : :py:`Out(stream.Signature(8, always_ready=True))`
        Octets.
    framing : :py:`Out(1)`
        High for a clock: a character had no stop bit.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the middle of the stop bit at ``rx`` to its octet: 4.
    """

    latency = 4

    def __init__(self):
        super().__init__({
            "rx": In(1, init=1),
            "divisor": In(16),
            "o": Out(stream.Signature(8, always_ready=True)),
            "framing": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        line = Signal(init=1)
        m.submodules.synchroniser = FFSynchronizer(self.rx, line, init=1)
        before = Signal(2, init=3)
        level = Signal()
        m.d.sync += before.eq(Cat(line, before[0]))
        m.d.comb += level.eq((line & before[0]) | (line & before[1]) | before.all())

        # A one runs ahead of the bits that are shifted in: it is the lowest bit when the stop bit
        # is due.
        bits = Signal(9)
        idle = Signal(init=1)
        starting = Signal()
        broken = Signal()
        # Clocks left until the next bit's middle, less two: negative in that clock.
        left = Signal(signed(17))
        due = Signal()
        m.d.comb += due.eq(left[16] & ~idle)
        wait = Signal(17)
        m.d.comb += wait.eq(Mux(idle, self.divisor[1:], Mux(left[16], self.divisor, left)))
        # Subtracting ~y adds y + 1: one carry chain loads and counts.
        m.d.sync += left.eq(Cat(idle | left[16], ~(idle | left[16]), C(-1, 15)).as_signed()
                            - ~wait)

        m.d.sync += [self.o.valid.eq(0), self.framing.eq(0)]
        m.d.comb += self.o.payload.eq(bits[1:])
        with m.If(idle):
            with m.If(level):
                m.d.sync += broken.eq(0)
            with m.Elif(~broken):
                m.d.sync += [idle.eq(0), starting.eq(1), bits.eq(1 << 8)]
        with m.Elif(due):
            m.d.sync += starting.eq(0)
            with m.If(starting):
                m.d.sync += idle.eq(level)
            with m.Elif(bits[0]):
                m.d.sync += [
                    idle.eq(1), self.o.valid.eq(level), self.framing.eq(~level), broken.eq(~level)]
            with m.Else():
                m.d.sync += bits.eq(Cat(bits[1:], level))
        return m
