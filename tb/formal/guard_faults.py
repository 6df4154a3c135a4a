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
    has to fail, with the ceilings ``SCALED[scale]``; if ``upset``, as soon as bits may flip.
    """

    name: str
    edits: tuple
    breaks: tuple
    scale: int = 0
    upset: bool = False


def _fault(name, old, new, *breaks, **options):
    return Fault(name, ((old, new),), breaks, **options)


_FRESH = "fresh.eq(~state.pulsing & state.apart & ~none_left),"
_ALLOWED = "allowed.eq(state.pulsing & ~whole & ~used),"
_GO = "go.eq(self.request & self.armed & ~state.blocked & (fresh | allowed)),"
_ARMED = "self.armed.eq(permitted & beating & state.rested),"
_CAUSES = "self.causes.eq(now | Mux(self.clear, 0, self.causes))"
_PIN = "following.pin.eq(go & ~state.pin),"
_LASER = "self.laser.eq(state.pin & length.value[0]),"
_APART = "with m.If(since.value == self.repetition - 1):"
_UPSET = "wrong.eq(Cat(register.upset for register in checked)),"
_BEFORE = "        # The causes of a refusal.\n"

FAULTS = (
    _fault("pulse one clock longer", "whole.eq(length.value == self.pulse)",
           "whole.eq(length.value > self.pulse)", "pulse", scale=1),
    _fault("no ceiling for a pulse", _ALLOWED, "allowed.eq(state.pulsing & ~used),",
           "pulse", scale=1),
    _fault("pulse of twice the time", "self.pulse = pulse_us * clocks & ~1",
           "self.pulse = 2 * pulse_us * clocks & ~1", "pulse", scale=1),
    _fault("repetition one clock shorter", _APART,
           "with m.If(since.value == self.repetition - 2):", "repetition", scale=1),
    _fault("no repetition time", _FRESH, "fresh.eq(~state.pulsing & ~none_left),",
           "repetition", scale=1),
    _fault("repetition of half the time", "self.repetition = repetition_us * clocks",
           "self.repetition = repetition_us * clocks // 2", "repetition", scale=1),
    _fault("window one clock shorter", "far.eq(since.value == self.window)",
           "far.eq(since.value == self.window - 1)", "window"),
    _fault("window of half the time", "self.window = window_us * clocks",
           "self.window = window_us * clocks // 2", "window"),
    Fault("no window rule", (
        ("none_left.eq(~far & (length.value == self.window_on)),", "none_left.eq(0),"),
        ("begun.eq(Mux(far, 0, length.value)),", "begun.eq(0),")), ("window",)),
    _fault("window rule only when a pulse begins", _ALLOWED,
           "allowed.eq(state.pulsing & ~whole),", "window", scale=1),
    _fault("window rule only while a pulse goes on", _FRESH,
           "fresh.eq(~state.pulsing & state.apart),", "window"),
    _fault("window light two clocks more", "self.window_on = window_on_us * clocks & ~1",
           "self.window_on = (window_on_us * clocks & ~1) + 2", "window", scale=1),
    _fault("the closing edge is not counted", "with m.Elif(go | state.pin):",
           "with m.Elif(go):", "pulse", "window", scale=1),
    _fault("the pulse before is not counted", "spent.eq(begun + 1)", "spent.eq(1)", "window",
           scale=1),
    _fault("request gated by nothing", _GO, "go.eq(self.request),",
           "pulse", "armed", "repetition", "window"),
    _fault("gated by arming alone", _GO, "go.eq(self.request & self.armed & ~state.blocked),",
           "pulse", "repetition", "window"),
    _fault("arming ignored", _GO, "go.eq(self.request & ~state.blocked & (fresh | allowed)),",
           "armed"),
    _fault("light without a request", _GO,
           "go.eq(self.armed & ~state.blocked & (fresh | allowed)),", "request"),
    _fault("armed without tables", _ARMED, "self.armed.eq(beating & state.rested),", "arming"),
    _fault("capture arms without a heartbeat", _ARMED, "self.armed.eq("
           "(self.capture | (permitted & beating)) & state.rested),", "arming"),
    _fault("armed without a heartbeat", _ARMED, "self.armed.eq(permitted & state.rested),",
           "arming"),
    _fault("one beat arms", "beating.eq(state.beats[1] & ~silent)",
           "beating.eq(state.beats.any() & ~silent)", "arming"),
    _fault("silence one clock longer", "silent.eq(silence.value > self.pause)",
           "silent.eq(silence.value >= self.pause + 1 + (token.value == 0))",
           "arming", "silence"),
    _fault("a heartbeat of twice the time", "self.pause = heartbeat_us * clocks",
           "self.pause = 2 * heartbeat_us * clocks", "arming"),
    _fault("a late beat forgives silence", "with m.If(silent):", "with m.If(C(0)):", "arming"),
    _fault("a fallen request restarts the time", _BEFORE,
           "        with m.If(~self.request & ~state.pin):\n"
           "            m.d.sync += since.eq(self.window)\n", "repetition", "window", scale=1),
    _fault("a fallen request restarts the light", _BEFORE,
           "        with m.If(~self.request & ~state.pin):\n"
           "            m.d.sync += length.eq(0)\n", "window"),
    _fault("clear restarts the light", _BEFORE, "        with m.If(self.clear & ~state.pin):\n"
           "            m.d.sync += [length.eq(2), spent.eq(2)]\n", "pulse", "window", scale=1),
    Fault("a reset leaves the pin", (
        ("        far = Signal()\n", "        far, held = Signal(), Signal(reset_less=True)\n"
         "        m.d.sync += held.eq(following.pin)\n"),
        (_LASER, "self.laser.eq(held),")), ("reset",)),
    _fault("the pin may stop high", _PIN, "following.pin.eq(go ^ state.pin),",
           "request", "armed", "lit"),
    _fault("a level instead of edges", _PIN, "following.pin.eq(go),", "lit"),
    _fault("a cut request comes back", "following.blocked.eq(self.request & ~go)",
           "following.blocked.eq(0)", "stays_dark"),
    _fault("causes do not stay", _CAUSES, "self.causes.eq(now)", "sticky"),
    _fault("a cause pushes out another", _CAUSES,
           "self.causes.eq(Mux(now.any(), now, Mux(self.clear, 0, self.causes)))", "sticky"),
    _fault("clear takes the cause of its clock", _CAUSES,
           "self.causes.eq(Mux(self.clear, 0, now | self.causes))", "reported", "silence"),
    *(_fault(f"the cause {cause} is lost", f'"{cause}": ', f'"{cause}": C(0) & ', "reported")
      for cause in ("pulse", "repetition", "duty", "not_armed")),
    _fault("the cause heartbeat is lost", "(silent & state.beats[1] & ~upset) | (requested",
           "(requested", "silence"),
    # Light when all is well.
    _fault("never armed", _ARMED, "self.armed.eq(0),", "arming"),
    _fault("no light at all", _GO, "go.eq(0),", "granted"),
    _fault("pulse one pair of edges shorter", "whole.eq(length.value == self.pulse)",
           "whole.eq(length.value >= self.pulse - 2)", "granted"),
    _fault("one pulse a window", _FRESH, "fresh.eq(~state.pulsing & far),", "granted", scale=1),
    _fault("repetition one clock longer", _APART, "with m.If(since.value == self.repetition):",
           "granted", scale=1),
    _fault("a refusal blocks for good", "following.blocked.eq(self.request & ~go)",
           "following.blocked.eq(state.blocked | (self.request & ~go))", "granted"),
    # Power-up.
    Fault("armed by an initial value", (
        (_ARMED, "self.armed.eq(permitted & beating & (state.rested | early)),"),
        ("        far = Signal()\n", "        far, early = Signal(), Signal(reset_less=True)\n"
         "        m.d.sync += early.eq(early)\n")), ("arming",)),
    _fault("the time since the reset is an initial value", _BEFORE,
           "        since.value._reset_less = since._parity._reset_less = True\n", "arming"),
    _fault("flags are initial values", _BEFORE,
           "        flags.value._reset_less = flags._parity._reset_less = True\n",
           "arming", "reset"),
    # Flipped bits.
    *(_fault(f"flipped bits of {name} are not seen", _UPSET, "wrong.eq(Cat(register.upset "
             f"for register in checked if register is not {name})),", *breaks, scale=1,
             upset=True)
      for name, breaks in (
          ("token", ("arming",)), ("silence", ("arming",)), ("since", ("repetition",)),
          ("length", ("pulse", "window")), ("spent", ("window",)), ("flags", ("repetition",)))),
    _fault("an upset does not restart", "with m.If(upset):", "with m.If(C(0)):",
           "pulse", "repetition", "window", upset=True),
    _fault("an upset leaves the time", "[register.eq(0) for register in checked]",
           "[register.eq(0) for register in checked if register is not since]", "arming",
           upset=True),
    Fault("an upset is seen a clock late", (
        (_UPSET, ""), (_BEFORE, "        m.d.sync += wrong.eq("
                       "Cat(register.upset for register in checked))\n")),
        ("repetition", "pulse"), upset=True),
    _fault("the pin alone", _LASER, "self.laser.eq(state.pin),", "repetition", upset=True),
    _fault("the length alone", _LASER, "self.laser.eq(length.value[0]),", "repetition",
           upset=True),
    _fault("the cause upset is lost", '"upset": upset', '"upset": C(0)', "upset", upset=True),
)


def guard_class(fault=None):
    """:class:`hdl.acquisition.laser_guard.LaserGuard`, with ``fault`` if one is given."""
    return altered("hdl.acquisition.laser_guard", fault.edits if fault else ()).LaserGuard
