"""The schedule of the sensor: resets, exposures, read-outs, and when the next pair begins."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from ..payloads import FrameTag
from ..ports import register_ports
from ..protocol import Mode
from .exposure import Exposure, clocks_per_us

__all__ = ["Sequencer"]

_TIMES = ("period_us", "pattern_reset_us", "pattern_us", "texture_reset_us", "texture_us")


class Sequencer(wiring.Component):
    """Takes pairs of frames: a pattern, exposed briefly with the laser, and a texture without.

    A frame is a reset, an integration and a read-out (:class:`.exposure.Exposure`). The pixels hold
    a frame until it has been read, so the next reset waits until the imager has sent it; processing
    and sending go on meanwhile. A pair begins exactly ``period_us`` after the one before. If the
    frames need longer, it begins with the first microsecond after their end, and ``late`` counts.

    A frame is over with ``frame_ended``, or with ``frame_broken``, once ``sending`` is low. If it
    has not begun ``begin_us`` after the integration, or is not over ``frame_us`` after it, the
    schedule goes on without it: ``timeouts`` counts, and ``silent`` is high until a whole frame
    comes.

    **Laser.** ``heartbeat`` changes with each frame that came whole and with nothing else, so it
    stops if the imager stops, and if this block does. The laser is requested only if
    ``laser_armed`` is high as a pattern frame begins. If it is not, that pattern is a dark warm-up
    frame, and another pattern follows at once so that the laser guard soon has its heartbeats. This
    goes on for at most ``warm_up_us`` after the schedule began, the laser was requested or a frame
    was not whole; after that, dark pairs follow at their usual times. The tag says what was lit,
    not what was requested.

    A pattern frame that is to be sent as an image, and not measured, is tagged as texture.

    Mode and times may change at any time. A frame samples them in the clock after its
    ``frame_start``, so what changes with that pulse still counts. ``STOP`` ends the schedule in
    that clock, also between a pattern and its texture, and at once while it waits for a pair.

    Reset: all pins low, stopped.

    Parameters
    ----------
    clock_hz : :class:`int`
        The system's clock, a multiple of 1 MHz, 4 MHz or more.
    begin_us, frame_us : :class:`int`
        How long a frame may take until it begins, and until it is over.
    warm_up_us : :class:`int`
        How long warm-up frames are repeated.

    Members
    -------
    mode : :py:`In(2)`
        See :class:`hdl.protocol.Mode`. ``SINGLE`` takes a pair whenever the mode changes to it.
    pattern_as_texture : :py:`In(1)`
        In mode ``PATTERN``: frames are to be sent as images.
    period_us : :py:`In(16)`
        From pattern to pattern. For this and all other times, 0 means 1.
    pattern_reset_us, pattern_us, texture_reset_us, texture_us : :py:`In(16)`
        Resets and integrations.
    frame_begun, frame_ended, frame_broken : :py:`In(1)`
        High for a clock with a frame's first pixel, with its last one if it came whole, and with
        the loss of synchronism.
    sending : :py:`In(1)`
        The imager is sending a frame.
    laser_armed, lit : :py:`In(1)`
        From the laser guard: a request would be granted; there is light.
    capture : :py:`In(1)`
        Calibration capture is on.
    sensor_reset, sensor_integrate, sensor_read : :py:`Out(1)`
        The imager's pins.
    laser_request : :py:`Out(1)`
        Requests light.
    frame_start, pattern_start : :py:`Out(1)`
        High for a clock as a frame begins, and as a pattern frame does.
    tag : :py:`Out(FrameTag)`
        The frame whose integration ended last. ``laser`` and ``capture`` are set if ``lit`` and
        ``capture`` were high at any time of it.
    heartbeat : :py:`Out(8)`
        Another value after each whole frame.
    running : :py:`Out(1)`
        From the first ``frame_start`` to the last frame's end.
    timestamp_us : :py:`Out(24)`
        Microseconds since reset, modulo 2^24.
    pairs : :py:`Out(16)`
        Pattern frames since reset, modulo 65,536.
    timeouts, late : :py:`Out(8)`
        Frames that did not come; pairs that began late. Both stop at 255.
    silent : :py:`Out(1)`
        The last frame did not come.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``frame_start`` to ``sensor_reset``.
    """

    latency = 2
    registers = register_ports("mode", "pattern_as_texture", *_TIMES)

    def __init__(self, clock_hz=16_000_000, begin_us=5000, frame_us=20_000, warm_up_us=100_000):
        self.clock_hz, self.clocks = clock_hz, clocks_per_us(clock_hz)
        if self.clocks < 4:
            raise ValueError("The sequencer needs 4 clocks a microsecond, but a clock of "
                             f"{clock_hz} Hz gives {self.clocks}")
        for name, value in (("a frame's first pixel", begin_us), ("a frame", frame_us)):
            if not isinstance(value, int) or not 2 <= value <= 65_535:
                raise ValueError(f"The time for {name} must be an integer from 2 to 65535 "
                                 f"microseconds, not {value!r}")
        if begin_us > frame_us:
            raise ValueError(f"A frame cannot be over {frame_us} us after the integration if it "
                             f"may begin {begin_us} us after it")
        if not isinstance(warm_up_us, int) or not 0 <= warm_up_us <= 1_000_000:
            raise ValueError("The time to wait for the laser must be an integer from 0 to 1000000 "
                             f"microseconds, not {warm_up_us!r}")
        self.begin_us, self.frame_us, self.warm_up_us = begin_us, frame_us, warm_up_us
        super().__init__({
            **self.registers,
            "frame_begun": In(1),
            "frame_ended": In(1),
            "frame_broken": In(1),
            "sending": In(1),
            "laser_armed": In(1),
            "lit": In(1),
            "capture": In(1),
            "sensor_reset": Out(1),
            "sensor_integrate": Out(1),
            "sensor_read": Out(1),
            "laser_request": Out(1),
            "frame_start": Out(1),
            "pattern_start": Out(1),
            "tag": Out(FrameTag),
            "heartbeat": Out(8),
            "running": Out(1),
            "timestamp_us": Out(24),
            "pairs": Out(16),
            "timeouts": Out(8),
            "late": Out(8),
            "silent": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.exposure = exposure = Exposure(self.clock_hz)
        m.d.comb += [getattr(self, name).eq(getattr(exposure, name)) for name in (
            "sensor_reset", "sensor_integrate", "sensor_read", "laser_request")]

        # Time.
        prescaler = Signal(range(self.clocks))
        tick = Signal()  # a microsecond's last clock
        m.d.comb += tick.eq(prescaler == self.clocks - 1)
        m.d.sync += prescaler.eq(Mux(tick, 0, prescaler + 1))
        remaining = Signal(16)  # microseconds to the next pair
        waited = Signal(range(self.frame_us + 1))  # microseconds since the integration
        # Microseconds since there was a reason to warm up.
        warm_up_timer = Signal(range(self.warm_up_us + 1))
        with m.If(tick):
            m.d.sync += [
                self.timestamp_us.eq(self.timestamp_us + 1),
                remaining.eq(remaining - remaining.any()),
                waited.eq(waited + (waited != self.frame_us)),
                warm_up_timer.eq(warm_up_timer + (warm_up_timer != self.warm_up_us)),
            ]

        # What the frame begins with.
        texture = Signal()
        mode_now = Signal(2)
        warm_up_frame = Signal()  # this pattern is for the heartbeat alone
        as_image = Signal()  # it is not to be measured
        single_pending = Signal(init=1)  # mode SINGLE has still to take its pair
        warming_up, stopped = Signal(), Signal()
        m.d.comb += [
            warming_up.eq(~texture & ~self.laser_armed & (warm_up_timer != self.warm_up_us)),
            stopped.eq((self.mode == Mode.STOP)
                       | (self.mode == Mode.SINGLE) & ~single_pending & ~texture),
            exposure.reset_us.eq(Mux(texture, self.texture_reset_us, self.pattern_reset_us)),
            exposure.exposure_us.eq(Mux(texture, self.texture_us, self.pattern_us)),
            exposure.laser.eq(self.laser_armed & ~texture),
        ]

        begun, over = Signal(), Signal()
        begins, whole, ends, missing, too_long = self._outcome(m, begun, over, waited)
        with m.FSM() as schedule:
            with m.State("IDLE"):
                m.d.sync += [texture.eq(0), warm_up_timer.eq(0)]
                with m.If(tick & ~stopped):
                    m.next = "BEGIN"
            with m.State("BEGIN"):
                m.d.comb += [self.frame_start.eq(1), self.pattern_start.eq(~texture)]
                m.next = "TAKE"
            with m.State("TAKE"):
                m.d.sync += [
                    mode_now.eq(self.mode), warm_up_frame.eq(warming_up),
                    as_image.eq(self.pattern_as_texture & (self.mode == Mode.PATTERN))]
                with m.If(stopped):
                    m.next = "IDLE"
                with m.Elif(texture & (self.mode == Mode.PATTERN)):
                    m.d.sync += texture.eq(0)
                    m.next = "WAIT"
                with m.Else():
                    m.d.comb += exposure.start.eq(1)
                    with m.If(~texture):
                        m.d.sync += [
                            remaining.eq(self.period_us), self.pairs.eq(self.pairs + 1),
                            single_pending.eq(single_pending & warming_up),
                        ]
                        with m.If(self.laser_armed):
                            m.d.sync += warm_up_timer.eq(0)
                    m.next = "EXPOSE"
            with m.State("EXPOSE"):
                m.d.sync += [begun.eq(0), over.eq(0), waited.eq(0)]
                with m.If(exposure.integrated):
                    m.next = "READ"
            with m.State("READ"):
                m.d.sync += [begun.eq(begins), over.eq(over | ends)]
                with m.If(whole & ~over):
                    m.d.sync += [self.heartbeat.eq(self.heartbeat + 1), self.silent.eq(0)]
                with m.If(missing):
                    m.d.sync += [
                        self.silent.eq(1),
                        self.timeouts.eq(self.timeouts + ~self.timeouts.all()),
                    ]
                with m.If(missing | ends & ~whole):
                    m.d.sync += warm_up_timer.eq(0)
                with m.If(missing | over & ~exposure.busy & (~self.sending | too_long)):
                    m.next = "NEXT"
            with m.State("NEXT"):
                m.d.sync += texture.eq(0)
                m.next = "WAIT"
                with m.If(~texture & ~warm_up_frame & (mode_now != Mode.PATTERN)):
                    m.d.sync += texture.eq(1)
                    m.next = "BEGIN"
            with m.State("WAIT"):
                with m.If(stopped):
                    m.next = "IDLE"
                with m.Elif(tick & (warm_up_frame | ~remaining[1:].any())):
                    with m.If(~warm_up_frame & ~remaining.any()):
                        m.d.sync += self.late.eq(self.late + ~self.late.all())
                    m.next = "BEGIN"
        m.d.comb += self.running.eq(~schedule.ongoing("IDLE"))
        with m.If(self.mode != Mode.SINGLE):
            m.d.sync += single_pending.eq(1)
        self._tag(m, exposure, texture | as_image)
        return m

    def _outcome(self, m, begun, over, waited):
        """What has come of the frame, in this clock."""
        begins, whole, ends, missing = Signal(), Signal(), Signal(), Signal()
        too_long = Signal()
        m.d.comb += [
            begins.eq(begun | self.frame_begun),
            whole.eq(self.frame_ended & begins),
            ends.eq(whole | self.frame_broken & begins),
            too_long.eq(waited == self.frame_us),
            missing.eq(~over & ~ends & (too_long | ~begins & (waited >= self.begin_us))),
        ]
        return begins, whole, ends, missing, too_long

    def _tag(self, m, exposure, as_texture):
        """How the frame was exposed, from the end of its integration on."""
        before, timestamp = Signal(), Signal(24)
        lit, capture = Signal(), Signal()
        m.d.sync += before.eq(self.sensor_integrate)
        with m.If(self.sensor_integrate & ~before):
            m.d.sync += [timestamp.eq(self.timestamp_us), lit.eq(self.lit),
                         capture.eq(self.capture)]
        with m.Else():
            m.d.sync += [lit.eq(lit | self.lit), capture.eq(capture | self.capture)]
        with m.If(exposure.integrated):
            m.d.sync += [
                self.tag.texture.eq(as_texture),
                self.tag.laser.eq(lit | self.lit),
                self.tag.capture.eq(capture),
                self.tag.exposure_us.eq(exposure.latched_us),
                self.tag.timestamp_us.eq(timestamp),
            ]
