"""What the serial receiver receives: levels of a line to octets."""

import numpy as np

__all__ = ["LATENCY", "receive"]

#: Clocks from the middle of a stop bit to its octet.
LATENCY = 4


def receive(levels, divisor):
    """Octets on a line, which was high before, as ``hdl/link/uart_rx.py`` receives them.

    Parameters
    ----------
    levels : sequence of 0 and 1
        Level in every clock.
    divisor : :class:`int`
        Clocks per bit.

    Returns
    -------
    list of (clock, octet)
        None in the place of an octet is a character without a stop bit. Clocks are those in which
        the block reports, if its flip-flops see the first level in clock 0.
    """
    line = np.concatenate([[1, 1], np.asarray(levels, dtype=np.int64)])
    level = (line[:-2] + line[1:-1] + line[2:] >= 2).astype(int)  # an edge comes a clock late
    received, at, usable = [], 0, True
    while at < len(level):
        if level[at] or not usable:
            usable = usable or bool(level[at])
            at += 1
            continue
        middles = at + max(divisor // 2, 1) + divisor * np.arange(10)
        if middles[0] < len(level) and level[middles[0]]:
            at = middles[0] + 1  # too short for a start bit
            continue
        if middles[9] >= len(level):
            break
        bits = level[middles]
        usable = bool(bits[9])
        octet = int(sum(bit << place for place, bit in enumerate(bits[1:9])))
        received.append((int(middles[9]) - 1 + LATENCY, octet if usable else None))
        at = middles[9] + 1
    return received
