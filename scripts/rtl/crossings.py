"""Lists every path between the clock domains of a design, from its netlist.

A path runs from a flip-flop or a memory of one clock, through any logic, to one of another clock:
to its data, its enable or its reset. Each has to be in :data:`LISTED`, with the reason why it is
safe; where that is a synchroniser, its form is checked too. A pin that several clocks hear is
listed alike, and so is one that belongs to no clock. Clocks are the same if they are the same net,
whichever edge is used.
"""

import argparse
import json
import re
import sys
from collections import defaultdict
from dataclasses import dataclass, field, replace

from amaranth._toolchain.yosys import find_yosys
from amaranth.back import rtlil

from hdl.acquisition.frame_memory import FrameMemory
from hdl.acquisition.sram_frames import SRAMFrames
from hdl.capsule import Capsule
from hdl.config import PRESETS
from hdl.display.vga import VGA
from hdl.export import flat_ports
from hdl.instrument import Instrument
from hdl.paper import Paper
from scripts.rtl.blocks import find

__all__ = ["LISTED", "TOPS", "Crossing", "Listed", "Top", "crossings", "explain", "netlist",
           "report"]

#: Cells whose output bits depend on the same bits of A and B only, and on all of S.
BITWISE = {"$and", "$or", "$xor", "$xnor", "$not", "$pos", "$mux", "$pmux", "$bwmux"}


@dataclass(frozen=True)
class Crossing:
    """A path: names and clocks of both ends, and what is between them.

    ``direct`` tells that there is no logic between, ``lone`` that what takes it is a flip-flop
    whose output goes to flip-flops of its own clock only, without logic between.
    """

    source: str
    destination: str
    source_clock: str
    destination_clock: str
    direct: bool
    lone: bool
    bits: int = 1


@dataclass(frozen=True)
class Listed:
    """A kind of path that is known to be safe: patterns of both ends, how it is, and why.

    ``chain`` asks for the form of a synchroniser: no logic before its first flip-flop, nor
    between that and the next.
    """

    source: str
    destination: str
    why: str
    chain: bool = False

    def fits(self, crossing):
        """Whether it is of this kind."""
        return (re.fullmatch(self.source, crossing.source) is not None
                and re.fullmatch(self.destination, crossing.destination) is not None
                and (not self.chain or (crossing.direct and crossing.lone)))


@dataclass(frozen=True)
class Top:
    """A design and what its ports do not tell.

    ``in_step`` are clocks that are another one behind a gate; ``pins`` belong to the clock that is
    named, or to none. Others belong to ``clk``, or to the clock of their own name (resets).
    """

    make: object
    in_step: dict = field(default_factory=dict)
    pins: dict = field(default_factory=dict)


_GRAY = ("Gray code through two flip-flops: one bit changes at a time, so what is heard is the "
         "number before or after")
_LINE = "one bit through two flip-flops; it stays until it is answered"
_STILL = "stands still while it is taken, which a line through two flip-flops tells"
LISTED = (
    # amaranth.lib.fifo.AsyncFIFO, between the imager's pixel clock and the system's.
    Listed(r".*queue\.produce_w_gry", r".*queue\.produce_cdc\.stage0", _GRAY, chain=True),
    Listed(r".*queue\.consume_r_gry", r".*queue\.consume_cdc\.stage0", _GRAY, chain=True),
    Listed(r".*queue\.storage", r".*queue\.storage_r_data",
           "a word is read only after the writer's count has told of it, and not written again "
           "until the reader's count has told that it was read"),
    Listed(r"pin pixel_rst", r".*queue\.(rst_cdc\.stage0|r_rst)",
           "asynchronous set, let go through two flip-flops"),
    # Pins.
    Listed(r"pin rx", r"(.*\.)?synchroniser\.stage0", "two flip-flops", chain=True),
    Listed(r"pin cts", r"(.*\.)?cts_synchronizer\.stage0", "two flip-flops", chain=True),
    Listed(r"pin frame_valid", r"(.*\.)?sending_synchronizer\.stage0", "two flip-flops",
           chain=True),
    # hdl.acquisition.frame_banks, between the system's clock and the display's.
    Listed(r"(.*(banks|frames)\.)?request", r"(.*(banks|frames)\.)?request\.stage0", _LINE,
           chain=True),
    Listed(r"(.*(banks|frames)\.)?answer", r"(.*(banks|frames)\.)?answer\.stage0", _LINE,
           chain=True),
    Listed(r"(.*banks\.)?wants", r"(.*banks\.)?(reader|reader_exists|reader_info|"
           r"reader_is_fresh|newest_is_unread|write_bank|free)", _STILL),
    Listed(r"(.*banks\.)?reader(_exists|_info|_is_fresh)?", r"(.*banks\.|.*)?(held|fresh|frame|"
           r"read_bank|list_number)", _STILL),
    Listed(r"(.*\.)?(bank_\d+_page_\d+|places)", r"(.*\.)?(bank_\d+_page_\d+|places)_r_data",
           "no bank is written while the reader holds it (`make prove`); what is read of others is "
           "not used"),
    Listed(r"(.*\.)?row_late", r"(.*\.)?late_synchronizer\.stage0",
           "one bit through two flip-flops; it stays", chain=True),
    # hdl.acquisition.sram_frames, likewise.
    Listed(r"(.*\.)?(wanted|read_bank)", r"(.*\.)?(odd|read_address)", _STILL),
    Listed(r"(.*\.)?line", r"(.*\.)?line_r_data",
           "a row is shown only once it has come, and its half is filled only after the next row "
           "for it was asked for; what is read of others is not used"),
)


