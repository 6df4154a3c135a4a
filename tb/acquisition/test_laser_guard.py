# amaranth: UnusedElaboratable=no
import random

import pytest

from hdl.acquisition.laser_guard import LaserGuard
from hdl.protocol import GUARD_CAUSES
from model.acquisition import laser_guard as model
from tb.acquisition.laser_driver import LaserDriver
from tb.hdlsim import run

#: Pulse, repetition, window, light in a window, heartbeat; microseconds of one clock.
SETS = {
    "like_the_default": (10, 100, 200, 10, 300),
    "tight": (6, 7, 14, 8, 5),
    "odd": (9, 21, 41, 13, 33),
    "more_pulse_than_window": (20, 24, 30, 12, 70),
    "window_is_repetition": (4, 16, 16, 6, 20),
}


def guard(limits, clock_hz=1_000_000):
    return LaserGuard(clock_hz, *limits)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("limits", SETS.values(), ids=SETS)
def test_laser_guard(request, limits, seed):
    component = guard(limits)
    run(request, "laser_guard", "tb.acquisition.tb_laser_guard", component=component, parameters={
        "seed": seed, "rounds": 30 if max(limits) > 100 else 300,
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


@pytest.mark.parametrize("hold", [1, 2, 7])
def test_driver_goes_dark_at_either_level(hold):
    driver = LaserDriver(hold)
    assert not any(driver.step(0) for _ in range(5))
    assert [driver.step(1) for _ in range(hold + 2)] == [True] * hold + [False] * 2
    assert [driver.step(0) for _ in range(hold + 2)] == [True] * hold + [False] * 2
    assert all(driver.step(n % 2) for n in range(1, 30))
    with pytest.raises(ValueError, match="An edge must light the driver for at least one clock"):
        LaserDriver(0)
