"""Ports that several components have in common, and how to connect them."""

from amaranth.hdl import Signal, signed, unsigned
from amaranth.lib.wiring import In, Out, connect, flipped

from .protocol import TABLES, registers

__all__ = ["TABLE_PORT", "connect_ports", "register_ports", "register_shape", "sample_registers"]

_REGISTERS = {register.name: register for register in registers()}
_WORD_BITS = max(table.bits for table in TABLES)
#: Access to the tables for the host; numbers and words are those of :data:`hdl.protocol.TABLES`.
TABLE_PORT = {
    "bank": In(1),
    "table_write": In(1),
    "table_read": In(1),
    "table_select": In(range(len(TABLES))),
    "table_address": In(range(max(table.words for table in TABLES))),
    "table_data": In(_WORD_BITS),
    "table_word": Out(_WORD_BITS),
}


def register_shape(register):
    """Shape of a signal that holds ``register``, a :class:`hdl.protocol.Register`."""
    return signed(register.bits) if register.signed else unsigned(register.bits)


def register_ports(*names):
    """Inputs for registers, as wide and as signed as the protocol has them.

    Parameters
    ----------
    names : :class:`str`
        Names of registers in :func:`hdl.protocol.registers`.

    Returns
    -------
    :class:`dict`
        Members of a signature, by the registers' names.

    Raises
    ------
    LookupError
        If the protocol has no register of a name.
    """
    for name in names:
        if name not in _REGISTERS:
            raise LookupError(f"The protocol has no register {name!r}")
    return {name: In(register_shape(_REGISTERS[name])) for name in names}


def sample_registers(m, component, domains=None):
    """Put a flip-flop behind every register port of ``component``.

    Parameters
    ----------
    m : :class:`amaranth.hdl.Module`
        Where the statements go.
    component
        A component whose ``registers`` are those of :func:`register_ports`.
    domains : :class:`dict`
        Clock domains by the registers' names; others are in ``sync``.

    Returns
    -------
    :class:`dict`
        Sampled values by the registers' names.
    """
    sampled = {}
    for name, member in component.registers.items():
        sampled[name] = Signal(member.shape, name=name)
        m.d[(domains or {}).get(name, "sync")] += sampled[name].eq(getattr(component, name))
    return sampled


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
