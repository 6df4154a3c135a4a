"""Histograms of a given number of pixels, as frames make them and as none does."""

import numpy as np

__all__ = ["directed", "gaussian", "random_counts"]


def _fill(counts, pixels, grey):
    counts = np.array(counts, dtype=np.int64)
    counts[grey] += pixels - counts.sum()
    assert counts.min() >= 0
    return counts


def gaussian(rng, pixels, mean, sigma):
    values = np.clip(np.round(rng.normal(mean, sigma, pixels)), 0, 255).astype(int)
    return np.bincount(values, minlength=256)


def _bins(pixels, rest, **bins):
    """``rest`` takes what ``bins`` (b12=34) leave of the pixels."""
    counts = np.zeros(256, np.int64)
    for name, count in bins.items():
        counts[int(name[1:])] = count
    return _fill(counts, pixels, rest)


def directed(pixels):
    """Name and histogram of single values, and of every comparison's ties."""
    cases = {f"grey {grey}": _bins(pixels, grey) for grey in (0, 1, 2, 77, 127, 253, 254, 255)}
    half, part, unit = (pixels + 1) // 2, pixels // 64, pixels // 200
    for off in (-1, 0, 1):
        # Half of the pixels at or below bin 50, which is the higher peak if they are.
        cases[f"half {off:+}"] = _bins(
            pixels, 200, b10=half + off - 20 * unit, b50=20 * unit, b90=18 * unit)
        # A smoothed peak of 1/64 of the pixels, at bin 99 of a black image.
        cases[f"significant {off:+}"] = _bins(
            pixels, 0, b98=2 + part % 2 + off, b99=part // 2 - 1)
        cases[f"white {off:+}"] = _bins(pixels, 255, b0=half + off)
        # Bin 102 is just faint, or not, against the peak of 2 x 8 units at bin 100.
        cases[f"faint above {off:+}"] = _bins(
            pixels, 0, b100=8 * unit, b102=2 * unit + off, b104=2 * unit, b106=2 * unit)
        cases[f"faint below {off:+}"] = _bins(
            pixels, 0, b100=8 * unit, b98=2 * unit + off, b96=2 * unit, b94=2 * unit)
        # A second peak behind a valley that does, or does not, end the first mode.
        cases[f"valley {off:+}"] = _bins(
            pixels, 0, b40=8 * unit, b42=2 * unit + off, b44=14 * unit, b45=9 * unit)
    cases["two equal peaks"] = _bins(
        pixels, 0, b60=9 * unit, b61=9 * unit, b62=7 * unit, b63=9 * unit)
    cases["hollow peak"] = _bins(pixels, 0, b60=9 * unit, b62=9 * unit)
    cases["at the dark end"] = _bins(pixels, 0, b1=9 * unit, b2=5 * unit, b3=3 * unit)
    cases["at the bright end"] = _bins(
        pixels, 0, b254=9 * unit, b253=5 * unit, b252=3 * unit, b251=unit)
    cases["uniform"] = _fill(np.full(256, pixels // 256), pixels, 128)
    cases["ramp"] = _fill(np.arange(256) * (pixels - 300) // 32640, pixels, 0)
    cases["two levels"] = _bins(pixels, 30, b200=pixels * 3 // 10)
    cases["comb"] = _fill(np.where(np.arange(256) % 2, pixels // 140, 0), pixels, 0)
    return cases


def random_counts(rng, pixels):
    """One of several kinds, often with black corners, white spots, or a second background."""
    kind = rng.integers(5)
    if kind < 3:
        counts = gaussian(rng, pixels, rng.uniform(-5, 260), rng.choice([0.3, 2, 8, 40]))
    elif kind == 3:
        counts = rng.multinomial(pixels, rng.dirichlet(np.full(256, 0.05)))
    else:
        part = int(rng.integers(pixels))
        counts = gaussian(rng, part, rng.uniform(0, 255), rng.uniform(1, 9))
        counts = counts + gaussian(rng, pixels - part, rng.uniform(0, 255), rng.uniform(1, 9))
    for grey in (0, 255):
        if rng.random() < 0.3:
            taken = rng.binomial(counts, rng.uniform(0, 0.6))
            counts = counts - taken
            counts[grey] += taken.sum()
    return counts
