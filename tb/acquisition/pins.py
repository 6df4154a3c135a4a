"""Frames as an imager's pins show them, whole or with faults."""

import numpy as np

__all__ = ["FAULTS", "show"]

#: What can be wrong with a frame.
FAULTS = (
    "short line", "long line", "short frame", "no last pixel", "extra row", "extra pixel", "empty",
    "long last line", "frame falls with the line", "single pixel", "line begins before the frame",
)


def show(rng, image, fault=None, blanking=4, least=0):
    """Samples (frame_valid, line_valid, data), one row per pixel clock.

    ``blanking``: at most so many clocks before, between and behind lines, but ``least`` between
    them; between frames one more. Between frames ``line_valid`` may do anything.
    """
    height, width = image.shape
    samples = []

    def pause(frame, least=0, line=0):
        for _ in range(max(least, int(rng.integers(0, blanking + 1)))):
            samples.append((frame, line, int(rng.integers(256))))

    lines = [list(row) for row in image]
    place = int(rng.integers(height))
    if fault == "short line":
        lines[place] = lines[place][:int(rng.integers(1, width))]
    elif fault == "long line":
        lines[place] = lines[place] + [7] * int(rng.integers(1, width))
    elif fault == "short frame":
        lines = lines[:place]
    elif fault in ("no last pixel", "frame falls with the line"):
        lines[-1] = lines[-1][:-1]
    elif fault == "extra row":
        lines += [lines[0]] * int(rng.integers(1, 3))
    elif fault == "extra pixel":
        lines.append([9])
    elif fault == "long last line":
        lines[-1] = lines[-1] + [5]
    elif fault == "empty":
        lines = []
    elif fault == "single pixel":
        lines = [[3]]
    pause(0, least=1, line=int(rng.integers(2)))
    if fault == "line begins before the frame":
        samples.append((0, 1, 1))
        lines[0] = lines[0][1:]
    else:
        samples.append((0, 0, 0))
        pause(1, least=int(fault == "empty"))
    for number, line in enumerate(lines):
        if number:
            # Torn lines need a clock without line_valid, else they are none.
            pause(1, least=max(least, int(fault is not None)))
        samples += [(1, 1, int(value)) for value in line]
    if fault != "frame falls with the line":
        pause(1)
    return np.array(samples, dtype=np.int64)
