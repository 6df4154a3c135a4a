# amaranth: UnusedElaboratable=no
from amaranth.hdl import (
    ClockDomain,
    ClockSignal,
    Const,
    EnableInserter,
    Module,
    ResetSignal,
    Value,
)
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from hdl.config import Config
from hdl.link.point_link import PointLink
from hdl.ports import connect_ports
from tb.hdlsim import run

_CONFIG = Config(width=32, height=24)
_OTHERS = {"i", "reply", "texture", "texture_info"}


class Pair(wiring.Component):
    """The link, and beside it one whose spot clock stands still while it is not busy.

    ``differs``: they do not do the same in this clock.
    """

    def __init__(self):
        self.plain, self.gated = PointLink(_CONFIG), PointLink(_CONFIG)
        super().__init__({**self.plain.signature.members, "differs": Out(1)})

    def elaborate(self, platform):
        m = Module()
        m.domains.spot = ClockDomain(local=True)
        m.d.comb += [
            ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]
        plain, gated = self.plain, self.gated
        m.submodules.plain = plain
        m.submodules.gated = EnableInserter({"spot": gated.busy})(gated)
        connect_ports(m, plain.signature.members, self, plain)
        differs = Const(0)
        for (_, member, one), (_, _, other) in zip(
                plain.signature.flatten(plain), gated.signature.flatten(gated), strict=True):
            one, other = Value.cast(one), Value.cast(other)
            if member.flow == Out:
                differs |= one != other
            elif not isinstance(other, Const):  # a ready that is always high
                m.d.comb += other.eq(one)
        m.d.comb += self.differs.eq(differs)
        return m


def test_point_link(request):
    streams = [name for name, member in PointLink(_CONFIG).signature.members.items()
               if member.is_signature and member.flow == wiring.In and name not in _OTHERS]
    assert {"counts", "frames"} <= set(streams)
    run(request, "point_link", "tb.link.tb_point_link", component=Pair(),
        parameters={"of_a_frame": streams})
