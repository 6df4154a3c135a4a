"""The whole transmitting link: points, texture and replies in, the serial pin out."""

from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.frame_gate import FrameGate
from hdl.link.framer import Framer
from hdl.link.points import Points
from hdl.link.scheduler import Scheduler
from hdl.link.texture import Texture
from hdl.link.uart_tx import UARTTransmitter
from hdl.payloads import Counts, FrameInfo, FrameTag, GreyPixel, PacketOctet, Point

__all__ = ["LinkRig"]


class LinkRig(wiring.Component):
    """Joins the blocks as the chip does; texture frames come as pixels."""

    def __init__(self, width, height):
        self.size = width, height
        super().__init__({
            "pixels": In(stream.Signature(GreyPixel)),
            "tag": In(FrameTag),
            "points": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "info": In(stream.Signature(FrameInfo)),
            "replies": In(stream.Signature(PacketOctet)),
            "full_records": In(1),
            "divisor": In(16),
            "cts": In(1),
            "tx": Out(1, init=1),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.gate = gate = FrameGate()
        m.submodules.packets = points = Points()
        m.submodules.texture = texture = Texture(*self.size)
        m.submodules.scheduler = scheduler = Scheduler(3)
        m.submodules.framer = framer = Framer()
        m.submodules.uart_tx = uart_tx = UARTTransmitter()
        connect(m, flipped(self.pixels), gate.i)
        connect(m, gate.texture, texture.i)
        connect(m, gate.texture_info, texture.info)
        connect(m, flipped(self.points), points.i)
        connect(m, flipped(self.counts), points.counts)
        connect(m, flipped(self.info), points.info)
        connect(m, points.o, scheduler.i_0)
        connect(m, flipped(self.replies), scheduler.i_1)
        connect(m, texture.o, scheduler.i_2)
        connect(m, scheduler.o, framer.i)
        connect(m, framer.o, uart_tx.i)
        m.d.comb += [
            gate.o.ready.eq(1),
            gate.info.ready.eq(1),
            gate.tag.eq(self.tag),
            points.full_records.eq(self.full_records),
            texture.enable.eq(1),
            framer.divisor.eq(self.divisor),
            framer.cts.eq(self.cts),
            uart_tx.divisor.eq(self.divisor),
            self.tx.eq(uart_tx.tx),
            self.busy.eq(framer.busy | texture.busy | points.o.valid),
        ]
        return m
