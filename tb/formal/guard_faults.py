"""Faults planted in the laser guard, each a change of its text, to be found by the proof."""

from dataclasses import dataclass

from tb.formal.altered import altered

__all__ = ["FAULTS", "SCALED", "Fault", "guard_class"]

#: Ceilings so small that a counterexample is some tens of clocks long: as by default, where one
#: pulse takes the whole window's light; and where a window holds one and a half.
SCALED = ((1_000_000, 4, 8, 16, 4, 9), (1_000_000, 4, 8, 16, 6, 9))


@dataclass(frozen=True)
class Fault:
    """A planted fault.

    ``edits`` are pairs of a text and what stands there instead; one of the properties ``breaks``
    has to fail, with the ceilings ``SCALED[scale]``.
    """

    name: str
    edits: tuple
    breaks: tuple
    scale: int = 0


def _fault(name, old, new, *breaks, scale=0):
    return Fault(name, ((old, new),), breaks, scale)


_FRESH = "fresh.eq(~pulsing & (since >= self.repetition) & (begun < self.window_on)),"
_ALLOWED = "allowed.eq(pulsing & (length < self.pulse) & (spent < self.window_on)),"
_GO = "go.eq(self.request & self.armed & ~blocked & (fresh | allowed)),"
_ARMED = "self.armed.eq(permitted & beating & rested),"
_CAUSES = "self.causes.eq(now | Mux(self.clear, 0, self.causes))"
_LASER = "self.laser.eq(go & ~self.laser),"
_BEFORE = "        # The causes of a refusal.\n"

FAULTS = (
    _fault("pulse one clock longer", _ALLOWED, "allowed.eq(pulsing & (length <= self.pulse) & "
           "(spent < self.window_on)),", "pulse", scale=1),
    _fault("no ceiling for a pulse", _ALLOWED, "allowed.eq(pulsing & (spent < self.window_on)),",
           "pulse", scale=1),
    _fault("repetition one clock shorter", _FRESH, "fresh.eq(~pulsing & "
           "(since >= self.repetition - 1) & (begun < self.window_on)),", "repetition", scale=1),
    _fault("no repetition time", _FRESH, "fresh.eq(~pulsing & (begun < self.window_on)),",
           "repetition", scale=1),
    _fault("window one clock shorter", "far.eq(since >= self.window)",
           "far.eq(since >= self.window - 1)", "window"),
    _fault("no window rule", "begun.eq(Mux(far, 0, length))", "begun.eq(0)", "window"),
    _fault("window rule only when a pulse begins", _ALLOWED,
           "allowed.eq(pulsing & (length < self.pulse)),", "window", scale=1),
    _fault("window rule only while a pulse goes on", _FRESH,
           "fresh.eq(~pulsing & (since >= self.repetition)),", "window"),
    _fault("window light one clock more", _ALLOWED, "allowed.eq(pulsing & (length < self.pulse) & "
           "(spent <= self.window_on)),", "window", scale=1),
    _fault("the closing edge is not counted", "with m.Elif(go | self.laser):", "with m.Elif(go):",
           "window", scale=1),
    _fault("request gated by nothing", _GO, "go.eq(self.request),",
           "pulse", "armed", "repetition", "window"),
    _fault("gated by arming alone", _GO, "go.eq(self.request & self.armed & ~blocked),",
           "pulse", "repetition", "window"),
    _fault("arming ignored", _GO, "go.eq(self.request & ~blocked & (fresh | allowed)),", "armed"),
    _fault("light without a request", _GO, "go.eq(self.armed & ~blocked & (fresh | allowed)),",
           "request"),
    _fault("armed without tables", _ARMED, "self.armed.eq(beating & rested),", "arming"),
    _fault("capture arms without a heartbeat", _ARMED,
           "self.armed.eq((self.capture | (permitted & beating)) & rested),", "arming"),
    _fault("armed without a heartbeat", _ARMED, "self.armed.eq(permitted & rested),", "arming"),
    _fault("one beat arms", "beating.eq(beats[1] & ~silent)", "beating.eq(beats.any() & ~silent)",
           "arming"),
    _fault("silence one clock longer", "silent.eq(silence > self.pause)",
           "silent.eq(silence >= self.pause + 1 + (token == 0))", "arming", "silence"),
    _fault("a late beat forgives silence", "with m.If(silent):", "with m.If(C(0)):", "arming"),
    _fault("a fallen request restarts the time", _BEFORE,
           "        with m.If(~self.request & ~self.laser):\n"
           "            m.d.sync += since.eq(self.window)\n", "repetition", "window", scale=1),
    _fault("a fallen request restarts the light", _BEFORE,
           "        with m.If(~self.request & ~self.laser):\n"
           "            m.d.sync += length.eq(0)\n", "window"),
    _fault("clear restarts the light", _BEFORE, "        with m.If(self.clear):\n"
           "            m.d.sync += [length.eq(0), spent.eq(0)]\n", "pulse", "window", scale=1),
    Fault("a reset forgets the light", (
        ("since = Signal(range(self.window + 1))",
         "since = Signal(range(self.window + 1), init=self.window)"),
        ("rested = Signal()", "rested = Signal(init=1)")), ("arming", "repetition", "window")),
    Fault("a reset leaves the pin", (
        ("        rested = Signal()", "        pin = Signal(reset_less=True)\n"
         "        rested = Signal()"),
        (_LASER, "pin.eq(go & ~self.laser),"),
        (_BEFORE, "        m.d.comb += self.laser.eq(pin)\n")), ("reset",)),
    _fault("the pin may stop high", _LASER, "self.laser.eq(go ^ self.laser),", "request", "armed"),
    _fault("a level instead of edges", _LASER, "self.laser.eq(go),", "lit"),
    _fault("a cut request comes back", "blocked.eq(self.request & ~go)", "blocked.eq(0)",
           "stays_dark"),
    _fault("causes do not stay", _CAUSES, "self.causes.eq(now)", "sticky"),
    _fault("a cause pushes out another", _CAUSES,
           "self.causes.eq(Mux(now.any(), now, Mux(self.clear, 0, self.causes)))", "sticky"),
    _fault("clear takes the cause of its clock", _CAUSES,
           "self.causes.eq(Mux(self.clear, 0, now | self.causes))", "reported", "silence"),
    *(_fault(f"the cause {cause} is lost", f'"{cause}": ', f'"{cause}": C(0) & ', "reported")
      for cause in ("pulse", "repetition", "duty", "not_armed")),
    _fault("the cause heartbeat is lost", "(silent & beats[1]) | (requested", "(requested",
           "silence"),
)


def guard_class(fault=None):
    """:class:`hdl.acquisition.laser_guard.LaserGuard`, with ``fault`` if one is given."""
    return altered("hdl.acquisition.laser_guard", fault.edits if fault else ()).LaserGuard
