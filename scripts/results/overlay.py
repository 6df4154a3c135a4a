"""A frame with an overlay of what was measured: spots, epipolar lines, beam numbers, a legend."""

import cv2
import numpy as np

from model.preprocessing.centre import lsb_px
from scripts.results.outputs import whole_file
from scripts.results.points import STATUS
from scripts.results.summary import COLOURS

__all__ = [
    "SCALE", "SHIFT", "SPOT_COLOURS", "beam_segments", "draw_frame", "enlarged", "ring_radius",
    "write_picture"]

#: Picture pixels of an image pixel.
SCALE = 3
_LEGEND = 58
_BACKGROUND = (24, 22, 20)
_WORDS = (235, 235, 235)
_LINE = (170, 115, 35)
_UNTOUCHED = (1, 2, 3)
_FONT = cv2.FontFace("sans")
#: Tissue is dim beside the spots: its grey values are raised.
_BRIGHTER = np.rint(255 * (np.arange(256) / 255) ** 0.7).astype(np.uint8)
#: Fraction bits of cv2's coordinates.
SHIFT = 4


def _bgr(colour):
    return tuple(int(colour[start:start + 2], 16) for start in (5, 3, 1))


#: Blue, green, red of a ring, in the order of :data:`scripts.results.points.STATUS`.
SPOT_COLOURS = tuple(_bgr(colour) for colour in COLOURS)


def _signed(word, bits):
    word &= (1 << bits) - 1
    return word - (1 << bits) if word >> (bits - 1) else word


def beam_segments(calibration, samples=17):
    """Where each beam's spot can be, in image coordinates: (beams, samples, 2); NaN if nowhere.

    These are the lines and windows in the chip's tables, distorted by the lens.
    """
    # As in the chip: limits of a window are 5 bits shorter than coordinates.
    lsb = lsb_px(calibration.width, calibration.height)
    segments = []
    for line, window in zip(calibration.settings.line, calibration.settings.window, strict=True):
        a, b = _signed(line, 18) / 2**17, _signed(line >> 18, 18) * lsb
        low, high = (_signed(window >> at, 13) * 32 * lsb for at in (9, 22))
        if not window & 0x1FF or high < low:
            segments.append(np.full((samples, 2), np.nan))
            continue
        x = np.linspace(low, high, samples)
        segments.append(np.stack(calibration.lens.distort(x, a * x + b), axis=-1))
    return np.array(segments).reshape(-1, samples, 2)


def enlarged(points):
    """Image coordinates to those of the enlarged picture, in fixed point."""
    return np.rint(((np.asarray(points) + 0.5) * SCALE - 0.5) * (1 << SHIFT)).astype(np.int32)


def ring_radius(point):
    """Radius of the ring around a spot, in pixels of the enlarged picture."""
    return (np.sqrt(point["area"] / np.pi) + 2) * SCALE


def _text(picture, words, position, colour, size, weight=400):
    cv2.putText(picture, words, (int(position[0]), int(position[1])), colour, _FONT, size, weight)


def _width(words, size, weight=400):
    return cv2.getTextSize((4000, 100), words, (0, 50), _FONT, size, weight)[2]


def _outlined(picture, words, position, colour, size):
    """Text with a black outline."""
    for step in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        _text(picture, words, (position[0] + step[0], position[1] + step[1]), (0, 0, 0), size, 700)
    _text(picture, words, position, colour, size, 700)


def _legend(picture, frame, top, disabled):
    """Two lines below the frame: its number and counts, and the meaning of the colours."""
    words = f"frame {frame.index}    level {frame.level:.1f}    {frame.spots} spots"
    if frame.notes:
        words += "    " + "; ".join(frame.notes)
    size = next((size for size in range(15, 8, -1)
                 if _width(words, size, 600) < picture.shape[1] - 20), 8)
    _text(picture, words, (10, top + 22), _WORDS, size, 600)
    left = 10
    for status, (name, colour) in enumerate(zip(STATUS, SPOT_COLOURS, strict=True)):
        number = np.count_nonzero(frame.points["status"] == status)
        if not number and name in ("duplicate", "doubtful"):
            continue
        cv2.circle(picture, (left + 6, top + 41), 6, colour, 2, cv2.LINE_AA)
        words = f"{number} {name}" + (", with its beam's number" if name == "ok" else "")
        _text(picture, words, (left + 18, top + 46), _WORDS, 14)
        left += 36 + _width(words, 14)
    cv2.line(picture, (left, top + 41), (left + 22, top + 41), _LINE, 2, cv2.LINE_AA)
    _text(picture, "where a beam's spot can be" + (f" ({disabled} beams off)" if disabled else ""),
          (left + 28, top + 46), _WORDS, 14)


def draw_frame(image, frame, segments):
    """The frame, three times as large, with the overlay of its results.

    Parameters
    ----------
    image : 2-D ``uint8`` array
        The pattern frame.
    frame : :class:`scripts.results.points.FrameResult`
        Its results.
    segments : array
        From :func:`beam_segments`.

    Returns
    -------
    3-D ``uint8`` array
        Blue, green, red.
    """
    height, width = image.shape
    large = cv2.resize(_BRIGHTER[image], None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_NEAREST)
    picture = np.empty((height * SCALE + _LEGEND, width * SCALE, 3), np.uint8)
    picture[:height * SCALE] = large[:, :, None]
    picture[height * SCALE:] = _BACKGROUND
    body = picture[:height * SCALE]
    drawn = [enlarged(segment) for segment in segments if np.isfinite(segment).all()]
    lines = body.copy()
    cv2.polylines(lines, drawn, False, _LINE, 2, cv2.LINE_AA, SHIFT)
    circles = [(enlarged((point["u"], point["v"])), int(ring_radius(point) * (1 << SHIFT)),
                SPOT_COLOURS[point["status"]]) for point in frame.points]
    for centre, radius, _ in circles:  # no lines inside a ring
        cv2.circle(lines, centre, radius, _UNTOUCHED, cv2.FILLED, cv2.LINE_8, SHIFT)
    keep = (lines == _UNTOUCHED).all(axis=2)
    lines[keep] = body[keep]
    cv2.addWeighted(lines, 0.8, body, 0.2, 0, dst=body)
    for centre, radius, colour in circles:
        cv2.circle(body, centre, radius, colour, 2, cv2.LINE_AA, SHIFT)
    for point in frame.points[frame.points["beam"] >= 0]:
        words = str(point["beam"])
        gap = ring_radius(point) + 1.5
        left, base = (point["u"] + 0.5) * SCALE + gap, (point["v"] + 0.5) * SCALE - gap / 3
        if left + _width(words, 13, 700) > body.shape[1]:
            left -= 2 * gap + _width(words, 13, 700)
        _outlined(body, words, (left, max(base, 13)), SPOT_COLOURS[point["status"]], 13)
    _legend(picture, frame, height * SCALE, len(segments) - len(drawn))
    return picture


def write_picture(path, picture):
    """Write a picture as PNG, whole or not at all."""
    done, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    assert done
    with whole_file(path) as file:
        file.write(data.tobytes())
