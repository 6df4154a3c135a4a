"""Octets from the host to whole packets that passed their check."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.crc import catalog
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.protocol import CONTENT_LIMIT

__all__ = ["CRC", "Receiver", "SHORTEST"]

CRC = catalog.CRC32_ISO_HDLC
_CRC_OCTETS = 4
#: Octets of the shortest packet's content: a command and a tag.
SHORTEST = 2


class Receiver(wiring.Component):
    """Undoes COBS between delimiters (00), checks the CRC-32, and keeps the packet.

    ``o`` becomes valid two clocks after a packet's closing delimiter arrived, with the length of
    its content without the check; the content is then in a buffer that ``address`` reads. Until
    ``o`` is taken the buffer belongs to its reader, who may also write it, and octets from the host
    are lost: the packet that they belong to is damaged.

    ``damaged`` reports, two clocks after the delimiter that ends it, a packet with a wrong check,
    with a COBS code that points beyond its end, with a content (check included) of more than
    :data:`hdl.protocol.CONTENT_LIMIT` octets or of less than :data:`SHORTEST` and a check, or with
    lost octets. Nothing between two delimiters is not a packet. After any damage the next
    delimiter starts anew.

    Members
    -------
    i : :py:`In(stream.Signature(8, always_ready=True))`
        Octets from the line, nine clocks or more from one to the next.
    o : :py:`Out(stream.Signature(7))`
        Length of a packet that may be read.
    damaged : :py:`Out(1)`
        High for a clock: a damaged packet ended.
    address : :py:`In(7)`
        Octet of the buffer.
    data : :py:`Out(8)`
        That octet, one clock later.
    write_enable, write_data : :py:`In(1)`, :py:`In(8)`
        Write an octet at ``address``; only while ``o`` is valid.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a packet's closing delimiter at ``i`` to its length at ``o``.
    """

    latency = 2

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(8, always_ready=True)),
            "o": Out(stream.Signature(7)),
            "damaged": Out(1),
            "address": In(7),
            "data": Out(8),
            "write_enable": In(1),
            "write_data": In(8),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.check = crc = CRC(data_width=1).create()
        m.submodules.octets = octets = Memory(shape=8, depth=128, init=[])
        write, read = octets.write_port(), octets.read_port()

        held = self.o.valid
        octet = self.i.payload
        empty = Signal(init=1)
        spoilt = Signal()
        left = Signal(7)  # octets until the next code
        count = Signal(7)  # octets of the content
        is_code = Signal(init=1)
        delimiter = Signal()
        store = Signal()
        full = Signal()
        # Octets come so far apart that their control signals may be a clock late.
        m.d.sync += [
            full.eq(count == CONTENT_LIMIT),
            is_code.eq(left == 0),
        ]
        m.d.comb += [
            delimiter.eq(self.i.valid & (octet == 0)),
            store.eq(self.i.valid & (octet != 0) & ~(is_code & empty)),
        ]

        # A code stands for the zero before it, except for a packet's first one.
        plain = Signal(8)
        m.d.comb += plain.eq(Mux(is_code, 0, octet))
        with m.If(self.i.valid):
            m.d.sync += [
                empty.eq(delimiter),
                left.eq(Mux(is_code, octet, left) - 1),
            ]
            with m.If(~delimiter & (held | full | (is_code & octet[7]))):
                m.d.sync += spoilt.eq(1)
            with m.If(delimiter):
                m.d.sync += left.eq(0)
        with m.If(store & ~full):
            m.d.sync += count.eq(count + 1)

        bits = Signal(8)
        shifting = Signal(4)  # bits to go
        m.d.comb += [
            crc.valid.eq(shifting != 0),
            crc.data.eq(bits[0]),
        ]
        with m.If(store):
            m.d.sync += [bits.eq(plain), shifting.eq(8)]
        with m.Elif(shifting != 0):
            m.d.sync += [bits.eq(bits[1:]), shifting.eq(shifting - 1)]

        # Between the delimiter and the next octet there is time to look at what came.
        ended = Signal()
        whole = Signal()
        m.d.sync += [
            ended.eq(delimiter & ~empty),
            whole.eq(is_code & ~spoilt & (count >= SHORTEST + _CRC_OCTETS)),
            self.damaged.eq(0),
        ]
        with m.If(ended):
            m.d.comb += crc.start.eq(1)
            m.d.sync += [spoilt.eq(0), count.eq(0)]
            with m.If(whole & crc.match_detected):
                m.d.sync += [self.o.valid.eq(1), self.o.payload.eq(count - _CRC_OCTETS)]
            with m.Else():
                m.d.sync += self.damaged.eq(1)
        with m.If(held & self.o.ready):
            m.d.sync += self.o.valid.eq(0)

        m.d.comb += [
            write.addr.eq(Mux(held, self.address, count)),
            write.data.eq(Mux(held, self.write_data, plain)),
            write.en.eq(Mux(held, self.write_enable, store)),
            read.addr.eq(self.address),
            read.en.eq(1),
            self.data.eq(read.data),
        ]
        return m
