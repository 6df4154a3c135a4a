"""Reset and integration times of the imager."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

__all__ = ["Exposure", "clocks_per_us"]


def clocks_per_us(clock_hz):
    """Clocks of a microsecond; ValueError if they are not a whole number."""
    if not isinstance(clock_hz, int) or clock_hz < 1_000_000 or clock_hz % 1_000_000:
        raise ValueError(
            f"The clock must be a whole number of megahertz, in hertz, not {clock_hz!r}")
    return clock_hz // 1_000_000


class Exposure(wiring.Component):
    """Takes one exposure: reset, integration, and the pulse that begins the read-out.

    A clock after ``start``, ``sensor_reset`` is high for ``reset_us`` microseconds, then
    ``sensor_integrate`` for ``exposure_us`` and ``sensor_read`` for one. Microseconds are counted
    from ``start``, so all times are exact to the clock. Times and ``laser`` are sampled with
    ``start``, which is ignored while ``busy`` is high; 0 counts as 1. The pins come from
    flip-flops, and are low in reset.

    Parameters
    ----------
    clock_hz : :class:`int`
        The system's clock, a multiple of 1 MHz.

    Members
    -------
    start : :py:`In(1)`
        Begins an exposure.
    reset_us, exposure_us : :py:`In(16)`, :py:`In(16)`
        Microseconds, 1 to 65,535.
    laser : :py:`In(1)`
        Request the laser during the integration.
    sensor_reset : :py:`Out(1)`
        Holds all pixels at dark.
    sensor_integrate : :py:`Out(1)`
        Opens the global shutter.
    sensor_read : :py:`Out(1)`
        Begins the read-out.
    laser_request : :py:`Out(1)`
        High with ``sensor_integrate``, if requested.
    latched_us : :py:`Out(16)`
        ``exposure_us`` of the exposure that was started last.
    integrated : :py:`Out(1)`
        High in the clock after the integration's last.
    done : :py:`Out(1)`
        High in the clock after the last of ``sensor_read``.
    busy : :py:`Out(1)`
        From the clock after ``start`` to the last of ``sensor_read``.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``start`` to ``sensor_reset``.
    """

    latency = 1

    def __init__(self, clock_hz):
        self.clocks = clocks_per_us(clock_hz)
        super().__init__({
            "start": In(1),
            "reset_us": In(16),
            "exposure_us": In(16),
            "laser": In(1),
            "sensor_reset": Out(1),
            "sensor_integrate": Out(1),
            "sensor_read": Out(1),
            "laser_request": Out(1),
            "latched_us": Out(16),
            "integrated": Out(1),
            "done": Out(1),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()

        prescaler = Signal(range(max(2, self.clocks)))
        remaining = Signal(16)  # microseconds of this phase, the present one included
        laser = Signal()
        over = Signal()  # this is the phase's last clock
        m.d.comb += [
            self.busy.eq(self.sensor_reset | self.sensor_integrate | self.sensor_read),
            over.eq((prescaler == 0) & ~remaining[1:].any()),
        ]
        m.d.sync += [self.integrated.eq(self.sensor_integrate & over),
                     self.done.eq(self.sensor_read & over)]

        with m.If(~self.busy):
            m.d.sync += [
                self.sensor_reset.eq(self.start),
                remaining.eq(self.reset_us),
                laser.eq(self.laser),
                prescaler.eq(self.clocks - 1),
            ]
            with m.If(self.start):
                m.d.sync += self.latched_us.eq(self.exposure_us | ~self.exposure_us.any())
        with m.Else():
            m.d.sync += prescaler.eq(prescaler - 1)
            with m.If(prescaler == 0):
                m.d.sync += [prescaler.eq(self.clocks - 1), remaining.eq(remaining - 1)]
            with m.If(over):
                m.d.sync += [
                    remaining.eq(Mux(self.sensor_reset, self.latched_us, 1)),
                    self.sensor_reset.eq(0),
                    self.sensor_integrate.eq(self.sensor_reset),
                    self.laser_request.eq(self.sensor_reset & laser),
                    self.sensor_read.eq(self.sensor_integrate),
                ]
        return m
