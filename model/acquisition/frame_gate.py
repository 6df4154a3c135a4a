"""Which frames pass, patterns and texture alike, and as what they are announced."""

__all__ = ["LEFT_OUT", "gate"]

#: In place of the announcement of a pattern frame that the host did not ask for.
LEFT_OUT = ()


def gate(room, patterns=(), every=()):
    """Announcements of frames that come in one after the other.

    Parameters
    ----------
    room : sequence of :class:`bool`
        For each frame, whether its announcement can be taken at its first pixel.
    patterns : sequence of :class:`bool`
        For each frame, whether it is a pattern and not texture; all are if there are none.
    every : sequence of :class:`int`
        For each frame, which share of the patterns is to pass: one in so many, 0 as 1.

    Returns
    -------
    list
        For each frame None if it is skipped, LEFT_OUT, or its number (of all that came,
        modulo 65536) and how many were skipped before it since the last that passed, at most 255.
    """
    announced, skipped, wait = [], 0, 0
    for number, passes in enumerate(room):
        pattern = not len(patterns) or patterns[number]
        share = every[number] if len(every) else 1
        # `wait` counts the patterns since the last that passed; none is left out before the first.
        if pattern and 0 < wait < share:
            wait += 1
            announced.append(LEFT_OUT)
        elif not passes:
            skipped = min(255, skipped + 1)
            announced.append(None)
        else:
            announced.append((number & 0xFFFF, skipped))
            skipped = 0
            wait = 1 if pattern else wait
    return announced
