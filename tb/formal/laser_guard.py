"""The laser guard beside an observer that knows nothing but its pins.

Every input is free in every clock, reset included. The observer's own state is never reset.
"""

from amaranth.hdl import Cat, Elaboratable, Fragment, Module, Mux, ResetSignal, Signal, Value

from tb.formal import symbiyosys as formal

__all__ = ["GuardProof"]


def _register(shape, name, init=0):
    """Never reset, as the observer's memory must not depend on what it observes."""
    return Signal(shape, name=name, init=init, reset_less=True)


class GuardProof(Elaboratable):
    """Properties of ``guard``, by the names of :attr:`PROPERTIES`.

    Parameters
    ----------
    guard : :class:`hdl.acquisition.laser_guard.LaserGuard`
        Any, also one with a planted fault.
    properties : collection of :class:`str`
        Those to assert.
    linked : :class:`bool`
        Also assert what ties the guard's registers to the observer's: the auxiliary invariants
        with which the induction closes. Without them only pins are looked at.
    """

    PROPERTIES = {
        "pulse": "a pulse has no more edges than its ceiling",
        "repetition": "from first edge to first edge it is at least the repetition time",
        "window": "no window, wherever it begins, holds more edges than its ceiling",
        "reset": "the pin is low in the clock after a reset",
        "request": "the pin is low in the clock after one without a request",
        "armed": "the pin is low in the clock after one in which the guard was not armed",
        "arming": "armed is tables or capture, and a live heartbeat, and a window since the reset",
        "stays_dark": "a request once dark stays dark until it goes low",
        "lit": "`lit` indicates that the pin changes",
        "reported": "each dark request has a cause, until clear",
        "sticky": "causes stay until clear, each for itself",
        "silence": "a heartbeat that stops is reported",
    }

    def __init__(self, guard, properties=None, linked=True):
        self.guard = guard
        self.properties = tuple(self.PROPERTIES if properties is None else properties)
        self.linked = linked
        self.start = Signal()  # a window may begin now

    @property
    def ports(self):
        """Free inputs."""
        guard = self.guard
        return [guard.request, guard.tables_valid, guard.capture, guard.heartbeat, guard.clear,
                self.start]

    def elaborate(self, platform):
        m = Module()
        guard = self.guard
        inside = Fragment.get(guard, platform)
        m.submodules.guard = inside
        pulse, repetition, window = guard.pulse, guard.repetition, guard.window
        window_on, pause = guard.window_on, guard.pause
        far = window + pulse  # pulses older than this are out of every window

        def claim(name, statement, when=1):
            if name in self.properties:
                formal.claim(m, name, Value.cast(statement) | ~Value.cast(when).bool())

        # What the pin does.
        pin, last, moved = guard.laser, _register(1, "last"), _register(1, "moved")
        edge = Signal()
        rise = Signal()
        m.d.comb += [edge.eq(pin != last), rise.eq(edge & ~moved)]
        m.d.sync += [last.eq(pin), moved.eq(edge)]

        # The three latest pulses: age of the first edge of a, from there to b's, from b's to c's.
        age = _register(range(far + 1), "age", far)
        gap_b, gap_c = _register(range(far + 1), "gap_b", far), _register(
            range(far + 1), "gap_c", far)
        edges_a, edges_b, edges_c = (
            _register(range(pulse + 2), f"edges_{name}") for name in "abc")
        state = (age, gap_b, gap_c, edges_a, edges_b, edges_c)
        age_n, gap_b_n, gap_c_n, edges_a_n, edges_b_n, edges_c_n = (
            Signal.like(value, name=f"{value.name}_n", init=0, reset_less=False)
            for value in state)
        m.d.comb += [
            age_n.eq(Mux(rise, 1, Mux(age == far, far, age + 1))),
            gap_b_n.eq(Mux(rise, age, gap_b)),
            gap_c_n.eq(Mux(rise, gap_b, gap_c)),
            edges_a_n.eq(Mux(rise, 1, Mux(edges_a > pulse, edges_a, edges_a + edge))),
            edges_b_n.eq(Mux(rise, edges_a, edges_b)),
            edges_c_n.eq(Mux(rise, edges_b, edges_c)),
        ]
        m.d.sync += [value.eq(following) for value, following in zip(state, (
            age_n, gap_b_n, gap_c_n, edges_a_n, edges_b_n, edges_c_n), strict=True)]
        claim("pulse", edges_a_n <= pulse)
        claim("repetition", age >= repetition, when=rise)

        # Any window.
        open_, seen = _register(1, "open"), _register(range(window + 1), "seen")
        light = _register(range(window_on + 2), "light")
        light_n = Signal(range(window_on + 3))
        m.d.comb += light_n.eq(Mux(open_, light, 0) + edge)
        with m.If(open_ | self.start):
            m.d.sync += [
                open_.eq(~open_ | (seen != window - 1)),
                seen.eq(Mux(open_, seen + 1, 1)),
                light.eq(Mux(light_n > window_on, window_on + 1, light_n)),
            ]
        claim("window", light_n <= window_on, when=open_ | self.start)

        # What must be for light, from the inputs.
        was_reset, was_request, was_armed, was_clear = (
            _register(1, name) for name in ("was_reset", "was_request", "was_armed", "was_clear"))
        reset = ResetSignal()
        m.d.sync += [was_reset.eq(reset), was_request.eq(guard.request),
                     was_armed.eq(guard.armed), was_clear.eq(guard.clear)]
        claim("reset", ~pin, when=was_reset)
        claim("request", ~pin, when=~was_request)
        claim("armed", ~pin, when=~was_armed)
        claim("lit", guard.lit == edge, when=~was_reset)

        awake = _register(range(window + 2), "awake")  # clocks since the reset
        token = _register(8, "token_seen")
        ago = _register(range(pause + 2), "ago", pause + 1)  # clocks since the last change
        before = _register(range(pause + 2), "before", pause + 1)  # between the last two
        changed, beating = Signal(name="token_changed"), Signal(name="seen_beating")
        m.d.comb += [
            changed.eq(guard.heartbeat != token),
            beating.eq((ago <= pause) & (before <= pause)),
        ]
        m.d.sync += [token.eq(guard.heartbeat),
                     awake.eq(Mux(awake > window, awake, awake + 1)),
                     ago.eq(Mux(ago > pause, ago, ago + 1))]
        with m.If(changed):
            m.d.sync += [ago.eq(1), before.eq(ago)]
        with m.If(reset):
            m.d.sync += [awake.eq(0), token.eq(0), ago.eq(pause + 1), before.eq(pause + 1)]
        claim("arming", guard.armed == (
            (guard.tables_valid | guard.capture) & beating & (awake > window)))

        # Refusals.
        dark, cleared = _register(1, "dark"), _register(1, "cleared")
        refused = Signal()
        m.d.comb += refused.eq(was_request & ~was_reset & ~edge)
        m.d.sync += dark.eq((dark | refused) & guard.request & ~reset)
        claim("stays_dark", ~pin, when=dark)
        m.d.sync += cleared.eq(guard.request & ~reset & (cleared | guard.clear))
        claim("reported", guard.causes.any(), when=refused & ~cleared)
        causes = _register(5, "causes_seen")
        m.d.sync += causes.eq(Mux(guard.clear, 0, guard.causes))
        claim("sticky", (causes & ~guard.causes) == 0, when=~was_reset)
        lapses, lapsed = _register(1, "lapses"), _register(1, "lapsed")
        m.d.sync += [
            lapses.eq((ago == pause) & ~changed & (before <= pause) & ~reset),
            lapsed.eq(lapses & ~reset),
        ]
        claim("silence", guard.causes[4], when=lapsed & ~was_reset)

        if not self.linked:
            return m
        g = formal.internals(inside)

        def link(name, statement, when=1):
            formal.claim(m, f"link_{name}", Value.cast(statement) | ~Value.cast(when).bool())

        for value, most in ((age, far), (gap_b, far), (gap_c, far), (ago, pause + 1),
                            (before, pause + 1), (awake, window + 1)):
            link(f"range_{value.name}", value <= most)
        # The heartbeat's two counters.
        link("token", g["token"] == token)
        link("beats", g["beats"] <= 2)
        link("silence", g["silence"] == ago, when=g["beats"] != 0)
        link("beats_0", ago == pause + 1, when=g["beats"] == 0)
        link("beats_1", before == pause + 1, when=g["beats"] == 1)
        link("lapses", (ago == pause + 1) & (g["beats"] == 2), when=lapses)
        link("beats_2", before <= pause, when=g["beats"] == 2)
        # Time since the reset, and since the last first edge.
        link("rested", g["rested"] == (awake > window))
        link("since_reset", (g["since"] == awake) & (g["since"] <= age_n), when=~g["rested"])
        link("since", g["since"] == Mux(age_n > window, window, age_n), when=g["rested"])
        # The pulse that goes on, and the ones before.
        link("pulsing", edge & g["rested"], when=g["pulsing"])
        link("laser", g["pulsing"], when=pin)
        link("length", g["length"] == edges_a_n, when=g["rested"] & (g["since"] < window))
        link("spent", g["spent"] == edges_a_n + Mux(gap_b_n < window, edges_b_n, 0),
             when=g["pulsing"])
        link("left", (g["spent"] <= window_on) & (g["length"] <= pulse), when=g["pulsing"])
        link("blocked", ~g["pulsing"] & was_request & ~was_reset, when=g["blocked"])
        link("reported", guard.causes.any(), when=g["blocked"] & ~cleared)
        link("dark", g["blocked"], when=dark | refused)
        # Pulses: whole ones have even numbers of edges; none is beyond what was left to it.
        link("even", (edges_a_n[0] == pin) & ~edges_b_n[0] & ~edges_c_n[0])
        link("moved", (age == edges_a) & (age != 0), when=moved)
        link("still", (age > edges_a) & (last == 0), when=~moved)
        for name, value in (("b", edges_b), ("c", edges_c)):
            link(f"ceiling_{name}", (value <= pulse) & (value <= window_on))
        link("ceiling_a", (edges_a <= pulse) & (edges_a <= window_on))
        link("apart", (gap_b >= repetition) & (gap_c >= repetition))
        link("pair_b", edges_a + edges_b <= window_on, when=gap_b < window)
        link("pair_c", edges_b + edges_c <= window_on, when=gap_c < window)
        # Light in the window is that of the pulses in it. Of one that began before the window,
        # which is the latest at first and may become the one or two before, some is missed.
        parts = [_register(range(pulse + 2), f"part_{name}") for name in "abc"]
        cut = [_register(1, f"cut_{name}") for name in "abc"]
        missed = _register(range(pulse + 2), "missed")
        with m.If(open_ | self.start):
            m.d.sync += [
                parts[0].eq(Mux(open_ & ~rise, parts[0], 0) + edge),
                parts[1].eq(Mux(open_, Mux(rise, parts[0], parts[1]), 0)),
                parts[2].eq(Mux(open_, Mux(rise, parts[1], parts[2]), 0)),
                cut[0].eq(Mux(open_, ~rise & cut[0], edge & ~rise)),
                cut[1].eq(open_ & Mux(rise, cut[0], cut[1])),
                cut[2].eq(open_ & Mux(rise, cut[1], cut[2])),
            ]
            with m.If(~open_):
                m.d.sync += missed.eq(edges_a)
        link("open", (seen > 0) & (seen < window), when=open_)
        link("light", light == parts[0] + parts[1] + parts[2], when=open_)
        link("cut_once", (cut[0] + cut[1] + cut[2] <= 1) & (missed <= pulse), when=open_)
        whole = [part == edges for part, edges in zip(parts, (edges_a, edges_b), strict=False)]
        ages = (age, age + gap_b, age + gap_b + gap_c)
        for name, flag, part, edges, old, others in (
                ("a", cut[0], parts[0], edges_a, ages[0], (parts[1] == 0) & (parts[2] == 0)),
                ("b", cut[1], parts[1], edges_b, ages[1], whole[0] & (parts[2] == 0)),
                ("c", cut[2], parts[2], edges_c, ages[2], whole[0] & whole[1])):
            link(f"cut_{name}", (part + missed == edges) & (seen + missed == old) & others,
                 when=open_ & flag)
        within = open_ & ~Cat(cut).any()
        link("within_a", whole[0] & (ages[0] <= seen), when=within & (parts[0] != 0))
        link("within_b", whole[1] & (ages[1] <= seen), when=within & (parts[1] != 0))
        link("within_0", ~moved, when=within & (parts[0] == 0))
        link("within_c", parts[2] == 0, when=within)
        return m
