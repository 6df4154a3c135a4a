"""The ceilings on laser light that no input can pass."""

from amaranth import *
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from ..protocol import GUARD_CAUSES, GUARD_LIMITS_US
from .checked_register import CheckedRegister

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

    All of this holds from the first reset on, whatever was in the registers at power-up, and also
    if bits of the registers flip, in each clock not more than one (``make prove``). Registers that
    light depends on have a parity, and the pin is high only while two registers say so, of which
    one flip makes none. In the clock of the flip the pin has at most the edge that was due. Then
    the guard begins again, as after a reset: no light for a window, and two changes of the
    heartbeat before the next. Only the causes stay, with ``upset`` among them. In ``causes`` and
    ``lit``, which only report, a flip is not seen. Synthesis must not merge registers that are
    equal in every reachable state.

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
    causes : :py:`Out(6)`
        What was refused, bits in the order of :data:`hdl.protocol.GUARD_CAUSES`, until ``clear``.
        A request while not armed counts as ``heartbeat`` if that has stopped, as ``not_armed`` if
        anything else is missing.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``request`` to the pin's first edge.
    """

    latency = 1
    FLAGS = data.StructLayout({
        "beats": 2,  # changes since silence was too long, at most two
        "rested": 1,  # a window has passed since the reset
        "apart": 1,  # the repetition time has passed
        "pulsing": 1,  # the last edge was requested
        "blocked": 1,  # until the request has gone low
        "pin": 1,
    })

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
        # All that light depends on, but for the inputs.
        token = CheckedRegister(8, "token")
        silence = CheckedRegister(range(self.pause + 2), "silence")  # since the token changed
        # From the last pulse's first edge, or the reset, to the next clock; at most a window.
        since = CheckedRegister(range(self.window + 1), "since")
        length = CheckedRegister(range(self.pulse + 1), "length")  # of the pulse, or the last one
        # The same, and the one before if it counts.
        spent = CheckedRegister(range(self.window_on + 1), "spent")
        flags = CheckedRegister(self.FLAGS, "flags")
        checked = (token, silence, since, length, spent, flags)
        state, following = flags.value, Signal(self.FLAGS)
        wrong, upset = Signal(len(checked), attrs={"keep": 1}), Signal()
        m.d.comb += [
            following.eq(state),
            wrong.eq(Cat(register.upset for register in checked)),
            upset.eq(wrong.any()),
        ]
        m.d.sync += flags.eq(following)

        # Signs of life.
        changed, silent, beating = Signal(), Signal(), Signal()
        m.d.comb += [
            changed.eq(self.heartbeat != token.value),
            silent.eq(silence.value > self.pause),
            beating.eq(state.beats[1] & ~silent),
        ]
        m.d.sync += token.eq(self.heartbeat)
        with m.If(changed):
            m.d.sync += silence.eq(1)
            with m.If(silent):
                m.d.comb += following.beats.eq(1)
            with m.Elif(~state.beats[1]):
                m.d.comb += following.beats.eq(state.beats + 1)
        with m.Elif(silent):
            m.d.comb += following.beats.eq(0)
        with m.Else():
            m.d.sync += silence.eq(silence.value + 1)

        # Light so far.
        far = Signal()
        begun = Signal.like(spent.value)  # what a pulse that began now would already have spent
        whole, used, none_left = Signal(), Signal(), Signal()
        m.d.comb += [
            far.eq(since.value == self.window),
            begun.eq(Mux(far, 0, length.value)),
            whole.eq(length.value == self.pulse),
            used.eq(spent.value == self.window_on),
            none_left.eq(~far & (length.value == self.window_on)),
        ]
        with m.If(far):
            m.d.comb += following.rested.eq(1)
        with m.Else():
            m.d.sync += since.eq(since.value + 1)
        with m.If(since.value == self.repetition - 1):
            m.d.comb += following.apart.eq(1)

        # The request against the ceilings.
        permitted, fresh, allowed, go = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [
            permitted.eq(self.tables_valid | self.capture),
            self.armed.eq(permitted & beating & state.rested),
            fresh.eq(~state.pulsing & state.apart & ~none_left),
            allowed.eq(state.pulsing & ~whole & ~used),
            go.eq(self.request & self.armed & ~state.blocked & (fresh | allowed)),
            following.pulsing.eq(go),
            following.blocked.eq(self.request & ~go),
            following.pin.eq(go & ~state.pin),
            self.laser.eq(state.pin & length.value[0]),  # equal, unless one has flipped
        ]
        m.d.sync += self.lit.eq((go | state.pin) & ~upset)
        rise = Signal()
        m.d.comb += rise.eq(go & ~state.pulsing)
        with m.If(rise):
            m.d.comb += following.apart.eq(0)
            m.d.sync += [since.eq(1), length.eq(1), spent.eq(begun + 1)]
        with m.Elif(go | state.pin):
            m.d.sync += [length.eq(length.value + 1), spent.eq(spent.value + 1)]
        with m.If(upset):
            m.d.sync += [register.eq(0) for register in checked]

        # The causes of a refusal.
        requested = Signal()
        now = Signal(len(GUARD_CAUSES))
        m.d.comb += requested.eq(self.request & ~state.blocked & ~upset)
        reasons = {
            "pulse": requested & self.armed & state.pulsing & whole,
            "repetition": requested & self.armed & ~state.pulsing & ~state.apart,
            "duty": requested & self.armed & Mux(
                state.pulsing, ~whole & used, state.apart & none_left),
            "not_armed": requested & ~(permitted & state.rested),
            "heartbeat": (silent & state.beats[1] & ~upset) | (requested & ~beating),
            "upset": upset,
        }
        m.d.comb += now.eq(Cat(reasons[name] for name in GUARD_CAUSES))
        m.d.sync += self.causes.eq(now | Mux(self.clear, 0, self.causes))
        return m
