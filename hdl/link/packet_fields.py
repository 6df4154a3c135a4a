"""Fields of packets, in the order of the protocol."""

from amaranth.hdl import C, Cat, Value

from ..protocol import Flag

__all__ = ["bits_of_fields", "flags_octet"]


def bits_of_fields(fields, values, widths=None):
    """Values of fields, the first one in the lowest bits.

    Parameters
    ----------
    fields : sequence of :class:`hdl.protocol.Field`
        Fields of a packet.
    values : :class:`dict`
        A value for each of them, by name, of at most its width.
    widths : :class:`dict`
        Bits of fields that are not as wide as the protocol has them, by name.

    Raises
    ------
    ValueError
        If a value is wider than its field.
    """
    parts = []
    for field in fields:
        width = (widths or {}).get(field.name, field.bits)
        value = Value.cast(values[field.name])
        if len(value) > width:
            raise ValueError(f"The field {field.name!r} has {width} bits, not {len(value)}")
        parts += [value, C(0, width - len(value))]
    return Cat(*parts)


def flags_octet(**flags):
    """The octet ``flags``: those given by their names in small letters, all others zero.

    Raises
    ------
    LookupError
        If the protocol has no flag of a name.
    """
    names = [flag.name.lower() for flag in sorted(Flag)]
    for name in flags:
        if name not in names:
            raise LookupError(f"The protocol has no flag {name!r}")
    return Cat(flags.get(name, C(0, 1)) for name in names)
