"""The Cramer-Rao bound of centres against closed forms, and the chain's centres against it."""

from dataclasses import replace

import numpy as np
import pytest

from model.optics.conditions import PLAIN, Conditions
from model.optics.rigs import RIGS, Noise
from tb.benchmark import centre_bound
from tb.benchmark.centre_bound import information, measure

_LEVELS = np.array([20.0, 100.3, 170.7])


def test_information_of_a_pixel():
    quiet = Noise(read=2.0, electrons=0)
    assert information(quiet, PLAIN, _LEVELS) == pytest.approx(
        np.full(3, 1 / (2**2 + 1 / 12)), rel=0.01)
    # The noise's own size says something about the level too.
    shot = Noise(read=2.0, electrons=40)
    variance = 2**2 + _LEVELS / 40
    assert information(shot, PLAIN, _LEVELS) == pytest.approx(
        1 / (variance + 1 / 12) + (1 / 40 / variance)**2 / 2, rel=0.01)


def test_information_is_lost_by_saturation_and_bits():
    quiet = Noise(read=2.0, electrons=0)
    assert information(quiet, PLAIN, np.array([300.0])) < 1e-9
    assert information(quiet, Conditions(gain=4), np.array([50.0]))[0] > 0.2
    assert information(quiet, Conditions(gain=4), np.array([100.0])) < 1e-9
    steps = information(Noise(read=4.0, electrons=0), Conditions(bits=4), _LEVELS)
    assert steps == pytest.approx(np.full(3, 1 / (4**2 + 16**2 / 12)), rel=0.1)


def test_bound_of_a_gaussian(monkeypatch):
    # A Gaussian of peak A in white noise n: each coordinate is known to n sqrt(2 / pi) / A.
    rig = RIGS["endoscope"]
    flat = replace(rig, noise=Noise(read=1.0, electrons=0, background=20, vignetting=0, texture=0))
    monkeypatch.setitem(RIGS, "endoscope", flat)
    monkeypatch.setattr(centre_bound, "_KINDS", ("plane",))
    monkeypatch.setattr(centre_bound, "_FRAMES", 1)
    centres = measure(PLAIN, [1])
    noise = np.sqrt(1 + 1 / 12)
    # Spots have a peak of 190 at most, and somewhat less towards the corners.
    assert noise * np.sqrt(2 / np.pi) / 195 < centres.bound_px < noise * np.sqrt(2 / np.pi) / 130


@pytest.mark.parametrize("name, most", [
    ("plain", 1.3), ("gain 4", 1.3), ("6 bits", 1.3), ("12-look speckle", 2.0)])
def test_centres_are_near_their_bound(name, most):
    centres = measure(centre_bound.CASES[name], [1])
    assert len(centres.error) == centres.expected
    assert 1 < centres.rms_px / centres.bound_px < most


def test_lost_tops_cost_what_no_estimate_recovers():
    plain, stretched = (measure(centre_bound.CASES[name], [1]) for name in ("plain", "gain 4"))
    assert stretched.bound_px / plain.bound_px == pytest.approx(1.4, abs=0.1)
