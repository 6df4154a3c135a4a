"""The flat netlist of a design as a graph: what drives each bit, and what it drives."""

import json
import re
from collections import defaultdict

from amaranth._toolchain.yosys import find_yosys

from hdl.export import to_rtlil

__all__ = ["Graph", "netlist"]

#: Cells whose output bits depend on the same bits of A and B only, and on all of S.
BITWISE = {"$and", "$or", "$xor", "$xnor", "$not", "$pos", "$mux", "$pmux", "$bwmux"}


def netlist(component, name="top"):
    """The flat netlist of ``component``, in the form of yosys' JSON: word-level cells and bits."""
    text = to_rtlil(component, name)
    yosys = find_yosys(lambda version: version >= (0, 40))
    answer = yosys.run(["-q", "-"], f"read_rtlil <<rtlil\n{text}\nrtlil\n"
                       "proc; flatten; opt_expr; opt_clean; memory_collect; opt_clean\n"
                       "write_json\n")
    return json.loads(answer[answer.index("{"):])["modules"][name]


class Graph:
    """What drives each bit of a netlist, and what it drives.

    Parameters
    ----------
    module : dict
        From :func:`netlist`.
    in_step : dict of :class:`str` to :class:`str`
        Clocks that are another one behind a gate: counted as that one.

    Attributes
    ----------
    inputs : list of (:class:`str`, :class:`str`, list, list)
        For each register and memory port its name, its clock, the bits at its inputs, and, for
        registers, those at its output.
    nets : dict of :class:`str` to set
        For the name of each register and memory all its names in the netlist, as they stand there.
    outputs : dict of :class:`str` to list
        The bits of each output of the design.
    """

    def __init__(self, module, in_step):
        self.in_step = in_step
        self.names = defaultdict(list)
        self.nets = defaultdict(set)
        self._all_names = defaultdict(set)
        for name, net in module["netnames"].items():
            # A submodule with the name of a signal has a number appended.
            plain = re.sub(r"\$\d+(?=\.|$)", "", name)
            if not net.get("hide_name") and "$" not in plain:
                for bit in net["bits"]:
                    self.names[bit].append(plain)
                    self._all_names[bit].add(name)
        self.pins = {bit: name for name, port in module["ports"].items()
                     if port["direction"] == "input" for bit in port["bits"]}
        self.outputs = {name: port["bits"] for name, port in module["ports"].items()
                        if port["direction"] == "output"}
        self.drivers = {}  # of logic: bit to (cell, port, index)
        self.registers = {}  # bit to (name, clock)
        self.inputs = []
        self.loads = defaultdict(list)  # bit to (kind, clock) of the cells that it drives
        for cell_name, cell in module["cells"].items():
            self._add(cell_name, cell)

    def label(self, bits, fallback):
        """The name of the first of ``bits`` that has one: the least nested, then the shortest."""
        for bit in bits:
            if self.names.get(bit):
                return min(self.names[bit], key=lambda name: (name.count("."), len(name)))
        return fallback

    def clock(self, bit):
        """The name of the clock on ``bit``."""
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
                self.nets[label] |= self._all_names[bit]
            inputs = [bit for port, bits in wires.items() if port not in ("CLK", "Q")
                     for bit in bits]
            self._add_inputs(label, clock, inputs, wires["Q"])
        elif kind in ("$check", "$print", "$scopeinfo"):
            pass
        else:
            for port, direction in cell["port_directions"].items():
                for index, bit in enumerate(wires[port]):
                    if direction == "output":
                        self.drivers[bit] = (cell, index)
                    else:
                        self.loads[bit].append(("logic", None))

    def _add_memory(self, name, cell):
        wires, parameters = cell["connections"], cell["parameters"]
        memory = parameters["MEMID"].lstrip("\\")
        self.nets[memory].add(memory)
        width = int(parameters["WIDTH"], 2)
        address_bits = int(parameters["ABITS"], 2)
        writers = set()  # clocks
        for port in range(int(parameters["WR_PORTS"], 2)):
            clock = self.clock(wires["WR_CLK"][port])
            writers.add(clock)
            inputs = [bit for key, size in (("WR_ADDR", address_bits), ("WR_DATA", width),
                                            ("WR_EN", width))
                      for bit in wires[key][port * size:(port + 1) * size]]
            self._add_inputs(memory, clock, inputs)
        contents = [("memory", memory, writer) for writer in writers]
        enabled = parameters["RD_CLK_ENABLE"][::-1]
        for port in range(int(parameters["RD_PORTS"], 2)):
            data = wires["RD_DATA"][port * width:(port + 1) * width]
            address = wires["RD_ADDR"][port * address_bits:(port + 1) * address_bits]
            if enabled[port] == "1":
                clock = self.clock(wires["RD_CLK"][port])
                label = f"{memory}_r_data"
                for bit in data:
                    self.registers[bit] = (label, clock)
                self._add_inputs(label, clock, [*address, wires["RD_EN"][port], *contents])
            else:
                for bit in data:
                    self.drivers[bit] = ({"type": "$memory", "connections": {
                        "A": [*address, *contents]},
                        "port_directions": {"A": "input"}}, 0)

    def _add_inputs(self, label, clock, inputs, outputs=()):
        self.inputs.append((label, clock, inputs, outputs))
        for bit in inputs:
            self.loads[bit].append(("register", clock))

    def before(self, bit):
        """Input bits of the logic that drives ``bit``."""
        cell, index = self.drivers[bit]
        wires = cell["connections"]
        inputs = []
        for port, direction in cell["port_directions"].items():
            if direction == "output":
                continue
            bits = wires[port]
            if cell["type"] in BITWISE and port in ("A", "B"):
                width = len(wires["Y"])
                if cell["type"] == "$pmux" and port == "B":
                    inputs += bits[index::width]
                elif index < len(bits):
                    inputs.append(bits[index])
                else:
                    inputs.append(bits[-1])  # signs are extended
            else:
                inputs += bits
        return inputs

    def source(self, bit):
        """Name and clock of what stores ``bit``, or None if logic or nothing drives it."""
        if isinstance(bit, tuple):
            return bit[1], bit[2]
        if bit in self.registers:
            return self.registers[bit]
        if bit in self.pins:
            return f"pin {self.pins[bit]}", None
        return None

    def sources(self, bit, clock, known):
        """Starts of all paths to ``bit`` from other clocks than ``clock``, and from pins."""
        if bit in known:
            return known[bit]
        stack, order, visited = [bit], [], set()
        while stack:
            one = stack.pop()
            if one in visited or one in known:
                continue
            visited.add(one)
            order.append(one)
            if self.source(one) is None and one in self.drivers:
                stack += self.before(one)
        # The order is not topological: repeat until nothing changes.
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
        """Whether ``bits``, of a flip-flop, drive only flip-flops of ``clock``, without logic."""
        inputs = [each for bit in bits for each in self.loads.get(bit, ())]
        return bool(inputs) and all(each == ("register", clock) for each in inputs)
