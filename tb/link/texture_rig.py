"""The texture block behind the frame gate that feeds it."""

from amaranth.hdl import ClockDomain, ClockSignal, EnableInserter, Module, ResetSignal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.frame_gate import FrameGate
from hdl.link.texture import Texture
from hdl.payloads import FrameTag, GreyPixel, PacketOctet

__all__ = ["TextureRig"]


class TextureRig(wiring.Component):
    """Frames to packets; with ``clock_gated`` the clock of the sending side stands while it may."""

    def __init__(self, width, height, clock_gated=False):
        self.size, self.clock_gated = (width, height), clock_gated
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "tag": In(FrameTag),
            "tripped": In(1),
            "tables_valid": In(1),
            **Texture.registers,
            "enable": In(1),
            "bad_sync": In(8),
            "overrun": In(8),
            "o": Out(stream.Signature(PacketOctet)),
            "busy": Out(1),
            "stopped": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.gate = gate = FrameGate()
        texture = Texture(*self.size, domain="link" if self.clock_gated else "sync")
        if self.clock_gated:
            m.domains.link = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("link").eq(ClockSignal()), ResetSignal("link").eq(ResetSignal())]
            m.submodules.texture = EnableInserter({"link": texture.busy})(texture)
        else:
            m.submodules.texture = texture
        connect(m, flipped(self.i), gate.i)
        connect(m, gate.texture, texture.i)
        connect(m, gate.texture_info, texture.info)
        connect(m, texture.o, flipped(self.o))
        m.d.comb += [
            gate.o.ready.eq(1),
            gate.info.ready.eq(1),
            gate.tag.eq(self.tag),
            gate.pattern_every.eq(1),
            gate.tripped.eq(self.tripped),
            gate.tables_valid.eq(self.tables_valid),
            *(getattr(texture, name).eq(getattr(self, name)) for name in Texture.registers),
            texture.enable.eq(self.enable),
            texture.bad_sync.eq(self.bad_sync),
            texture.overrun.eq(self.overrun),
            self.busy.eq(texture.busy),
            self.stopped.eq(~texture.busy if self.clock_gated else 0),
        ]
        return m
