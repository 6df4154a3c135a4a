"""The banks of a frame store between a writer and a reader that know only its ports.

In each step of the proof either clock ticks, or both do, or none: that is every ratio and every
phase of two clocks, drift and stops included. From power-up on, all inputs are free, except that
the writer closes only what it writes.
"""

from amaranth.hdl import (
    DomainRenamer,
    Elaboratable,
    EnableInserter,
    Fragment,
    Module,
    ResetSignal,
    Signal,
    Value,
)

from tb.formal import symbiyosys as formal

__all__ = ["BanksProof"]


class BanksProof(Elaboratable):
    """Properties of ``banks``, by the names of :attr:`PROPERTIES`.

    Parameters
    ----------
    banks : :class:`hdl.acquisition.frame_banks.FrameBanks`
        Any, also one with a planted fault.
    properties : collection of :class:`str`
        Those to assert.
    linked : :class:`bool`
        Also assert the auxiliary invariants with which the induction closes.
    """

    PROPERTIES = {
        "exclusion": "no bank is written, or may be, while the reader holds it",
        "whole": "the bank that the reader holds was written to its end",
        "newest": "nor is the newest whole frame's, until a newer one is whole",
        "kept": "so that frame is still whole",
        "refusal": "three banks take every frame; two refuse one only while the reader has a bank",
        "quiet": "the reader keeps its bank until it asks",
    }

    def __init__(self, banks, properties=None, linked=True):
        self.banks, self.linked = banks, linked
        self.properties = tuple(self.PROPERTIES if properties is None else properties)
        self.write_tick, self.read_tick = Signal(), Signal()

    @property
    def ports(self):
        """Free inputs."""
        banks = self.banks
        return [self.write_tick, self.read_tick, banks.opens, banks.closes, banks.info,
                banks.acquire, banks.give_back]

    def elaborate(self, platform):
        m = Module()
        banks = self.banks
        inside = Fragment.get(banks, platform)
        g = formal.internals(inside)
        ring = [g["request"]]
        for name, answer in (("request", g["answer"]), ("answer", None)):
            [stages] = [formal.internals(part) for part, part_name, *_ in inside.subfragments
                        if part_name == name]
            ring += [stages["stage0"], stages["stage1"]]
            ring += [answer] if answer is not None else []
        ticking = EnableInserter({"sync": self.write_tick, "display": self.read_tick})(inside)
        m.submodules.banks = DomainRenamer({"display": "sync"})(ticking)

        def claim(name, statement, when=1):
            if name in self.properties:
                formal.claim(m, name, Value.cast(statement) | ~Value.cast(when).bool())

        def link(name, statement, when=1):
            if self.linked:
                formal.claim(m, f"link_{name}", Value.cast(statement) | ~Value.cast(when).bool())

        # The writer: what it writes, and which banks hold a whole frame.
        writing, whole = Signal(), Signal(banks.banks)
        begins = Signal()
        m.d.comb += begins.eq(banks.opens & banks.free)
        formal.assume(m, "no_reset", ~ResetSignal())
        formal.assume(m, "closes_what_it_writes", ~banks.closes | (writing & ~banks.opens))
        with m.If(self.write_tick):
            with m.If(banks.opens):
                m.d.sync += writing.eq(banks.free)
            with m.If(begins):
                m.d.sync += whole.bit_select(banks.write_bank, 1).eq(0)
            with m.If(banks.closes):
                m.d.sync += [writing.eq(0), whole.bit_select(banks.write_bank, 1).eq(1)]

        # The newest whole frame, as the writer's ports tell.
        newest, exists = Signal.like(banks.write_bank), Signal()
        with m.If(self.write_tick & banks.closes):
            m.d.sync += [newest.eq(banks.write_bank), exists.eq(1)]

        # The reader.
        held, mine = Signal(), Signal.like(banks.read_bank)
        m.d.sync += [mine.eq(banks.read_bank), held.eq(
            banks.held & ~(self.read_tick & banks.idle & (banks.acquire | banks.give_back)))]

        may_write = writing | banks.free
        claim("exclusion", banks.write_bank != banks.read_bank, when=banks.held & may_write)
        claim("whole", whole.bit_select(banks.read_bank, 1), when=banks.held)
        claim("newest", banks.write_bank != newest, when=exists & may_write)
        claim("kept", whole.bit_select(newest, 1), when=exists)
        if banks.banks == 3:
            claim("refusal", banks.free)
        else:
            claim("refusal", exists & (g["reader_exists"]), when=~banks.free)
        claim("quiet", banks.held & (banks.read_bank == mine), when=held)

        # Request and answer run around a ring, and never is there more than one edge in it.
        link("ring", sum(one ^ other for one, other in zip(ring, ring[1:], strict=False)) <= 1)
        link("held", ~g["request"] & g["reader_exists"] & (banks.read_bank == g["reader"]),
             when=banks.held)
        link("newest", (g["newest_exists"] == exists) & (g["newest"] == newest))
        link("writing", banks.free, when=writing)
        link("reader", whole.bit_select(g["reader"], 1), when=g["reader_exists"])
        link("others", (banks.write_bank != g["reader"]) | ~g["reader_exists"], when=banks.free)
        link("full", g["reader_exists"] & exists & (g["reader"] != newest), when=~banks.free)
        for name in ("write_bank", "read_bank"):
            link(f"range_{name}", getattr(banks, name) < banks.banks)
        for name in ("reader", "newest"):
            link(f"range_{name}", g[name] < banks.banks)
        return m
