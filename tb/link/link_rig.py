"""The whole transmitting link: points, texture and replies in, the serial pin out."""

from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.frame_gate import FrameGate
from hdl.link.points import Points
from hdl.link.transmitter import Transmitter
from hdl.payloads import Counts, Detection, FrameInfo, FrameTag, GreyPixel, PacketOctet, Point

__all__ = ["LinkRig"]


class LinkRig(wiring.Component):
    """Joins the blocks as the chip does; texture frames come as pixels. ``more``: points will come,
    though none is there yet."""

    def __init__(self, width, height):
        self.size = width, height
        super().__init__({
            "pixels": In(stream.Signature(GreyPixel)),
            "tag": In(FrameTag),
            "points": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "detection": In(stream.Signature(Detection)),
            "info": In(stream.Signature(FrameInfo)),
            "replies": In(stream.Signature(PacketOctet)),
            "more": In(1),
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
        m.submodules.transmitter = transmitter = Transmitter(*self.size)
        connect(m, flipped(self.pixels), gate.i)
        connect(m, gate.texture, transmitter.texture)
        connect(m, gate.texture_info, transmitter.texture_info)
        connect(m, flipped(self.points), points.i)
        connect(m, flipped(self.counts), points.counts)
        connect(m, flipped(self.detection), points.detection)
        connect(m, flipped(self.info), points.info)
        connect(m, points.o, transmitter.points)
        connect(m, flipped(self.replies), transmitter.reply)
        m.d.comb += [
            gate.o.ready.eq(1),
            gate.info.ready.eq(1),
            gate.tag.eq(self.tag),
            gate.pattern_every.eq(1),
            points.full_records.eq(self.full_records),
            transmitter.texture_enable.eq(1),
            transmitter.more.eq(self.points.valid | self.more),
            transmitter.divisor.eq(self.divisor),
            transmitter.cts.eq(self.cts),
            self.tx.eq(transmitter.tx),
            self.busy.eq(transmitter.busy | points.o.valid),
        ]
        return m
