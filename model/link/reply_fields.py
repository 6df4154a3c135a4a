"""Fields of replies to octets."""

__all__ = ["field_octets"]


def field_octets(fields, values):
    """Octets of a reply's data.

    Parameters
    ----------
    fields : sequence of :class:`hdl.protocol.Field`
        In the order of sending, whole octets each.
    values : :class:`dict`
        Their values by name.
    """
    return b"".join(values[field.name].to_bytes(field.bits // 8, "little") for field in fields)
