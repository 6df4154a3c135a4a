"""What a design needs of timing, worked out from its netlist: clocks, pins, clock crossings.

Every crossing must have a waiver (:mod:`scripts.rtl.waivers`), and both of its ends must be found
in the exported text, or there are no constraints at all.
"""

import re
from collections import defaultdict
from dataclasses import dataclass

from model.errors import UserError
from scripts.rtl.crossings import crossings_of, explain
from scripts.rtl.netlist import Graph, netlist
from scripts.rtl.verilog import modules
from scripts.rtl.waivers import WAIVERS

__all__ = ["DISPLAY_HZ", "PathLimit", "Timing", "mark_registers", "plan", "registers"]

DISPLAY_HZ = 25_175_000
#: Pins that no clock of the design samples in step.
_ASYNCHRONOUS = ("rx", "cts")
_CAMERA = ("frame_valid", "line_valid", "data")
#: Synthesis may neither make a shift register of a synchroniser, nor merge, move or copy its
#: flip-flops. The names are those of Vivado, XST and Synplify.
SYNCHRONISER = ('ASYNC_REG = "TRUE", SHREG_EXTRACT = "NO", keep = "true", syn_preserve = 1, '
                'syn_keep = 1')
#: Nor may it merge registers of the laser guard that are equal unless a bit has flipped.
GUARD = 'DONT_TOUCH = "TRUE", keep = "true", syn_preserve = 1, syn_keep = 1'


@dataclass(frozen=True)
class PathLimit:
    """A crossing and what its constraint says.

    Parameters
    ----------
    crossing : :class:`scripts.rtl.crossings.Crossing`
    why : :class:`str`
        Of its waiver.
    ns : :class:`float` or None
        The longest delay, nanoseconds; None for a path that may take any time.
    sources, destinations : tuple of (:class:`str`, :class:`int`)
        Registers in the exported text, with dots between instances, and their widths; none for a
        memory, whose paths only the bound between both clocks covers.
    pin : :class:`str` or None
        The pin that the path starts from instead of a register.
    """

    crossing: object
    why: str
    ns: float | None
    sources: tuple
    destinations: tuple
    pin: str | None = None

    @property
    def title(self):
        """The crossing in a line."""
        one = self.crossing
        return (f"{one.source} ({one.source_clock}) -> {one.destination} "
                f"({one.destination_clock}): {self.why}")


@dataclass(frozen=True)
class Timing:
    """All of it.

    Parameters
    ----------
    clocks : dict of :class:`str` to :class:`float`
        Periods in nanoseconds by the name of the port.
    exceptions : tuple of :class:`PathLimit`
    bounds : dict of (:class:`str`, :class:`str`) to :class:`float`
        For each pair of clocks that a path joins, the longest delay, nanoseconds.
    synchronisers : tuple of :class:`str`
        Flip-flops that settle, with dots between instances.
    guard : tuple of :class:`str`
        Registers that must stay as they are.
    inputs, outputs : dict of :class:`str` to tuple
        Pins by clock; those of None belong to none.
    """

    clocks: dict
    exceptions: tuple
    bounds: dict
    synchronisers: tuple
    guard: tuple
    inputs: dict
    outputs: dict


def registers(text, top):
    """Map the names of registers in a Verilog text, dots between instances, to module and width."""
    bodies = modules(text)
    found = {}

    def enter(module, prefix):
        clocked = set(re.findall(r"^\s.*?\b(\w+)(?:\[[^\]]*\])? <= ", bodies[module], re.M))
        for high, name in re.findall(r"^  reg (?:signed )?(?:\[(\d+):0\] )?(\w+)(?: *[=;]| +\[)",
                                     bodies[module], re.M):
            if name in clocked:
                found[f"{prefix}{name}"] = module, int(high or 0) + 1
        for inner, name in re.findall(r"^  (\w+) +(\w+) +\($", bodies[module], re.M):
            if inner in bodies:
                enter(inner, f"{prefix}{name}.")

    enter(top, "")
    return found


def _declared(nets, known):
    """Those of the names that stand for registers of the exported text, with their widths."""
    plain = {net.replace("$", "_") for net in nets}
    return tuple((name, known[name][1]) for name in sorted(plain & known.keys()))


