"""What ties the registers of the laser guard to those of its observer.

With these invariants the induction of :class:`tb.formal.laser_guard.GuardProof` closes.
"""

from functools import partial

from amaranth.hdl import Cat, Mux, Signal, Value
from amaranth.lib import data

from tb.formal import symbiyosys as formal

__all__ = ["link_guard", "link_pulses", "link_window"]


def _link(m, proof, name, statement, when=1):
    formal.claim(m, f"link_{name}",
                 Value.cast(statement) | ~(Value.cast(when).bool() & proof.powered))


def link_guard(m, proof):
    """What the guard's flip-flops hold, by what the observer saw, before a bit flips."""
    pulse, repetition, window, window_on, pause = proof.clocks
    pulse, window_on = pulse & ~1, window_on & ~1
    flops, link = proof.upsets.flops, partial(_link, m, proof)
    flags = data.View(proof.guard.FLAGS, flops["flags"])
    token, silence, since, length, spent = (
        flops[name] for name in ("token", "silence", "since", "length", "spent"))
    restless = proof.was_request & ~proof.was_restart
    for name in flops:
        if f"{name}_parity" in flops:
            link(f"parity_{name}", flops[f"{name}_parity"] == flops[name].xor())
    for value, most in ((proof.ago, pause + 1), (proof.before, pause + 1),
                        (proof.awake, window + 1)):
        link(f"range_{value.name}", value <= most)
    link("restarted", proof.awake == 0, when=proof.was_restart)
    # The heartbeat's two counters.
    link("token", token == proof.token)
    link("beats", flags.beats <= 2)
    link("silence", silence == proof.ago, when=flags.beats != 0)
    link("beats_0", proof.ago == pause + 1, when=flags.beats == 0)
    link("beats_1", proof.before == pause + 1, when=flags.beats == 1)
    link("lapses", (proof.ago == pause + 1) & (flags.beats == 2), when=proof.lapses)
    link("beats_2", proof.before <= pause, when=flags.beats == 2)
    # The pin as it would be without a flip in this clock, and what its edge would do.
    pin = Signal(name="due_pin")
    due = Signal(name="due")
    m.d.comb += [pin.eq(flags.pin & length[0]), due.eq((pin != proof.last) & proof.powered)]
    age, gap_b, _, edges_a, edges_b, _ = proof.after(due)
    # Time since the reset, and since the last first edge.
    link("rested", flags.rested == (proof.awake > window))
    link("since_reset", (since == proof.awake) & (since <= age), when=~flags.rested)
    link("since", since == Mux(age > window, window, age), when=flags.rested)
    link("apart", flags.apart == (since >= repetition))
    # The pulse that goes on, and the ones before.
    link("pulsing", due & flags.rested & proof.was_armed & restless, when=flags.pulsing)
    link("closing", flags.pulsing, when=due & proof.was_armed & restless)
    link("pin", flags.pulsing & ~proof.last, when=flags.pin)
    link("rails", flags.pin == length[0])
    link("length", length == edges_a, when=flags.rested & (since < window))
    link("spent", spent == edges_a + Mux(gap_b < window, edges_b, 0), when=flags.pulsing)
    link("left", (spent <= window_on) & (length <= pulse) & (length <= window_on))
    link("blocked", ~flags.pulsing & restless, when=flags.blocked)
    link("blocked_why", proof.dark | proof.refused(due) | ~proof.was_armed, when=flags.blocked)
    link("reported", flops["causes"].any(), when=flags.blocked & ~proof.cleared)
    link("dark", flags.blocked, when=proof.dark | proof.refused(due))


def link_pulses(m, proof):
    """The observer's pulses: even when over, and none beyond what was left to it."""
    pulse, repetition, window, window_on, _ = proof.clocks
    pulse, window_on = pulse & ~1, window_on & ~1
    link = partial(_link, m, proof)
    for register in proof.registers:
        formal.claim(m, f"link_first_{register.name}",
                     proof.powered | (register == register.init))
    for value in (proof.age, proof.gap_b, proof.gap_c):
        link(f"range_{value.name}", value <= proof.far)
    edges_a, edges_b, edges_c = proof.edges
    *_, a, b, c = proof.after(proof.edge)
    link("even", (a[0] == proof.guard.laser) & ~b[0] & ~c[0])
    link("moved", (proof.age == edges_a) & (proof.age != 0), when=proof.moved)
    link("still", (proof.age > edges_a) & ~proof.last, when=~proof.moved)
    link("ceiling", Cat((value <= pulse) & (value <= window_on) for value in proof.edges).all())
    link("gaps", (proof.gap_b >= repetition) & (proof.gap_c >= repetition))
    link("pair_b", edges_a + edges_b <= window_on, when=proof.gap_b < window)
    link("pair_c", edges_b + edges_c <= window_on, when=proof.gap_c < window)


def link_window(m, proof):
    """Light in the window is that of the pulses in it.

    Of a pulse that began before the window, which is the latest at first and may become the
    one or two before, some is missed.
    """
    pulse, _, window, _, _ = proof.clocks
    link, open_, seen, rise = partial(_link, m, proof), proof.open, proof.seen, proof.rise
    parts = [proof.register(range(pulse + 2), f"part_{name}") for name in "abc"]
    cut = [proof.register(1, f"cut_{name}") for name in "abc"]
    missed = proof.register(range(pulse + 2), "missed")
    edges_a, edges_b, edges_c = proof.edges
    with m.If(open_ | proof.start):
        m.d.sync += [
            parts[0].eq(Mux(open_ & ~rise, parts[0], 0) + proof.edge),
            parts[1].eq(Mux(open_, Mux(rise, parts[0], parts[1]), 0)),
            parts[2].eq(Mux(open_, Mux(rise, parts[1], parts[2]), 0)),
            cut[0].eq(Mux(open_, ~rise & cut[0], proof.edge & ~rise)),
            cut[1].eq(open_ & Mux(rise, cut[0], cut[1])),
            cut[2].eq(open_ & Mux(rise, cut[1], cut[2])),
        ]
        with m.If(~open_):
            m.d.sync += missed.eq(edges_a)
    link("open", (seen > 0) & (seen < window), when=open_)
    link("light", proof.light == parts[0] + parts[1] + parts[2], when=open_)
    link("cut_once", (cut[0] + cut[1] + cut[2] <= 1) & (missed <= pulse), when=open_)
    whole = [part == edges for part, edges in zip(parts, (edges_a, edges_b), strict=False)]
    ages = (proof.age, proof.age + proof.gap_b, proof.age + proof.gap_b + proof.gap_c)
    for name, flag, part, edges, old, others in (
            ("a", cut[0], parts[0], edges_a, ages[0], (parts[1] == 0) & (parts[2] == 0)),
            ("b", cut[1], parts[1], edges_b, ages[1], whole[0] & (parts[2] == 0)),
            ("c", cut[2], parts[2], edges_c, ages[2], whole[0] & whole[1])):
        link(f"cut_{name}", (part + missed == edges) & (seen + missed == old) & others,
             when=open_ & flag)
    within = open_ & ~Cat(cut).any()
    link("within_a", whole[0] & (ages[0] <= seen), when=within & (parts[0] != 0))
    link("within_b", whole[1] & (ages[1] <= seen), when=within & (parts[1] != 0))
    link("within_0", ~proof.moved, when=within & (parts[0] == 0))
    link("within_c", parts[2] == 0, when=within)
