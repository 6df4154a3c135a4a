"""The laser guard beside an observer that knows nothing but its pins.

Every input is free in every clock, reset included, from a power-up with any bits in the guard's
registers and one clock of reset on. In each clock one bit of the registers may flip. The
observer's own state is never reset, and its ceilings are its own.
"""

from dataclasses import dataclass

from amaranth.hdl import (
    Cat,
    Elaboratable,
    Fragment,
    Module,
    Mux,
    ResetSignal,
    Signal,
    Value,
)

from tb.formal import symbiyosys as formal
from tb.formal.guard_links import link_guard, link_pulses, link_window
from tb.formal.upsets import Upsets, without_initial_values

__all__ = ["Ceilings", "GuardProof"]


@dataclass(frozen=True)
class Ceilings:
    """What the README says that the guard keeps, in the order of its constructor's arguments."""

    clock_hz: int = 16_000_000
    pulse_us: int = 1000
    repetition_us: int = 20_000
    window_us: int = 40_000
    window_on_us: int = 1000
    heartbeat_us: int = 60_000

    def clocks(self, microseconds):
        return self.clock_hz * microseconds // 1_000_000


class GuardProof(Elaboratable):
    """Properties of ``guard``, by the names of :attr:`PROPERTIES`.

    An upset is a bit that flips in a register of the guard, except in those of :attr:`REPORTS`,
    on which light does not depend. The properties allow for an upset what they allow for a reset.

    Parameters
    ----------
    guard : :class:`hdl.acquisition.laser_guard.LaserGuard`
        Any, also one with a planted fault.
    ceilings : :class:`Ceilings`
        What it has to keep.
    properties : collection of :class:`str`
        Those to assert.
    linked : :class:`bool`
        Also assert what ties the guard's registers to the observer's: the auxiliary invariants
        with which the induction closes. Without them only pins are looked at.
    upsets : :class:`bool`
        Bits may flip.
    """

    REPORTS = ("lit", "causes")
    PROPERTIES = {
        "pulse": "a pulse has no more edges than its ceiling",
        "repetition": "from first edge to first edge it is at least the repetition time",
        "window": "no window, wherever it begins, holds more edges than its ceiling",
        "reset": "the pin is low in the clock after a reset or an upset",
        "request": "the pin is low in the clock after one without a request",
        "armed": "the pin is low in the clock after one in which the guard was not armed",
        "arming": "armed is tables or capture, and a live heartbeat, and a window since the reset",
        "granted": "armed, below the ceilings and not yet refused, a request has its edge at once",
        "stays_dark": "a request once dark stays dark until it goes low",
        "lit": "`lit` indicates that the pin changes",
        "reported": "each dark request has a cause, until clear",
        "upset": "each upset is a cause, until clear",
        "sticky": "causes stay until clear, each for itself",
        "silence": "a heartbeat that stops is reported",
    }

    def __init__(self, guard, ceilings=None, properties=None, linked=True, upsets=True):
        self.guard = guard
        self.ceilings = Ceilings() if ceilings is None else ceilings
        self.properties = tuple(self.PROPERTIES if properties is None else properties)
        self.linked = linked
        self.start = Signal()  # a window may begin now
        self.inside = Fragment.get(guard, None)
        self.upsets, self.may_flip = Upsets(self.inside), upsets

    @property
    def ports(self):
        """Free inputs."""
        guard = self.guard
        return [guard.request, guard.tables_valid, guard.capture, guard.heartbeat, guard.clear,
                self.start, self.upsets.target]

    def to_rtlil(self):
        """The proof as text, with a guard that has no initial values."""
        return without_initial_values(formal.to_rtlil(self), "top.guard")

    def elaborate(self, platform):
        m = Module()
        m.submodules.guard = self.inside
        self.registers = []
        self.powered = self.register(1, "powered")  # the first clock, one of reset, is over
        m.d.sync += self.powered.eq(1)
        formal.assume(m, "reset_first", self.powered | ResetSignal())
        if not self.may_flip:
            formal.assume(m, "no_flip", self.upsets.target == self.upsets.bits)
        hits = {name: self.upsets.hit(name) for name in self.upsets.flops}
        self.hit = Signal()  # an upset
        self.restart = Signal()
        m.d.comb += [
            self.hit.eq(Cat(hits[name] for name in hits if name not in self.REPORTS).any()),
            self.restart.eq(ResetSignal() | self.hit),
        ]
        self.hit_causes, self.hit_lit = hits["causes"], hits["lit"]
        self._light(m)
        self._any_window(m)
        self._arming(m)
        self._refusals(m)
        if self.linked:
            link_guard(m, self)
            link_window(m, self)
            link_pulses(m, self)
        return m

    def register(self, shape, name, init=0):
        """Never reset, as the observer's memory must not depend on what it observes."""
        register = Signal(shape, name=name, init=init, reset_less=True)
        self.registers.append(register)
        return register

    def _claim(self, m, name, statement, when=1):
        if name in self.properties:
            formal.claim(m, name, Value.cast(statement) | ~(Value.cast(when).bool() & self.powered))

    @property
    def clocks(self):
        """Ceilings in clocks: pulse, repetition, window, light in it, heartbeat."""
        ceilings = self.ceilings
        return tuple(map(ceilings.clocks, (
            ceilings.pulse_us, ceilings.repetition_us, ceilings.window_us, ceilings.window_on_us,
            ceilings.heartbeat_us)))

    def _light(self, m):
        """What the pin does, and the three latest pulses."""
        pulse, repetition, window, window_on, _ = self.clocks
        self.far = far = window + pulse  # pulses older than this are out of every window
        pin, last, moved = self.guard.laser, self.register(1, "last"), self.register(1, "moved")
        self.last, self.moved = last, moved
        self.edge, self.rise = edge, rise = Signal(), Signal()
        m.d.comb += [edge.eq((pin != last) & self.powered), rise.eq(edge & ~moved)]
        m.d.sync += [last.eq(pin & self.powered), moved.eq(edge)]

        # Age of the first edge of pulse a, from there to b's, from b's to c's.
        self.age = age = self.register(range(far + 1), "age", far)
        self.gap_b = self.register(range(far + 1), "gap_b", far)
        self.gap_c = self.register(range(far + 1), "gap_c", far)
        self.edges = tuple(self.register(range(pulse + 2), f"edges_{name}") for name in "abc")
        m.d.sync += [register.eq(following) for register, following in zip(
            (age, self.gap_b, self.gap_c, *self.edges), self.after(edge), strict=True)]
        edges_a_n = self.after(edge)[3]
        self._claim(m, "pulse", edges_a_n <= pulse)
        self._claim(m, "repetition", age >= repetition, when=rise)

    def after(self, edge):
        """What age, gaps and edges become if the pin has, or has not, an edge now."""
        edges_a, edges_b, _ = self.edges
        rise = edge & ~self.moved
        most = self.clocks[0]
        return (
            Mux(rise, 1, Mux(self.age == self.far, self.far, self.age + 1)),
            Mux(rise, self.age, self.gap_b),
            Mux(rise, self.gap_b, self.gap_c),
            Mux(rise, 1, Mux(edges_a > most, edges_a, edges_a + edge)),
            Mux(rise, edges_a, edges_b),
            Mux(rise, edges_b, self.edges[2]),
        )

    def _any_window(self, m):
        """Light in a window that begins at any time."""
        _, _, window, window_on, _ = self.clocks
        self.open = open_ = self.register(1, "open")
        self.seen = seen = self.register(range(window + 1), "seen")
        self.light = light = self.register(range(window_on + 2), "light")
        light_n = Signal(range(window_on + 3))
        m.d.comb += light_n.eq(Mux(open_, light, 0) + self.edge)
        with m.If(open_ | self.start):
            m.d.sync += [
                open_.eq(~open_ | (seen != window - 1)),
                seen.eq(Mux(open_, seen + 1, 1)),
                light.eq(Mux(light_n > window_on, window_on + 1, light_n)),
            ]
        self._claim(m, "window", light_n <= window_on, when=open_ | self.start)

    def _arming(self, m):
        """What must be for light, from the inputs."""
        _, _, window, _, pause = self.clocks
        guard, pin, restart = self.guard, self.guard.laser, self.restart
        self.was_restart, self.was_request, self.was_armed, self.was_hit = (
            self.register(1, name) for name in (
                "was_restart", "was_request", "was_armed", "was_hit"))
        m.d.sync += [
            self.was_restart.eq(restart), self.was_request.eq(guard.request),
            self.was_armed.eq(guard.armed), self.was_hit.eq(self.hit & ~ResetSignal()),
        ]
        self._claim(m, "reset", ~pin, when=self.was_restart)
        self._claim(m, "request", ~pin, when=~self.was_request)
        self._claim(m, "armed", ~pin, when=~self.was_armed)
        self._claim(m, "lit", guard.lit == self.edge,
                    when=~self.was_restart & ~self.hit & ~self.hit_lit)

        self.awake = awake = self.register(range(window + 2), "awake")  # clocks since the reset
        self.token = token = self.register(8, "token_seen")
        # Clocks since the last change, and between the last two.
        self.ago = ago = self.register(range(pause + 2), "ago", pause + 1)
        self.before = before = self.register(range(pause + 2), "before", pause + 1)
        changed, beating = Signal(name="token_changed"), Signal(name="seen_beating")
        self.lapses, lapsed = self.register(1, "lapses"), self.register(1, "lapsed")
        m.d.comb += [
            changed.eq(guard.heartbeat != token),
            beating.eq((ago <= pause) & (before <= pause)),
        ]
        m.d.sync += [
            token.eq(guard.heartbeat),
            awake.eq(Mux(awake > window, awake, awake + 1)),
            ago.eq(Mux(ago > pause, ago, ago + 1)),
            self.lapses.eq((ago == pause) & ~changed & (before <= pause) & ~restart),
            lapsed.eq(self.lapses & ~restart),
        ]
        with m.If(changed):
            m.d.sync += [ago.eq(1), before.eq(ago)]
        with m.If(restart):
            m.d.sync += [awake.eq(0), token.eq(0), ago.eq(pause + 1), before.eq(pause + 1)]
        self._claim(m, "arming", guard.armed == (
            (guard.tables_valid | guard.capture) & beating & (awake > window)), when=~self.hit)
        self._claim(m, "silence", guard.causes[4],
                    when=lapsed & ~self.was_restart & ~self.hit_causes)

    def _refusals(self, m):
        """What is granted and what is refused, and why."""
        pulse, repetition, window, window_on, _ = self.clocks
        guard, edge, restart = self.guard, self.edge, self.restart
        self.dark, self.cleared = self.register(1, "dark"), self.register(1, "cleared")
        refused = self.refused(edge)
        m.d.sync += self.dark.eq((self.dark | refused) & guard.request & ~restart)
        self._claim(m, "stays_dark", ~guard.laser, when=self.dark)

        # Room for an edge: in the pulse that goes on, unless it was closed, or for a new one. The
        # guard's light is even, so ceilings are rounded down.
        self.kept = self.register(1, "kept")
        m.d.sync += self.kept.eq(self.was_request & self.was_armed)
        edges_a, edges_b, _ = self.edges
        before = Mux(self.gap_b < window, edges_b, 0)
        room = Mux(
            self.moved,
            self.kept & (edges_a < pulse & ~1) & (edges_a + before < window_on & ~1),
            (self.age >= repetition) & ((self.age >= window) | (edges_a < window_on & ~1)))
        self._claim(m, "granted", edge, when=room & self.was_request & self.was_armed
                    & ~self.was_restart & ~self.dark & ~self.hit)

        m.d.sync += self.cleared.eq(guard.request & ~restart & (
            self.cleared | guard.clear | self.hit_causes))
        self._claim(m, "reported", guard.causes.any(),
                    when=refused & ~self.cleared & ~self.hit & ~self.hit_causes)
        causes = self.register(len(guard.causes), "causes_seen")
        m.d.sync += causes.eq(Mux(guard.clear, 0, guard.causes))
        self._claim(m, "sticky", (causes & ~guard.causes) == 0,
                    when=(~self.was_restart | self.was_hit) & ~self.hit_causes)
        self._claim(m, "upset", guard.causes[5], when=self.was_hit & ~self.hit_causes)

    def refused(self, edge):
        """A request that the last clock had is dark now, if there is this edge or none."""
        return self.was_request & ~self.was_restart & ~edge