def _limit(crossing, why, periods, known):
    """The constraint of a crossing and its waiver."""
    memory = crossing.destination.endswith("_r_data")
    pin = crossing.source.removeprefix("pin ") if crossing.source.startswith("pin ") else None
    ends = [() if memory else _declared(crossing.destination_nets, known),
            () if memory or pin else _declared(crossing.source_nets, known)]
    if not memory and not (ends[0] and (pin or ends[1])):
        raise UserError(f"The path from {crossing.source} to {crossing.destination} crosses "
                        "clocks, and the exported text has no register by these names to "
                        "constrain.")
    ns = min(periods[crossing.source_clock], periods[crossing.destination_clock]) \
        if why.bounded else None
    return PathLimit(crossing, why.why, ns, ends[1], ends[0], pin)


def plan(component, text, top, waivers=WAIVERS):
    """The :class:`Timing` of ``component``, whose Verilog is ``text`` with the module ``top``.

    Raises
    ------
    UserError
        If a path between clocks has no waiver, or is not found in the text.
    """
    config = component.config
    graph = Graph(netlist(component, top), {})
    pins = {**dict.fromkeys(_CAMERA, "pixel_clk"), **dict.fromkeys(_ASYNCHRONOUS)}
    if config.converter_latency is not None:
        pins["data"] = "clk"
    explained = explain(crossings_of(graph, pins), waivers)
    bad = [f"{each.source} ({each.source_clock}) -> {each.destination} ({each.destination_clock})"
           for each, why in explained if why is None]
    if bad:
        raise UserError("No constraints can be written, as these paths between clocks are not in "
                        f"the table of safe ones (scripts/rtl/waivers.py): {'; '.join(bad)}.")
    clocks = sorted({clock for _, clock, _, _ in graph.inputs})
    rates = {"clk": config.clock_hz, "pixel_clk": config.clock_hz, "display_clk": DISPLAY_HZ}
    periods = {clock: round(1e9 / rates[clock], 3) for clock in clocks}
    known = registers(text, top)
    exceptions = tuple(_limit(each, why, periods, known) for each, why in explained)
    bounds = {}
    for one in exceptions:
        pair = one.crossing.source_clock, one.crossing.destination_clock
        if pair[0] in periods:
            bounds[pair] = min(periods[pair[0]], periods[pair[1]])
    settling = {name for one, (_, why) in zip(exceptions, explained, strict=True)
                if why.chain or one.pin == "pixel_rst" for name, _ in one.destinations}
    settling |= {second for name in settling
                 if (second := re.sub(r"stage0$", "stage1", name)) in known}
    inputs, outputs = _pin_clocks(component, graph, pins)
    return Timing(
        periods, exceptions, bounds, tuple(sorted(settling)),
        tuple(sorted(name for name in known if name.startswith("laser_guard."))),
        inputs, outputs)


def _pin_clocks(component, graph, pins):
    """Input and output pins by the clock that samples or drives them, from the netlist."""
    from hdl.export import flat_ports

    directions = {name: direction for name, (_, direction) in flat_ports(component).items()}
    inputs, outputs = defaultdict(list), defaultdict(list)
    for name, direction in directions.items():
        if direction == "i":
            inputs[pins.get(name, "clk")].append(name)
            continue
        drivers = {clock for bit in graph.outputs[name]
                   for _, clock in graph.sources(bit, None, {}) if clock is not None}
        if len(drivers) > 1:
            raise UserError(f"The pin {name} is driven from several clocks: "
                            f"{', '.join(sorted(drivers))}.")
        outputs[drivers.pop() if drivers else None].append(name)
    return ({clock: tuple(names) for clock, names in inputs.items()},
            {clock: tuple(names) for clock, names in outputs.items()})


def mark_registers(text, top, timing):
    """``text`` with the attributes of synchronisers and of the laser guard's registers."""
    known, bodies = registers(text, top), modules(text)
    marked = dict(bodies)
    for names, attributes in ((timing.guard, GUARD), (timing.synchronisers, SYNCHRONISER)):
        for name in names:
            module, register = known[name][0], name.rpartition(".")[2]
            marked[module] = re.sub(
                rf"^  (reg (?:signed )?(?:\[\d+:0\] )?{register}(?: *[=;]))",
                rf"  (* {attributes} *)\n  \1", marked[module], count=1, flags=re.M)
    for module, body in bodies.items():
        text = text.replace(body, marked[module])
    return text
