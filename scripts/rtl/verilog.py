"""The Verilog of a component with names that are legal in VHDL too, and its ports and memories."""

import re
from dataclasses import dataclass

from hdl.export import flat_ports, to_verilog

__all__ = ["Memory", "Port", "memories", "memory_bits", "modules", "ports", "verilog"]


@dataclass(frozen=True)
class Port:
    """A port of a Verilog module."""

    name: str
    direction: str
    width: int


@dataclass(frozen=True)
class Memory:
    """A memory of a Verilog module and its words at power-up."""

    module: str
    name: str
    width: int
    words: tuple

    @property
    def file_name(self):
        return f"{self.module}.{self.name}.hex"


def verilog(component, name):
    """Verilog of ``component``, reproducible; inner modules have no escaped names.

    Clocks and resets come first, then the ports in the order of the signature; in inner modules
    they are sorted.
    """
    order = {port: index for index, port in enumerate(flat_ports(component))}
    text = to_verilog(component, name)
    inner = re.findall(r"^module \\(\S+)", text, re.MULTILINE)
    legal = {module: re.sub(r"\W+", "_", module) for module in inner}
    if len(set(legal.values()) | {name}) != len(inner) + 1:
        raise NameError(f"Inner modules of {name!r} differ only in their punctuation")
    text = re.sub(r"^(module |  )\\(\S+) ", lambda match: match[1] + (
        legal[match[2]] + " " if match[2] in legal else f"\\{match[2]} "), text, flags=re.MULTILINE)

    text = _without_dollars(text)

    def header(match):
        listed = [port.strip() for port in match[2].split(",")]
        listed.sort(key=lambda port: (order.get(port, -1) if match[1] == name else 0, port))
        spelt = (port + " " if port.startswith("\\") else port for port in listed)
        return f"module {match[1]}({', '.join(spelt)});"

    return re.sub(r"^module (\w+) ?\(([^;]*)\);$", header, text, flags=re.MULTILINE)


def _without_dollars(text):
    """``text`` with ``name_1`` for each ``\\name$1``, unless that is another name."""
    taken = set(re.findall(r"\w+", text))

    def plain(match):
        name = match[1].replace("$", "_")
        return match[0] if name in taken else name

    return re.sub(r"\\([A-Za-z_]\w*(?:\$\d+)+)(?=\s)", plain, text)


def modules(text):
    """Map the modules of a Verilog text to their bodies."""
    return {
        match[1]: match[0]
        for match in re.finditer(r"^module (\S+?) ?\(.*?^endmodule", text, re.M | re.S)}


def ports(text, name):
    """Ports of module ``name`` of a Verilog text."""
    return [
        Port(match[3], match[1], int(match[2] or 0) + 1)
        for match in re.finditer(
            r"^  (input|output) (?:signed )?(?:wire |reg )?(?:signed )?(?:\[(\d+):0\] )?(\S+) ?;",
            modules(text)[name], re.MULTILINE)]


def memories(text):
    """Memories of all modules of a Verilog text."""
    found = []
    for module, body in modules(text).items():
        for match in re.finditer(r"^  reg (?:\[(\d+):0\] )?(\S+) +\[(\d+):0\];", body, re.M):
            words = [0] * (int(match[3]) + 1)
            for word in re.finditer(
                    rf"^    {re.escape(match[2])}\[(\d+)\] = \d+'(?:h([0-9a-fx]+)|d(\d+));",
                    body, re.M):
                words[int(word[1])] = int(word[2], 16) if word[2] else int(word[3])
            name = re.sub(r"\W+", "_", match[2]).strip("_")
            found.append(Memory(module, name, int(match[1] or 0) + 1, tuple(words)))
    return found


def memory_bits(text):
    """Bits of all memories of a Verilog text, in which each module stands once."""
    return sum(memory.width * len(memory.words) for memory in memories(text))
