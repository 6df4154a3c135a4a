"""Octets to a serial line."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

__all__ = ["UARTTransmitter"]


class UARTTransmitter(wiring.Component):
    """Sends octets over an asynchronous serial line: start bit, eight bits, stop bit.

    The least significant bit goes first. The start bit begins the clock after an octet was taken,
    and the next octet is taken in the stop bit's last clock, so that octets follow each other
    without a pause. The line is high out of reset and between octets.

    Members
    -------
    i : :py:`In(stream.Signature(8))`
        Octets.
    divisor : :py:`In(16)`
        Clocks per bit; 0 counts as 1. Sampled with each bit.
    tx : :py:`Out(1)`
        The line.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from taking an octet to its start bit.
    """

    latency = 1

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(8)),
            "divisor": In(16),
            "tx": Out(1, init=1),
        })

    def elaborate(self, platform):
        m = Module()

        bits = Signal(9, init=0x1FF)  # still to be sent; the lowest one is on the line
        follow = Signal(4)  # so many after it, the stop bit included
        idle = Signal(init=1)  # none
        # Clocks left of this bit, less one: negative in its last clock, and until there is more.
        left = Signal(signed(17), init=-1)
        last_clock = Signal()
        load = Signal()
        m.d.comb += [
            last_clock.eq(left[16]),
            self.i.ready.eq(last_clock & idle),
            load.eq(self.i.valid & self.i.ready),
            self.tx.eq(bits[0]),
        ]
        with m.If(load):
            m.d.sync += [bits.eq(Cat(C(0, 1), self.i.payload)), follow.eq(9), idle.eq(0)]
        with m.Elif(last_clock):
            m.d.sync += [bits.eq(Cat(bits[1:], C(1, 1))), idle.eq(follow[1:] == 0)]
            with m.Switch(follow):  # smaller than a subtraction
                for number in range(1, 10):
                    with m.Case(number):
                        m.d.sync += follow.eq(number - 1)
        # One adder loads `divisor - 2` and counts down. Adding y is written as subtracting ~y,
        # which adds one more: a multiplexer before a subtrahend costs nothing on a carry chain.
        with m.If(load | ~self.i.ready):
            m.d.sync += left.eq(Cat(last_clock, ~last_clock, C(-1, 15)).as_signed()
                                - ~Mux(last_clock, self.divisor, left))

        return m
