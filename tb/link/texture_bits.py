"""Texture as bits in a string: slow and plain, from the packets' description alone."""

__all__ = ["bits_of_rows", "head", "packets_of_row"]


def head(number, row, column, bound=0, mosaic=False):
    """A packet's first four octets."""
    word = f"{int(mosaic):02b}{bound // 2:02b}{column:010b}{row:010b}{number & 0xFF:08b}"
    return int(word, 2).to_bytes(4, "little")


def _number(value, bits):
    """The lowest bit first."""
    return "".join(str(value >> place & 1) for place in range(bits))


def _code(zeros, rest=""):
    return "0" * zeros + "1" + rest


def bits_of_rows(rows, mosaic=False):
    """Codes of steps in a list of lists; a row's end stands before every list but the first.

    Returns
    -------
    list of :class:`str`
        A code for each pixel and each end, "" where it is part of the next one.
    """
    codes, seen, mean4, pending = [], [], 8, ""
    for place, row in enumerate(rows):
        if place:
            codes.append(_code(7, (pending or "0") if mean4 < 8 else ""))
            pending = ""
        for value in row:
            if len(seen) < 1 + mosaic:
                codes.append(_code(0, _number(value, 8)))
                seen.append(value)
                continue
            step = value - seen[-1 - mosaic]
            seen.append(value)
            size = 2 * step if step >= 0 else -2 * step - 1
            low = 0
            while mean4 // 8 >= 2 ** low:
                low += 1
            in_runs = mean4 < 8
            mean4 += size - mean4 // 4
            if in_runs and size == 0 and not pending:
                pending = "1"
                codes.append("")
                continue
            if in_runs and size == 0:
                codes.append("1")
            elif size // 2 ** low >= 6:
                codes.append(_code(6, _number(value, 8) + ((pending or "0") if in_runs else "")))
            elif in_runs:
                codes.append(_code(size, pending or "0"))
            else:
                codes.append(_code(size // 2 ** low, _number(size % 2 ** low, low)))
            pending = ""
    codes += [_code(7, pending)] if pending else []
    return codes


def packets_of_row(number, row, column, pixels):
    """Bodies of packets that carry a piece of a row without loss."""
    bodies, pixels = [], list(pixels)
    while pixels:
        count = len(pixels)
        while len(bits := "".join(bits_of_rows([pixels[:count]]))) > 8 * 84:
            count -= 1
        words = -(-max(len(bits), 1) // 32)
        code = int(bits[::-1], 2).to_bytes(4 * words, "little")
        bodies.append(head(number, row, column) + code)
        pixels, column = pixels[count:], column + count
    return bodies