def netlist(component, name="top"):
    """The flat netlist of ``component``, as yosys' JSON has it: word-level cells and bits."""
    ports = {port: (value, None) for port, (value, _) in flat_ports(component).items()}
    text = rtlil.convert(component, name=name, ports=ports, emit_src=False)
    yosys = find_yosys(lambda version: version >= (0, 40))
    answer = yosys.run(["-q", "-"], f"read_rtlil <<rtlil\n{text}\nrtlil\n"
                       "proc; flatten; opt_expr; opt_clean; memory_collect; opt_clean\n"
                       "write_json\n")
    return json.loads(answer[answer.index("{"):])["modules"][name]


class _Graph:
    """Who drives what, bit by bit."""

    def __init__(self, module, in_step):
        self.in_step = in_step
        self.names = defaultdict(list)
        for name, net in module["netnames"].items():
            # A submodule of a signal's name has a number behind its own.
            plain = re.sub(r"\$\d+(?=\.|$)", "", name)
            if not net.get("hide_name") and "$" not in plain:
                for bit in net["bits"]:
                    self.names[bit].append(plain)
        self.pins = {bit: name for name, port in module["ports"].items()
                     if port["direction"] == "input" for bit in port["bits"]}
        self.drivers = {}  # of logic: bit to (cell, port, index)
        self.registers = {}  # bit to (name, clock)
        self.inputs = []  # (name, clock, bits that it hears, whether each is data)
        self.next = defaultdict(list)  # bit to the names of cells that hear it
        for cell_name, cell in module["cells"].items():
            self._add(cell_name, cell)

    def label(self, bits, fallback):
        """The plainest name of the first named one of ``bits``."""
        for bit in bits:
            if self.names.get(bit):
                return min(self.names[bit], key=lambda name: (name.count("."), len(name)))
        return fallback

    def clock(self, bit):
        name = self.pins.get(bit) or self.label([bit], f"net {bit}")
        return self.in_step.get(name, name)

    def _add(self, name, cell):
        wires = cell["connections"]
        kind = cell["type"]
        if kind == "$mem_v2":
            self._add_memory(name, cell)
        elif "CLK" in wires:
            label = self.label(wires["Q"], name)
            clock = self.clock(wires["CLK"][0])
            for bit in wires["Q"]:
                self.registers[bit] = (label, clock)
            heard = [bit for port, bits in wires.items() if port not in ("CLK", "Q")
                     for bit in bits]
            self.inputs.append((label, clock, heard, wires["Q"]))
            for bit in heard:
                self.next[bit].append(("register", clock))
        elif kind in ("$check", "$print", "$scopeinfo"):
            pass
        else:
            for port, direction in cell["port_directions"].items():
                for index, bit in enumerate(wires[port]):
                    if direction == "output":
                        self.drivers[bit] = (cell, index)
                    else:
                        self.next[bit].append(("logic", None))

    def _add_memory(self, name, cell):
        wires, parameters = cell["connections"], cell["parameters"]
        memory = parameters["MEMID"].lstrip("\\")
        words = int(parameters["WIDTH"], 2)
        places = int(parameters["ABITS"], 2)
        writers = set()
        for port in range(int(parameters["WR_PORTS"], 2)):
            clock = self.clock(wires["WR_CLK"][port])
            writers.add(clock)
            heard = [bit for key, size in (("WR_ADDR", places), ("WR_DATA", words),
                                           ("WR_EN", words))
                     for bit in wires[key][port * size:(port + 1) * size]]
            self._hear(memory, clock, heard)
        enabled = parameters["RD_CLK_ENABLE"][::-1]
        for port in range(int(parameters["RD_PORTS"], 2)):
            data = wires["RD_DATA"][port * words:(port + 1) * words]
            address = wires["RD_ADDR"][port * places:(port + 1) * places]
            if enabled[port] == "1":
                clock = self.clock(wires["RD_CLK"][port])
                label = f"{memory}_r_data"
                for bit in data:
                    self.registers[bit] = (label, clock)
                self._hear(label, clock, [*address, wires["RD_EN"][port],
                                          *(("memory", memory, writer) for writer in writers)])
            else:
                for bit in data:
                    self.drivers[bit] = ({"type": "$memory", "connections": {
                        "A": [*address, *(("memory", memory, writer) for writer in writers)]},
                        "port_directions": {"A": "input"}}, 0)

    def _hear(self, label, clock, heard):
        self.inputs.append((label, clock, heard, ()))
        for bit in heard:
            self.next[bit].append(("register", clock))

    def before(self, bit):
        """Bits that the logic which drives ``bit`` hears."""
        cell, index = self.drivers[bit]
        wires = cell["connections"]
        heard = []
        for port, direction in cell["port_directions"].items():
            if direction == "output":
                continue
            bits = wires[port]
            if cell["type"] in BITWISE and port in ("A", "B"):
                width = len(wires["Y"])
                if cell["type"] == "$pmux" and port == "B":
                    heard += bits[index::width]
                elif index < len(bits):
                    heard.append(bits[index])
                else:
                    heard.append(bits[-1])  # signs are extended
            else:
                heard += bits
        return heard

    def source(self, bit):
        """Name and clock of what holds ``bit``, or None if logic or nothing drives it."""
        if isinstance(bit, tuple):
            return bit[1], bit[2]
        if bit in self.registers:
            return self.registers[bit]
        if bit in self.pins:
            return f"pin {self.pins[bit]}", None
        return None

    def sources(self, bit, clock, known):
        """Ends of all paths to ``bit`` from elsewhere than ``clock``, those of pins too."""
        if bit in known:
            return known[bit]
        stack, order, seen = [bit], [], set()
        while stack:
            one = stack.pop()
            if one in seen or one in known:
                continue
            seen.add(one)
            order.append(one)
            if self.source(one) is None and one in self.drivers:
                stack += self.before(one)
        # Logic has no loops, but its order here is not one of depth: so go over it until it stays.
        for one in order:
            own = self.source(one)
            known[one] = frozenset([own]) if own is not None and own[1] != clock else frozenset()
        changed = True
        while changed:
            changed = False
            for one in reversed(order):
                if self.source(one) is None and one in self.drivers:
                    found = frozenset().union(*(known.get(each, frozenset())
                                                for each in self.before(one)))
                    if found != known[one]:
                        known[one], changed = found, True
        return known[bit]

    def lone(self, bits, clock):
        """Whether ``bits``, of a flip-flop, go straight to flip-flops of ``clock``."""
        heard = [each for bit in bits for each in self.next.get(bit, ())]
        return bool(heard) and all(each == ("register", clock) for each in heard)


