"""Packets to the octets on the line."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.crc import catalog
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import PacketOctet
from ..protocol import CONTENT_LIMIT, GAP_CHARACTERS

__all__ = ["Framer"]

_CHECK_OCTETS = 4
_BANK = 128
_CHARACTER = 10  # bits, start and stop included
assert CONTENT_LIMIT < _BANK


class Framer(wiring.Component):
    """Numbers packets, adds their check, and sends them in frames with pauses between.

    On the line a packet is 00, COBS (Cheshire and Baker, 1999) of kind, sequence number, body and
    CRC-32/ISO-HDLC (low octet first), 00. A packet is assembled in one half of a memory while the
    other half is sent: 9 clocks an octet, the sequence number and the check likewise, and 2 more
    for the packet. Assembly begins only when a half is free, and is as fast as octets come. The
    sequence number counts packets, from 0 after reset.

    Sending starts when the packet is whole. Octets are offered at the pace of
    :class:`hdl.link.uart_tx.UARTTransmitter`, each in the clock in which that can take it, so that
    they follow each other without a pause. After a packet's last stop bit the line is idle for at
    least three character times. No octet is offered in a clock in which ``cts`` is low, so that an
    octet already on the line is the last one after ``cts`` falls. Reset discards all packets.

    Members
    -------
    i : :py:`In(stream.Signature(PacketOctet))`
        Packets of a kind and at most 91 octets of body.
    o : :py:`Out(stream.Signature(8))`
        Octets to the serial line.
    divisor : :py:`In(16)`
        Clocks per bit; 0 counts as 1. The transmitter's, sampled with each bit as there.
    cts : :py:`In(1)`
        The other side can take octets; synchronous to the clock.
    packets : :py:`Out(16)`
        Packets taken, modulo 65,536.
    free : :py:`Out(1)`
        A packet that is offered in this clock is taken at once.
    busy : :py:`Out(1)`
        A packet is being sent, or the pause after it is not over: the clock is needed.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a packet's last octet at ``i`` to its first one at ``o``, if the line is free. A
        packet of a kind alone takes 9 more.
    """

    latency = 39

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(PacketOctet)),
            "o": Out(stream.Signature(8)),
            "divisor": In(16),
            "cts": In(1),
            "packets": Out(16),
            "free": Out(1),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        # The ninth bit marks a packet's last octet.
        m.submodules.memory = memory = Memory(shape=9, depth=2 * _BANK, init=[])
        full = Signal(2)  # halves that hold a whole packet
        assembling = self._assemble(m, memory.write_port(), full)
        due = self._send(m, memory.read_port(), full)
        m.d.comb += self.busy.eq(full.any() | ~due | assembling | self.i.valid)
        return m

    def _assemble(self, m, write, full):
        """Packets into the memory; high between a packet's kind and its end.

        An octet is shifted in a bit a clock, as the check is. A zero is not written: its position
        gets the distance to the next one, once that is known.
        """
        m.submodules.crc = crc = catalog.CRC32_ISO_HDLC(data_width=1).create()
        write_half = Signal()
        octet, bit_number = Signal(8), Signal(3)
        position, zero_position = Signal(range(_BANK), init=1), Signal(range(_BANK))
        kind, number, checking = Signal(init=1), Signal(), Signal()
        last, check_left = Signal(), Signal(range(_CHECK_OCTETS), init=_CHECK_OCTETS - 1)
        shift, bit, to_zero, ending = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [
            bit.eq(Mux(checking, crc.crc[0], Mux(number, self.packets[:8], self.i.p.data)
                       .bit_select(bit_number, 1))),
            # A CRC that is fed with what it gives, inverted, shifts out unchanged.
            crc.valid.eq(shift),
            crc.data.eq(bit ^ checking),
            to_zero.eq((octet == 0) | ending),
            write.addr.eq(Cat(Mux(to_zero, zero_position, position), write_half)),
            write.data[:8].eq(Mux(to_zero, position - zero_position, octet)),
        ]
        with m.If(shift):
            m.d.sync += [octet.eq(Cat(octet[1:], bit)), bit_number.eq(bit_number + 1)]

        with m.FSM(name="assembly"):
            with m.State("SHIFT"):
                m.d.comb += [
                    self.free.eq(~number & ~checking & ~full.bit_select(write_half, 1)),
                    shift.eq((number | checking | self.i.valid)
                             & ~full.bit_select(write_half, 1)),
                    self.i.ready.eq(shift & ~number & ~checking & bit_number.all()),
                ]
                with m.If(self.i.ready):
                    m.d.sync += last.eq(self.i.p.last)
                with m.If(shift & bit_number.all()):
                    m.next = "STORE"

            with m.State("STORE"):
                m.d.comb += [write.en.eq(1), write.data[8].eq(checking & (check_left == 0))]
                with m.If(to_zero):
                    m.d.comb += write.data[8].eq(0)
                    m.d.sync += zero_position.eq(position)
                m.d.sync += [
                    position.eq(position + 1), kind.eq(0), number.eq(kind),
                    checking.eq(last & ~kind)]
                m.next = "SHIFT"
                with m.If(checking):
                    m.d.sync += check_left.eq(check_left - 1)
                    with m.If(check_left == 0):
                        m.next = "END"

            with m.State("END"):
                m.d.comb += [
                    ending.eq(1), write.en.eq(1), write.data[8].eq(octet == 0), crc.start.eq(1)]
                m.d.sync += [
                    full.bit_select(write_half, 1).eq(1), write_half.eq(~write_half),
                    self.packets.eq(self.packets + 1),
                    position.eq(1), zero_position.eq(0), kind.eq(1), checking.eq(0),
                ]
                m.next = "SHIFT"
        return ~kind

    def _send(self, m, read, full):
        """Packets from the memory; high when an octet may be taken."""
        # Bit times in step with the transmitter's: `left` is one less than the clocks left of this
        # bit, negative in its last one.
        left = Signal(signed(17), init=-1)
        bits = Signal(range(_CHARACTER * (1 + GAP_CHARACTERS)))
        due = Signal()
        offered = Signal()
        waiting = Signal()
        taken = Signal()
        m.d.comb += [
            due.eq(left[16] & (bits == 0)),
            self.o.valid.eq(waiting & due & (self.cts | offered)),
            taken.eq(self.o.valid & self.o.ready),
        ]
        m.d.sync += offered.eq(self.o.valid & ~self.o.ready)
        with m.If(taken | ~due):
            # One adder loads `divisor - 2` and counts down; adding y is subtracting ~y, less one.
            m.d.sync += left.eq(Cat(left[16], ~left[16], C(-1, 15)).as_signed()
                                - ~Mux(left[16], self.divisor, left))
        with m.If(taken):
            m.d.sync += bits.eq(_CHARACTER - 1)
        with m.Elif(left[16] & ~due):
            m.d.sync += bits.eq(bits - 1)

        read_half = Signal()
        read_position = Signal(range(_BANK))
        m.d.comb += [read.addr.eq(Cat(read_position, read_half)), waiting.eq(1)]
        with m.FSM(name="sending"):
            with m.State("OPEN"):
                m.d.comb += waiting.eq(full.bit_select(read_half, 1))
                with m.If(taken):
                    m.next = "DATA"

            with m.State("DATA"):
                m.d.comb += self.o.payload.eq(read.data)
                with m.If(taken):
                    m.d.sync += read_position.eq(read_position + 1)
                    with m.If(read.data[8]):
                        m.next = "CLOSE"

            with m.State("CLOSE"), m.If(taken):
                m.d.sync += [
                    full.bit_select(read_half, 1).eq(0), read_half.eq(~read_half),
                    read_position.eq(0), bits.eq(_CHARACTER * (1 + GAP_CHARACTERS) - 1),
                ]
                m.next = "OPEN"
        return due
