"""Frames and settings for whole-frame tests that need no rig: directed and random."""

import numpy as np

from calibration.reciprocal import reciprocal_table
from calibration.undistortion import build
from hdl.protocol import fraction_bits
from model.settings import Settings
from model.stereo.depth import pack_depth
from model.stereo.epipolar import pack_line, pack_window

__all__ = ["any_settings", "directed_frames", "random_frame", "spot_frame"]


def any_settings(width, height, beams, seed=1, **changes):
    """Settings with a lens and lines that fit the sensor, though no real rig made them."""
    rng = np.random.default_rng(seed)
    pixel = 1 << fraction_bits(width, height)
    focal = 0.85 * width
    tables = build(focal, (width - 1) / 2 + 1.3, (height - 1) / 2 - 0.7, -0.12, 0.02, 5e-4, -4e-4,
                   width, height)
    tables = {name: tables[name] for name in (
        "principal_u", "principal_v", "tangential_1", "tangential_2", "radial")}
    spacing = (height - 8) / beams
    offset = np.round(pixel * (np.arange(beams) - (beams - 1) / 2) * spacing).astype(int)
    slope = rng.integers(-3000, 3000, beams)
    # A few lines share their neighbour's tolerance, so that spots become ambiguous.
    share = rng.choice([0.4, 0.5, 0.8], beams)
    tolerance = np.minimum(511, np.round(pixel // 16 * spacing * share))
    half = width // 2
    u_min = rng.integers(-half, -half // 2, beams) * (pixel // 32)
    u_max = rng.integers(half // 2, half, beams) * (pixel // 32)
    alpha = rng.integers(2000, 60000, beams)
    beta = (rng.integers(60_000, 120_000, beams) << 12)
    return Settings(
        reciprocal=tuple(reciprocal_table()),
        line=tuple(int(word) for word in pack_line(slope, offset)),
        window=tuple(int(word) for word in pack_window(tolerance.astype(int), u_min, u_max)),
        depth=tuple(int(word) for word in pack_depth(alpha, beta)),
        **tables, **{"report_rejected": True, **changes})


def spot_frame(width, height, seed, spots=40, background=24, noise=2.0):
    """Gaussian spots of many sizes on a noisy background, some of them saturated."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:height, :width]
    image = np.full((height, width), float(background))
    for _ in range(spots):
        u, v = rng.uniform(-2, width + 1), rng.uniform(-2, height + 1)
        sigma = rng.uniform(0.5, 2.4)
        image += rng.uniform(15, 300) * np.exp(
            -((column - u) ** 2 + (row - v) ** 2) / (2 * sigma**2))
    image += rng.normal(0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def random_frame(width, height, seed):
    """One of several kinds of random frame: spots, thin noise, dense noise, blocks, two levels."""
    rng = np.random.default_rng([seed, 7])
    kind = seed % 5
    if kind < 2:
        most = max(2, width * height // 300)
        return spot_frame(width, height, seed, spots=int(rng.integers(1, most)))
    if kind == 2:
        image = rng.normal(30, 3, (height, width))
        image[rng.random(image.shape) < 0.004] = 200
        return np.clip(image, 0, 255).astype(np.uint8)
    if kind == 3:
        blocks = rng.random(((height + 4) // 5, (width + 5) // 6)) < 0.25
        image = np.kron(blocks, np.ones((5, 6)))[:height, :width] * 120 + rng.normal(
            20, 2, (height, width))
        return np.clip(image, 0, 255).astype(np.uint8)
    return rng.choice(np.array([10, 250], np.uint8), (height, width), p=[0.97, 0.03])


def directed_frames(width, height):
    """Name and frame of the cases that break such designs."""
    black = np.zeros((height, width), np.uint8)
    row, column = np.mgrid[:height, :width]
    frames = {"black": black, "white": np.full_like(black, 255)}
    for name, place in {"first": (0, 0), "last": (-1, -1), "top right": (0, -1),
                        "bottom left": (-1, 0)}.items():
        frames[f"pixel {name}"] = black.copy()
        frames[f"pixel {name}"][place] = 255
    frames["grey"] = np.full_like(black, 77)
    frames["ramp"] = (column * 255 // (width - 1)).astype(np.uint8)
    frames["isolated pixels"] = np.where((row % 2 == 0) & (column % 2 == 0), 255, 0)
    frames["checkerboard"] = np.where((row + column) % 2, 255, 0)
    frames["columns"] = np.where(column % 2, 200, 0)
    frames["rows"] = np.where(row % 2, 200, 0)
    bottom = black.copy()
    for place in range(2, width - 4, max(5, width // 56)):
        bottom[-4:, place:place + 3] = 180
    frames["spots end on the last row"] = bottom
    spots = spot_frame(width, height, 3)
    frames["spots"] = spots
    frames["spots, one level below"] = np.maximum(spots, 1) - 1
    return {name: frame.astype(np.uint8) for name, frame in frames.items()}