def _home(pin, clocks, pins):
    """The clock to which a pin belongs that ``clocks`` hear; None if to none."""
    own = re.sub(r"_?rst$", "_clk", pin).lstrip("_")
    return pins.get(pin, own if own in clocks else "clk")


def crossings(module, in_step=None, pins=None):
    """All paths between clocks in ``module``, which comes from :func:`netlist`.

    ``in_step`` and ``pins`` are those of :class:`Top`.
    """
    graph = _Graph(module, in_step or {})
    known = {clock: {} for _, clock, _, _ in graph.inputs}
    found = defaultdict(set)
    straight = {}
    for label, clock, heard, outputs in graph.inputs:
        lone = graph.lone(outputs, clock)
        for bit in heard:
            direct = graph.source(bit) is not None
            for source, source_clock in graph.sources(bit, clock, known[clock]):
                key = (source, source_clock, label, clock)
                found[key].add(bit)
                was = straight.get(key, (True, True))
                straight[key] = (was[0] and direct, was[1] and lone)
    hearing = defaultdict(set)
    for source, source_clock, _, clock in found:
        if source_clock is None:
            hearing[source].add(clock)
    result = []
    for (source, source_clock, label, clock), bits in found.items():
        if source_clock is None:
            source_clock = _home(source.removeprefix("pin "), hearing[source], pins or {})
            if source_clock == clock or (source_clock == "clk" and len(hearing[source]) == 1):
                continue
            source_clock = source_clock or "no clock"
        direct, lone = straight[source, None if source.startswith("pin ") else source_clock,
                                label, clock]
        result.append(Crossing(source, label, source_clock, clock, direct, lone, len(bits)))
    return sorted(result, key=lambda each: (each.source, each.destination))


def explain(found, listed=LISTED):
    """Pairs of each crossing and its entry in ``listed``, or None if nothing there fits."""
    return [(each, next((entry for entry in listed if entry.fits(each)), None))
            for each in found]


_CAMERA = dict.fromkeys(("frame_valid", "line_valid", "data"), "pixel_clk")
_PINS = {**_CAMERA, "rx": None, "cts": None}
#: Designs whose crossings are listed, by name; any block's name will do besides.
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
    """Print the paths of one design; return how many are not as they should be."""
    top = TOPS.get(name) or Top(find(name).component)
    found = crossings(netlist(top.make()), top.in_step, top.pins)
    print(f"{name}: {len(found)} paths between clocks" + "".join(
        f"; {gated} is {clock} behind a gate, in step with it"
        for gated, clock in top.in_step.items()))
    groups = defaultdict(list)
    for each, entry in explain(found):
        groups[entry.why if entry else None].append(each)
    for why, members in groups.items():
        print(f"  {why or 'NOT LISTED, OR NOT OF THE FORM THAT IS ASKED FOR'}")
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
        print(f"{bad} paths are not listed.")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
