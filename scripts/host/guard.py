"""What will trip the laser guard, known before the chip is commanded to do it."""

from hdl.config import FRAME_US
from hdl.protocol import GUARD_LIMITS_US, Mode

__all__ = ["TIMES", "find_trips"]

#: Registers that decide when there is light and when frames come.
TIMES = ("period_us", "pattern_reset_us", "pattern_us", "texture_reset_us", "texture_us")


def _trips(mode, times, read_out_us):
    """Causes by their names, each with the reason, for frames that are read out in that time."""
    limits, found = GUARD_LIMITS_US, {}
    lit = times["pattern_us"]
    pattern = times["pattern_reset_us"] + lit + read_out_us
    texture = 0
    if mode != Mode.PATTERN:
        texture = times["texture_reset_us"] + times["texture_us"] + read_out_us
    period = max(times["period_us"], pattern + texture)
    if lit > limits["pulse"]:
        found["pulse"] = f"pattern_us is {lit}, and a pulse lasts {limits['pulse']} us at most"
    if mode == Mode.SINGLE:
        return found
    if period < limits["repetition"]:
        found["repetition"] = (f"a pattern comes every {period} us, and there are "
                               f"{limits['repetition']} us from pulse to pulse at least")
    if lit <= limits["pulse"] and period < limits["window"] and 2 * lit > limits["window_on"]:
        found["duty"] = (f"pattern_us is {lit} every {period} us, and any {limits['window']} us "
                         f"hold {limits['window_on']} us of light at most")
    gap = max(texture, period - texture)
    if gap >= limits["heartbeat"]:
        found["heartbeat"] = (f"a frame comes only every {gap} us, and the guard wants one in less "
                              f"than {limits['heartbeat']} us")
    return found


def find_trips(mode, times, identity):
    """Whether a chip that runs so trips its laser guard.

    How long a frame is read out depends on the imager: not less than a clock per pixel, and not
    longer than the sequencer waits for it.

    Parameters
    ----------
    mode : :class:`hdl.protocol.Mode`
        How it is to run.
    times : dict of :class:`int`
        :data:`TIMES` by their names.
    identity : :class:`dict`
        What the chip said it is.

    Returns
    -------
    tuple of two lists of :class:`str`
        Reasons why it does, and why it may.
    """
    if mode == Mode.STOP:
        return [], []
    fastest = identity["width"] * identity["height"] * 1000 // max(identity["clock_khz"], 1)
    fast = _trips(mode, times, min(fastest, FRAME_US))
    slow = _trips(mode, times, FRAME_US)
    certain = [reason for cause, reason in fast.items() if cause in slow]
    return certain, [reason for cause, reason in {**slow, **fast}.items()
                     if cause not in fast or cause not in slow]
