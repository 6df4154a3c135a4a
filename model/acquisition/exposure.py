"""When an exposure's pins rise and fall."""

__all__ = ["PINS", "exposure"]

#: Pins that `exposure` returns, in the order of its phases.
PINS = ("sensor_reset", "sensor_integrate", "sensor_read")


def exposure(clock_hz, reset_us, exposure_us, laser=False, start=0):
    """Clocks of one exposure that is started in the clock ``start``.

    Returns
    -------
    dict
        For each pin, and for ``laser_request`` if it is asked for, the first clock in which it is
        high and the first in which it is low again; ``integrated`` and ``done``: the clock in
        which they are high.
    """
    clocks = clock_hz // 1_000_000
    begin, result = start + 1, {}
    for pin, length_us in zip(PINS, (max(1, reset_us), max(1, exposure_us), 1), strict=True):
        result[pin] = begin, begin + length_us * clocks
        begin += length_us * clocks
    if laser:
        result["laser_request"] = result["sensor_integrate"]
    result["integrated"] = result["sensor_integrate"][1]
    result["done"] = begin
    return result
