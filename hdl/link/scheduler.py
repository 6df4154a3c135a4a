"""Whole packets of several sources, one after the other."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import PacketOctet

__all__ = ["Scheduler"]


class Scheduler(wiring.Component):
    """Passes whole packets, those of the source with the highest priority first.

    A source is selected once for a packet, until its ``last`` octet. This happens at least 16
    clocks after the previous octet: the framer needs longer for a check, and a source that has
    another packet within that time keeps its priority. Octets pass without a clock between.

    Parameters
    ----------
    sources : :class:`int`
        Number of sources, 1 to 8.

    Members
    -------
    i_0, i_1, ... : :py:`In(stream.Signature(PacketOctet))`
        Packets, in falling priority.
    o : :py:`Out(stream.Signature(PacketOctet))`
        The packets selected.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from an octet of the selected packet to the same at ``o``.
    """

    latency = 0

    def __init__(self, sources=3):
        if not isinstance(sources, int) or not 1 <= sources <= 8:
            raise ValueError(f"Sources must be an integer from 1 to 8, not {sources!r}")
        self.sources = sources
        super().__init__({
            **{f"i_{n}": In(stream.Signature(PacketOctet)) for n in range(sources)},
            "o": Out(stream.Signature(PacketOctet)),
        })

    def elaborate(self, platform):
        m = Module()
        inputs = [getattr(self, f"i_{n}") for n in range(self.sources)]
        selected = Signal(self.sources)  # one hot; none between packets
        rest = Signal(range(17), init=16)  # its top bit is high when the clocks are over

        for n, each in enumerate(inputs):
            with m.If(selected[n]):
                m.d.comb += [
                    self.o.valid.eq(each.valid),
                    self.o.payload.eq(each.payload),
                    each.ready.eq(self.o.ready),
                ]
        with m.If(~rest[-1]):
            m.d.sync += rest.eq(rest + 1)
        with m.Elif(~selected.any()):
            before = C(0, 1)
            for n, each in enumerate(inputs):
                m.d.sync += selected[n].eq(each.valid & ~before)
                before = before | each.valid
        with m.If(self.o.valid & self.o.ready & self.o.p.last):
            m.d.sync += [selected.eq(0), rest.eq(0)]
        return m
