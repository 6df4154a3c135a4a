"""Everything that goes to the reader, onto one serial line."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from ..payloads import FrameInfo, GreyPixel, PacketOctet
from ..ports import register_ports
from .framer import Framer
from .scheduler import Scheduler
from .texture import Texture
from .uart_tx import UARTTransmitter

__all__ = ["Transmitter"]


class Transmitter(wiring.Component):
    """Sends points first, then replies to the host, and texture with the rest of the line's time.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels.

    Members
    -------
    points, reply : :py:`In(stream.Signature(PacketOctet))`
        Packets.
    more : :py:`In(1)`
        Points are waiting whose packet is not complete yet: pixels wait for them.
    texture, texture_info : :py:`In(stream.Signature(GreyPixel))`, \
    :py:`In(stream.Signature(FrameInfo))`
        Texture frames as they pass, and their announcements, see :class:`.texture.Texture`.
    texture_enable, texture_bound, texture_mosaic : :py:`In(1)`, :py:`In(3)`, :py:`In(1)`
        Send texture, with so large an error, of a sensor with a colour mosaic. The last two may
        change only between texture frames.
    bad_sync, overrun : :py:`In(8)`
        The camera's counters, reported with each texture frame.
    divisor : :py:`In(16)`
        Clocks per bit.
    cts : :py:`In(1)`
        The other side can take octets.
    tx : :py:`Out(1)`
        The serial pin.
    packets : :py:`Out(16)`
        Packets sent, modulo 65,536.
    busy : :py:`Out(1)`
        A packet is on the line, or waits for it.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the last octet of a packet to its start bit, if the line is free.
    """

    registers = {**register_ports("texture_enable", "divisor"), **Texture.registers}

    latency = Scheduler.latency + Framer.latency + UARTTransmitter.latency

    def __init__(self, width, height):
        self.width, self.height = width, height
        super().__init__({
            "points": In(stream.Signature(PacketOctet)),
            "reply": In(stream.Signature(PacketOctet)),
            "more": In(1),
            "texture": In(stream.Signature(GreyPixel)),
            "texture_info": In(stream.Signature(FrameInfo)),
            "bad_sync": In(8),
            "overrun": In(8),
            **self.registers,
            "cts": In(1),
            "tx": Out(1, init=1),
            "packets": Out(16),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.texture = texture = Texture(self.width, self.height)
        m.submodules.scheduler = scheduler = Scheduler(3)
        m.submodules.framer = framer = Framer()
        m.submodules.uart_tx = uart_tx = UARTTransmitter()
        connect(m, flipped(self.texture), texture.i)
        connect(m, flipped(self.texture_info), texture.info)
        connect(m, flipped(self.points), scheduler.i_0)
        connect(m, flipped(self.reply), scheduler.i_1)
        connect(m, texture.o, scheduler.i_2)
        connect(m, scheduler.o, framer.i)
        connect(m, framer.o, uart_tx.i)
        m.d.comb += [
            # Pixels are offered when they can be sent, so that none waits before what matters more,
            # the announcement of the next texture frame among it.
            texture.enable.eq(
                self.texture_enable & framer.free & ~scheduler.o.valid & ~self.more),
            *(getattr(texture, name).eq(getattr(self, name)) for name in Texture.registers),
            texture.bad_sync.eq(self.bad_sync),
            texture.overrun.eq(self.overrun),
            framer.divisor.eq(self.divisor),
            framer.cts.eq(self.cts),
            uart_tx.divisor.eq(self.divisor),
            self.tx.eq(uart_tx.tx),
            self.packets.eq(framer.packets),
            self.busy.eq(framer.busy | scheduler.o.valid | ~uart_tx.i.ready),
        ]
        return m
