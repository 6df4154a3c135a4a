"""Lists every path between the clock domains of a design, from its netlist.

A path runs from a flip-flop or a memory of one clock, through any logic, to one of another clock:
to its data, its enable or its reset. Each needs a waiver (:mod:`scripts.rtl.waivers`) that says why
it is safe; where that is a synchroniser, its form is checked too. Pins that several clocks sample,
and pins that belong to no clock, need one likewise. Clocks are the same if they are the same net,
whichever edge is used.
"""

import argparse
import re
import sys
from collections import defaultdict
from dataclasses import dataclass, field, replace

from hdl.acquisition.frame_memory import FrameMemory
from hdl.acquisition.sram_frames import SRAMFrames
from hdl.capsule import Capsule
from hdl.config import PRESETS
from hdl.display.vga import VGA
from hdl.instrument import Instrument
from hdl.paper import Paper
from scripts.rtl.blocks import find
from scripts.rtl.netlist import Graph, netlist
from scripts.rtl.waivers import WAIVERS

__all__ = ["TOPS", "Crossing", "Top", "crossings", "crossings_of", "explain", "report"]


@dataclass(frozen=True)
class Crossing:
    """A path: names and clocks of both ends, and what is between them.

    ``direct`` says that there is no logic between, ``lone`` that the destination is a flip-flop
    whose output drives only flip-flops of its own clock, without logic between. The nets are all
    names that the ends have in the netlist.
    """

    source: str
    destination: str
    source_clock: str
    destination_clock: str
    direct: bool
    lone: bool
    bits: int = 1
    source_nets: frozenset = field(default=frozenset(), compare=False, repr=False)
    destination_nets: frozenset = field(default=frozenset(), compare=False, repr=False)


@dataclass(frozen=True)
class Top:
    """A design, with the clocks that its ports do not show.

    ``in_step`` are clocks that are another one behind a gate; ``pins`` belong to the clock that is
    named, or to none. Others belong to ``clk``, or to the clock of their own name (resets).
    """

    make: object
    in_step: dict = field(default_factory=dict)
    pins: dict = field(default_factory=dict)


def _home(pin, clocks, pins):
    """The clock of a pin that ``clocks`` sample; None if it has none."""
    own = re.sub(r"_?rst$", "_clk", pin).lstrip("_")
    return pins.get(pin, own if own in clocks else "clk")


def crossings(module, in_step=None, pins=None):
    """All paths between clocks in ``module``, which comes from :func:`netlist`.

    ``in_step`` and ``pins`` are those of :class:`Top`.
    """
    graph = Graph(module, in_step or {})
    return crossings_of(graph, pins)


def crossings_of(graph, pins=None):
    """All paths between clocks in a :class:`.netlist.Graph`; ``pins`` are those of :class:`Top`."""
    known = {clock: {} for _, clock, _, _ in graph.inputs}
    found = defaultdict(set)
    forms = {}
    for label, clock, inputs, outputs in graph.inputs:
        lone = graph.lone(outputs, clock)
        for bit in inputs:
            direct = graph.source(bit) is not None
            for source, source_clock in graph.sources(bit, clock, known[clock]):
                key = (source, source_clock, label, clock)
                found[key].add(bit)
                before = forms.get(key, (True, True))
                forms[key] = (before[0] and direct, before[1] and lone)
    samplers = defaultdict(set)
    for source, source_clock, _, clock in found:
        if source_clock is None:
            samplers[source].add(clock)
    result = []
    for (source, source_clock, label, clock), bits in found.items():
        if source_clock is None:
            source_clock = _home(source.removeprefix("pin "), samplers[source], pins or {})
            if source_clock == clock or (source_clock == "clk" and len(samplers[source]) == 1):
                continue
            source_clock = source_clock or "no clock"
        direct, lone = forms[source, None if source.startswith("pin ") else source_clock,
                                label, clock]
        result.append(Crossing(
            source, label, source_clock, clock, direct, lone, len(bits),
            frozenset(graph.nets.get(source, ())), frozenset(graph.nets.get(label, ()))))
    return sorted(result, key=lambda each: (each.source, each.destination))


def explain(found, waivers=WAIVERS):
    """Pairs of each crossing and the first waiver that fits it, or None."""
    return [(each, next((waiver for waiver in waivers if waiver.fits(each)), None))
            for each in found]


_CAMERA = dict.fromkeys(("frame_valid", "line_valid", "data"), "pixel_clk")
_PINS = {**_CAMERA, "rx": None, "cts": None}
#: Designs that are checked, by name; any other block can be checked by its name.
TOPS = {
    "capsule": Top(lambda: Capsule(PRESETS["capsule"]), pins=_CAMERA),
    "capsule, gated": Top(
        lambda: Capsule(PRESETS["capsule"], clock_gated=True), {"spot_clk": "clk"}, _CAMERA),
    "instrument": Top(lambda: Instrument(PRESETS["capsule"]), pins=_PINS),
    "instrument, gated": Top(
        lambda: Instrument(PRESETS["capsule"], clock_gated=True), {"spot_clk": "clk"}, _PINS),
    "instrument, converter": Top(
        lambda: Instrument(replace(PRESETS["capsule"], converter_latency=4)),
        pins={"rx": None, "cts": None}),
    "paper": Top(lambda: Paper(PRESETS["paper"]), pins=_CAMERA),
    "instrument, paper, gated": Top(
        lambda: Instrument(PRESETS["paper"], clock_gated=True), {"spot_clk": "clk"}, _PINS),
    "frame_memory": Top(lambda: FrameMemory(64, 64)),
    "sram_frames": Top(lambda: SRAMFrames(352, 288)),
    "vga": Top(lambda: VGA(352, 288)),
}


def report(name):
    """Print the paths of one design; return the number of those without a waiver."""
    top = TOPS.get(name) or Top(find(name).component)
    found = crossings(netlist(top.make()), top.in_step, top.pins)
    print(f"{name}: {len(found)} paths between clocks" + "".join(
        f"; {gated} is {clock} behind a gate"
        for gated, clock in top.in_step.items()))
    groups = defaultdict(list)
    for each, waiver in explain(found):
        groups[waiver.why if waiver else None].append(each)
    for why, members in groups.items():
        print(f"  {why or 'NO WAIVER, OR NOT IN THE FORM THAT IT REQUIRES'}")
        for each in members:
            form = "" if each.direct else ", through logic"
            print(f"    {each.source} ({each.source_clock}) -> {each.destination} "
                  f"({each.destination_clock}), {each.bits} bits{form}")
    return len(groups.get(None, ()))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tops", nargs="*", metavar="TOP", help=f"{', '.join(TOPS)} or any block")
    options = parser.parse_args(arguments)
    bad = sum(report(name) for name in options.tops or TOPS)
    if bad:
        print(f"{bad} paths have no waiver.")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
