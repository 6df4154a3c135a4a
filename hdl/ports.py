"""Ports that several components have in common, and how they are handed on."""

from amaranth.hdl import signed
from amaranth.lib.wiring import In, Out, connect, flipped

from .payloads import COORDINATE_BITS

__all__ = ["REGISTERS", "TABLE_PORT", "connect_ports"]

#: Registers that measuring needs, by their names in :mod:`hdl.protocol`.
REGISTERS = {
    "threshold_fixed": In(1),
    "threshold_level": In(8),
    "threshold_alpha": In(8),
    "erosion_mode": In(2),
    "weighted": In(1),
    "area_min": In(8),
    "area_max": In(8),
    "report_rejected": In(1),
    "principal_u": In(COORDINATE_BITS),
    "principal_v": In(COORDINATE_BITS),
    "tangential_1": In(signed(18)),
    "tangential_2": In(signed(18)),
    "divisor": In(16),
    "full_records": In(1),
    "texture_enable": In(1),
    "points_max": In(8),
}
#: How the host reaches the tables; numbers and words are those of :data:`hdl.protocol.TABLES`.
TABLE_PORT = {
    "bank": In(1),
    "table_write": In(1),
    "table_read": In(1),
    "table_select": In(2),
    "table_address": In(10),
    "table_data": In(72),
    "table_word": Out(72),
}


def connect_ports(m, members, outer, inner):
    """Connect ``members`` of a component to those of the same names of one inside it.

    Parameters
    ----------
    m : :class:`amaranth.hdl.Module`
        Where the statements go.
    members : :class:`dict`
        Members of a signature, as ``inner`` has them.
    outer, inner
        The two components. ``outer`` may also be a neighbour with the members turned round.
    """
    for name, member in members.items():
        mine, its = getattr(outer, name), getattr(inner, name)
        if member.is_signature:
            connect(m, flipped(mine), its)
        else:
            m.d.comb += its.eq(mine) if member.flow == In else mine.eq(its)
