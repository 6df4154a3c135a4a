"""The ceilings on laser light that no input can pass."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from ..protocol import GUARD_CAUSES, GUARD_LIMITS_US

__all__ = ["LaserGuard"]


class LaserGuard(wiring.Component):
    """Gates the sequencer's request for the laser, and trusts none of its inputs.

    While the laser is on, the pin toggles with every clock, for an AC-coupled driver; otherwise it
    stays low. A stopped clock is therefore dark. Light is counted in edges of the pin, the closing
    one included; how long the driver stays on after an edge is not counted.

    All limits are constructor arguments; no input changes them. In edges and clocks of the pin,
    whatever the inputs do, reset included (``make prove``):

    * a pulse (edges in successive clocks) is no longer than ``pulse_us``;
    * from the first edge of a pulse to that of the next it is at least ``repetition_us``;
    * any ``window_us`` hold at most ``window_on_us`` of edges.

    The last of these follows from a simple rule. A pulse may be as long as ``window_on_us``, less
    the length of the pulse before if that began less than ``window_us`` earlier. As pulses begin at
    least half a window apart, a window that ends in pulse k and holds all of k - 1 holds no more of
    k than it lacks at the start of k - 2, so it holds at most k - 2 and k - 1.

    The guard is armed while ``tables_valid`` or ``capture`` is high, the heartbeat continues, and a
    window has passed since the reset, which clears the record of past light. ``heartbeat`` must
    change at least every ``heartbeat_us``. If it did not, two changes within that time of each
    other arm the guard again. A request that is refused or cut is dark from the next clock on,
    until it has gone low; ``causes`` holds the reason. The sequencer should request light only
    while ``armed`` is high, so that a start does not count as a fault.

    A pin that is high when its light ends needs one closing edge. Reset: dark.

    Parameters
    ----------
    clock_hz : :class:`int`
        Frequency of ``sync``, a multiple of 1 MHz.
    pulse_us, repetition_us, window_us, window_on_us : :class:`int`
        Ceilings, in microseconds. The ones of light are rounded down to an even number of clocks.
    heartbeat_us : :class:`int`
        Longest time between two changes of ``heartbeat``.

    Members
    -------
    request : :py:`In(1)`
        Requests light.
    tables_valid : :py:`In(1)`
        A set of tables has been checked.
    capture : :py:`In(1)`
        Allows light without tables, for a calibration.
    heartbeat : :py:`In(8)`
        Changes with each sign of life.
    clear : :py:`In(1)`
        Clears the causes, except those of this clock.
    laser : :py:`Out(1)`
        The pin.
    lit : :py:`Out(1)`
        The pin has just changed, so there is light.
    armed : :py:`Out(1)`
        A request would be granted, within the ceilings.
    causes : :py:`Out(5)`
        What was refused, bits in the order of :data:`hdl.protocol.GUARD_CAUSES`, until ``clear``.
        A request while not armed counts as ``heartbeat`` if that has stopped, as ``not_armed`` if
        anything else is missing.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``request`` to the pin's first edge.
    """

    latency = 1

    def __init__(self, clock_hz=16_000_000, pulse_us=GUARD_LIMITS_US["pulse"],
                 repetition_us=GUARD_LIMITS_US["repetition"], window_us=GUARD_LIMITS_US["window"],
                 window_on_us=GUARD_LIMITS_US["window_on"],
                 heartbeat_us=GUARD_LIMITS_US["heartbeat"]):
        if not isinstance(clock_hz, int) or clock_hz <= 0 or clock_hz % 1_000_000:
            raise ValueError("The guard's clock must be a positive multiple of 1,000,000 Hz, "
                             f"not {clock_hz!r}")
        for name, value in (("pulse", pulse_us), ("repetition", repetition_us),
                            ("window", window_us), ("light in a window", window_on_us),
                            ("heartbeat", heartbeat_us)):
            if not isinstance(value, int) or isinstance(value, bool) or value <= 0:
                raise ValueError(f"The guard's time for {name} must be a positive integer of "
                                 f"microseconds, not {value!r}")
        if pulse_us >= repetition_us:
            raise ValueError("A pulse must be shorter than the time from pulse to pulse, but "
                             f"{pulse_us} us is not below {repetition_us} us")
        if window_us > 2 * repetition_us:
            raise ValueError("The guard's rule holds for a window of at most two repetition times,"
                             f" but {window_us} us is more than 2 x {repetition_us} us")
        if window_us < repetition_us:
            raise ValueError("The window must not be shorter than the time from pulse to pulse, "
                             f"but {window_us} us is below {repetition_us} us")
        if window_on_us > window_us:
            raise ValueError("A window cannot hold more light than time, but "
                             f"{window_on_us} us is more than {window_us} us")
        clocks = clock_hz // 1_000_000
        self.pulse = pulse_us * clocks & ~1
        self.repetition = repetition_us * clocks
        self.window = window_us * clocks
        self.window_on = window_on_us * clocks & ~1
        self.pause = heartbeat_us * clocks
        if min(self.pulse, self.window_on) < 2:
            raise ValueError("The shortest light is two clocks, but the ceilings are "
                             f"{pulse_us} and {window_on_us} us of {clocks} clocks each")
        super().__init__({
            "request": In(1),
            "tables_valid": In(1),
            "capture": In(1),
            "heartbeat": In(8),
            "clear": In(1),
            "laser": Out(1),
            "lit": Out(1),
            "armed": Out(1),
            "causes": Out(len(GUARD_CAUSES)),
        })

    def elaborate(self, platform):
        m = Module()

        # Signs of life.
        token = Signal(8)
        silence = Signal(range(self.pause + 2))  # clocks since the token changed
        beats = Signal(range(3))  # changes since silence was too long, at most two
        beating = Signal()
        changed = Signal()
        silent = Signal()
        m.d.comb += [
            changed.eq(self.heartbeat != token),
            silent.eq(silence > self.pause),
            beating.eq(beats[1] & ~silent),
        ]
        m.d.sync += token.eq(self.heartbeat)
        with m.If(changed):
            m.d.sync += silence.eq(1)
            with m.If(silent):
                m.d.sync += beats.eq(1)
            with m.Elif(~beats[1]):
                m.d.sync += beats.eq(beats + 1)
        with m.Elif(silent):
            m.d.sync += beats.eq(0)
        with m.Else():
            m.d.sync += silence.eq(silence + 1)

        # Light so far.
        since = Signal(range(self.window + 1))  # from the last pulse's first edge to the next clock
        rested = Signal()  # a window has passed since the reset
        length = Signal(range(self.pulse + 1))  # of the pulse, or of the one before
        spent = Signal(range(max(self.pulse, self.window_on) + 1))  # the same and the one before
        begun = Signal.like(spent)  # what a pulse that began now would already have spent
        far = Signal()
        m.d.comb += [
            far.eq(since >= self.window),
            begun.eq(Mux(far, 0, length)),
        ]
        with m.If(far):
            m.d.sync += rested.eq(1)
        with m.Else():
            m.d.sync += since.eq(since + 1)

        # The request against the ceilings.
        permitted = Signal()
        pulsing = Signal()
        blocked = Signal()
        allowed = Signal()
        fresh = Signal()
        go = Signal()
        m.d.comb += [
            permitted.eq(self.tables_valid | self.capture),
            self.armed.eq(permitted & beating & rested),
            fresh.eq(~pulsing & (since >= self.repetition) & (begun < self.window_on)),
            allowed.eq(pulsing & (length < self.pulse) & (spent < self.window_on)),
            go.eq(self.request & self.armed & ~blocked & (fresh | allowed)),
        ]
        m.d.sync += [
            pulsing.eq(go),
            blocked.eq(self.request & ~go),
            self.laser.eq(go & ~self.laser),
            self.lit.eq(go | self.laser),
        ]
        with m.If(go & ~pulsing):
            m.d.sync += [since.eq(1), length.eq(1), spent.eq(begun + 1)]
        with m.Elif(go | self.laser):
            m.d.sync += [length.eq(length + 1), spent.eq(spent + 1)]

        # The causes of a refusal.
        requested = Signal()
        now = Signal(len(GUARD_CAUSES))
        m.d.comb += requested.eq(self.request & ~blocked)
        reasons = {
            "pulse": requested & self.armed & pulsing & (length >= self.pulse),
            "repetition": requested & self.armed & ~pulsing & (since < self.repetition),
            "duty": requested & self.armed & Mux(
                pulsing, (length < self.pulse) & (spent >= self.window_on),
                (since >= self.repetition) & (begun >= self.window_on)),
            "not_armed": requested & ~(permitted & rested),
            "heartbeat": (silent & beats[1]) | (requested & ~beating),
        }
        m.d.comb += now.eq(Cat(reasons[name] for name in GUARD_CAUSES))
        m.d.sync += self.causes.eq(now | Mux(self.clear, 0, self.causes))
        return m
