# amaranth: UnusedElaboratable=no
import random

import pytest

from hdl.acquisition.laser_guard import LaserGuard
from hdl.protocol import GUARD_CAUSES
from model.acquisition import laser_guard as model
from scripts.paths import ROOT
from scripts.rtl import size
from scripts.rtl.verilog import verilog
from tb.acquisition.laser_driver import HOLD_NS, LaserDriver, corner_hz
from tb.hdlsim import run

#: Hertz; microseconds of pulse, repetition, window, light in a window, heartbeat.
SETS = {
    "like_the_default": (1_000_000, 10, 100, 200, 10, 300),
    "tight": (1_000_000, 6, 7, 14, 8, 5),
    "odd": (1_000_000, 9, 21, 41, 13, 33),
    "more_pulse_than_window": (1_000_000, 20, 24, 30, 12, 70),
    "window_is_repetition": (1_000_000, 4, 16, 16, 6, 20),
    # All bits of the counters set at their ceilings, and one clock beyond that.
    "ones": (1_000_000, 7, 31, 31, 15, 62),
    "ones_of_a_window_of_two": (1_000_000, 15, 32, 63, 15, 127),
    "powers_of_two": (1_000_000, 8, 16, 32, 16, 64),
    # Odd numbers of clocks of more than one a microsecond.
    "odd_clocks": (3_000_000, 5, 11, 21, 7, 9),
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("limits", SETS.values(), ids=SETS)
def test_laser_guard(request, limits, seed):
    component = LaserGuard(*limits)
    run(request, "laser_guard", "tb.acquisition.tb_laser_guard", component=component, parameters={
        "seed": seed, "rounds": 30 if component.pause > 100 else 300,
        **{name: getattr(component, name)
           for name in ("pulse", "repetition", "window", "window_on", "pause")}})


def test_limits_in_clocks():
    component = LaserGuard()
    assert (component.pulse, component.repetition, component.window, component.window_on,
            component.pause) == (16_000, 320_000, 640_000, 16_000, 960_000)
    odd = LaserGuard(3_000_000, 3, 10, 20, 5, 7)
    assert (odd.pulse, odd.repetition, odd.window, odd.window_on, odd.pause) == (8, 30, 60, 14, 21)


def test_causes_are_those_of_the_protocol():
    assert model.CAUSES == GUARD_CAUSES


@pytest.mark.parametrize("change,error", [
    ({"clock_hz": 16_500_000},
     "The guard's clock must be a positive multiple of 1,000,000 Hz, not 16500000"),
    ({"clock_hz": 0}, "The guard's clock must be a positive multiple of 1,000,000 Hz, not 0"),
    ({"pulse_us": 0}, "The guard's time for pulse must be a positive integer of microseconds, "
                      "not 0"),
    ({"heartbeat_us": 1.5}, "The guard's time for heartbeat must be a positive integer of "
                            "microseconds, not 1.5"),
    ({"window_us": True}, "The guard's time for window must be a positive integer of "
                          "microseconds, not True"),
    ({"pulse_us": 20_000}, "A pulse must be shorter than the time from pulse to pulse, but "
                           "20000 us is not below 20000 us"),
    ({"window_us": 40_001}, "The guard's rule holds for a window of at most two repetition times, "
                            "but 40001 us is more than 2 x 20000 us"),
    ({"window_us": 19_999}, "The window must not be shorter than the time from pulse to pulse, "
                            "but 19999 us is below 20000 us"),
    ({"window_on_us": 40_001}, "A window cannot hold more light than time, but 40001 us is more "
                               "than 40000 us"),
    ({"clock_hz": 1_000_000, "window_on_us": 1},
     "The shortest light is two clocks, but the ceilings are 1000 and 1 us of 1 clocks each"),
])
def test_refuses_what_the_rule_does_not_hold_for(change, error):
    with pytest.raises(ValueError) as caught:
        LaserGuard(**change)
    assert str(caught.value) == error


@pytest.mark.parametrize("seed", range(20))
def test_rule_keeps_every_window(seed):
    """The model's pulses, of any limits and requests that press against them."""
    rng = random.Random(seed)
    pulse = 2 * rng.randint(1, 6)
    repetition = pulse + rng.randint(1, 12)
    window = rng.randint(repetition, 2 * repetition)
    window_on = 2 * rng.randint(1, window // 2)
    device = model.LaserGuard(pulse, repetition, window, window_on, 2)
    request = 0
    for clock in range(6000):
        if rng.random() < (0.5 if clock & 1024 else 0.15):
            request ^= 1
        device.step(request, 1, 0, clock & 1, 0)
    assert len(device.pulses) > 20
    assert max(edges for _, edges in device.pulses) <= pulse
    assert model.worst_window(device.pulses, window) <= window_on


def test_worst_window():
    assert model.worst_window([], 10) == 0
    assert model.worst_window([[0, 4], [8, 4]], 10) == 6
    assert model.worst_window([[0, 4], [8, 4], [16, 4]], 12) == 8
    assert model.worst_window([[0, 4], [3, 4]], 100) == 8


def test_synthesis_keeps_every_register():
    """What is there twice to find flipped bits looks superfluous."""
    component = LaserGuard()
    registers = {"token": 8, "silence": 20, "since": 20, "length": 14, "spent": 14, "flags": 7}
    found = size.measure_verilog(verilog(component, "laser_guard"), "laser_guard")
    assert found["ff"] == sum(registers.values()) + len(registers) + len(GUARD_CAUSES) + 1


@pytest.mark.parametrize("slower", [1, 2, 3, 5, 100])
def test_a_slow_clock_stretches_no_light_beyond_the_driver(slower):
    """Each edge lights for two clocks of the full rate at most, so their number is a ceiling."""
    driver, edges, hold = LaserDriver(2), 40, 2
    light = sum(driver.step(edge % 2) for edge in range(1, edges + 1) for _ in range(slower))
    light += sum(driver.step(edges % 2) for _ in range(hold))
    assert light <= edges * hold
    assert light == (edges * hold if slower >= hold else edges * slower + hold - slower)


def test_requirement_on_the_driver():
    """The numbers in the README are those of the ceilings."""
    text = " ".join((ROOT / "README.md").read_text().split())
    edges = LaserGuard().pulse
    assert f"at most {HOLD_NS} ns after an edge" in text
    assert f"{edges:,} edges" in text and f"{edges * HOLD_NS / 1e6:g} ms" in text
    assert f"{corner_hz(3) / 1e6:.1f} MHz" in text


@pytest.mark.parametrize("hold", [1, 2, 7])
def test_driver_goes_dark_at_either_level(hold):
    driver = LaserDriver(hold)
    assert not any(driver.step(0) for _ in range(5))
    assert [driver.step(1) for _ in range(hold + 2)] == [True] * hold + [False] * 2
    assert [driver.step(0) for _ in range(hold + 2)] == [True] * hold + [False] * 2
    assert all(driver.step(n % 2) for n in range(1, 30))
    with pytest.raises(ValueError, match="An edge must light the driver for at least one clock"):
        LaserDriver(0)
