"""Masks that are hard on labelling, shared by the benches of the block and of its model."""

import cv2
import numpy as np

__all__ = ["bitmaps_4x4", "directed", "noise", "tiled_4x4"]


def bitmaps_4x4():
    """All 65,536 bitmaps of 4x4 pixels, as an array of bool."""
    codes = np.arange(1 << 16)[:, None]
    return (codes >> np.arange(16) & 1).astype(bool).reshape(-1, 4, 4)


def tiled_4x4(height, width):
    """Frames that hold all of :func:`bitmaps_4x4` in turn, with dark lines between them."""
    rows, columns = (height + 1) // 5, (width + 1) // 5
    bitmaps = bitmaps_4x4()
    frames = np.zeros((-(-len(bitmaps) // (rows * columns)), height, width), dtype=bool)
    place = np.arange(len(bitmaps))
    frame, place = np.divmod(place, rows * columns)
    v, u = np.divmod(place, columns)
    offset = np.arange(4)
    frames[frame[:, None, None], 5 * v[:, None, None] + offset[:, None],
           5 * u[:, None, None] + offset] = bitmaps
    return frames


def noise(height, width, seed):
    """Nine frames, 10 to 90 % lit."""
    rng = np.random.default_rng(seed)
    return {f"noise {percent} %": rng.random((height, width)) < percent / 100
            for percent in range(10, 100, 10)}


def directed(height, width):
    """Named masks: empty, full, borders, merges, and the worst for run tables and stack."""
    v, u = np.mgrid[:height, :width]
    masks = {
        "empty": np.zeros((height, width), bool),
        "full": np.ones((height, width), bool),
        "checkerboard": (u + v) % 2 == 0,
        "checkerboard, odd": (u + v) % 2 == 1,
        "checkerboard of 2x2": (u // 2 + v // 2) % 2 == 0,
        "isolated pixels": (u % 2 == 0) & (v % 2 == 0),
        "isolated pixels, odd": (u % 2 == 1) & (v % 2 == 1),
        "lines": v % 2 == 0,
        "lines, odd": v % 2 == 1,
        "columns": u % 2 == 0,
        "comb, back above": (u % 2 == 0) | (v == 0),
        "comb, back below": (u % 2 == 0) | (v == height - 1),
        "comb, back left": (v % 2 == 0) | (u == 0),
        "comb, back right": (v % 2 == 0) | (u == width - 1),
        "meander": (v % 2 == 0) | (u == np.where(v % 4 == 1, width - 1, 0)),
        "interlocked combs": np.where(
            u % 4 == 0, v < height - 2, np.where(u % 4 == 2, v > 1, (v == 0) | (v == height - 1))),
        "diagonals": (u + v) % 3 == 0,
        "diagonals, other way": (u - v) % 3 == 0,
        "zigzag": (u + np.abs(v % 8 - 4)) % 3 == 0,
        "last column meets first": (u == 0) & (v % 2 == 1) | (u == width - 1) & (v % 2 == 0),
        "last row": v == height - 1,
        "last row, dotted": (v == height - 1) & (u % 2 == 0),
        "first row": v == 0,
        "frame": (v == 0) | (v == height - 1) | (u == 0) | (u == width - 1),
        "corners": ((v == 0) | (v == height - 1)) & ((u == 0) | (u == width - 1)),
        "objects on every border": _border_objects(height, width),
        "spiral": _spiral(height, width),
        "spiral, turned": _spiral(height, width)[::-1, ::-1],
        "spiral of darkness": ~_spiral(height, width),
        "square rings": np.minimum(np.minimum(v, u), np.minimum(height - 1 - v, width - 1 - u)
                                   ) % 2 == 0,
        "round rings": np.hypot(v - height / 2, u - width / 2) % 4 < 1.6,
        "rings beside each other": (np.hypot(v % 32 - 16, u % 32 - 16) % 4 < 1.6),
        "nested cups": _cups(height, width),
        "nested caps": _cups(height, width)[::-1],
        "nested cups, joined below": _cups(height, width) | (v == height - 1),
        "W": ((u + v) % 16 == 0) | ((u - v) % 16 == 0),
    }
    for name, corner in {"first": (0, 0), "second": (0, -1), "third": (-1, 0), "last": (-1, -1)
                         }.items():
        masks[f"one pixel, {name} corner"] = masks["empty"].copy()
        masks[f"one pixel, {name} corner"][corner] = True
    for area in 255, 256, 1023, 1024, 1025:
        masks[f"area {area}"] = masks["empty"].copy()
        masks[f"area {area}"].ravel()[width * 3:width * 3 + area] = True
    return masks


def _border_objects(height, width):
    mask = np.zeros((height, width), np.uint8)
    for step in range(0, max(height, width), 9):
        for centre in ((step, 0), (step, height - 1), (0, step), (width - 1, step)):
            cv2.circle(mask, centre, 2, 1, -1)
    return mask.astype(bool)


def _spiral(height, width):
    mask = np.zeros((height, width), bool)
    top, bottom, left, right = 0, height - 1, 0, width - 1
    mask[0, 0] = True
    while left <= right and top <= bottom:
        mask[top, max(left - 2, 0):right + 1] = True
        mask[top:bottom + 1, right] = True
        if top < bottom:
            mask[bottom, left:right + 1] = True
        if top + 2 <= bottom:
            mask[top + 2:bottom + 1, left] = True
        top, bottom, left, right = top + 2, bottom - 2, left + 2, right - 2
    return mask


def _cups(height, width):
    """As many U-shaped components in each other as fit: the deepest stack there is."""
    v, u = np.mgrid[:height, :width]
    side = np.minimum(u, width - 1 - u)
    floor = np.maximum(height - 1 - 2 * (side // 2), 0)
    level = np.minimum(side, height - 1 - v)
    return np.where(v <= floor, (side % 2 == 0), False) | (
        (level % 2 == 0) & (side >= level))
