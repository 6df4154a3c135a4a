"""Which frames pass, patterns and texture alike, and as what they are announced."""

__all__ = ["gate"]


def gate(room):
    """Announcements of frames that come in one after the other.

    Parameters
    ----------
    room : iterable of :class:`bool`
        For each frame, whether its announcement can be taken at its first pixel.

    Returns
    -------
    list
        For each frame None if it is skipped, otherwise its number (of all that came, modulo
        65536) and how many were skipped before it since the last that passed, at most 255.
    """
    announced, skipped = [], 0
    for number, passes in enumerate(room):
        announced.append((number & 0xFFFF, skipped) if passes else None)
        skipped = 0 if passes else min(255, skipped + 1)
    return announced
