"""Writes every block and the top for other tools: Verilog, VHDL twins, tables, vendor projects.

All of it goes to ``build/export``: ``verilog/`` holds a file a block, with port names that VHDL
can also spell, ``vhdl/`` the hand-written twins, ``memory/`` what memories hold at power-up,
``tables/`` what a calibration loads, ``PORTS.md`` and ``MEMORIES.md`` the tables, and ``ise/``,
``vivado/`` and ``libero/`` a project of the whole design each. A folder that exists is replaced
once the new one is complete.
"""

import argparse
import contextlib
import io
import logging
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from string import Template

from amaranth.hdl import Shape
from amaranth.lib import data

from hdl.config import PRESETS
from hdl.export import flat_ports, to_verilog
from hdl.protocol import PLACES, tables
from model.errors import UserError
from scripts.blocks import ROOT, TOP, present
from scripts.commands import table_contents

__all__ = ["Memory", "Port", "export", "memories", "ports", "verilog"]

BUILD = ROOT / "build" / "export"
TEMPLATES = Path(__file__).resolve().parent / "templates"
ISE = {"family": "virtex2p", "device": "xc2vp30", "package": "ff896", "speed": "-7"}
VIVADO = {"part": "xc7a100tcsg324-1"}
LIBERO = {
    "family": "ProASIC3", "die": "A3P1000", "package": "484 FBGA", "speed": "STD",
    "voltage": "1.5", "range": "COM",
}
README = """\
# {name}, exported

Preset `capsule`: {width} x {height} pixels, {beams} beams on {lanes} lanes; `paper.v` and what only
it uses are of the preset `paper`. `paper.v` is the measuring half alone, without commands,
sequencer and laser guard. `PORTS.md` lists what joins the blocks, `MEMORIES.md` what memories hold
at power-up.

| Folder | Holds |
|---|---|
| `verilog/` | each block on its own; `{top}.v` is the whole design in one file, from the imager's \
pins to the serial pins, and `capsule.v` what is between pixels and packets |
| `vhdl/` | hand-written twins, VHDL-93, same ports; generics as the constructor's arguments |
| `memory/` | contents of the memories that do not start as zeros, a hexadecimal word a line |
| `tables/` | with `--calibration FILE`: what it loads into registers and tables |
| `ise/` | project for the {ise[device]}-{ise[package]}{ise[speed]}: `make` there, ISE <= 10.1 |
| `vivado/` | project for the {vivado[part]}: `make` there |
| `libero/` | project for the {libero[family]} {libero[die]}: `libero SCRIPT:{top}.tcl` there |

The Verilog holds its own memory contents; `memory/` is for tools that want files. `clk` is the
clock of the domain `sync`, `rst` its synchronous reset, high for one clock or more; other domains
put their name before it, as in `pixel_clk`. The projects have no pins and no timing constraints.

Flash parts (ProASIC3, IGLOO, PolarFire) give neither flip-flops nor memories a value at power-up:
hold `rst` (and `pixel_rst`) until the clocks run, and load all tables over the serial line
(`cyclope load`) after each power-up; `MEMORIES.md` tells which memories start with something else
than zeros. The projects were written without the vendors' tools at hand, and not run.
"""


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
    """Verilog of ``component``, the same each time; inner modules need no escaped names.

    Ports stand in the order of the signature, clocks and resets before them; in inner modules they
    are sorted.
    """
    order = {port: place for place, port in enumerate(flat_ports(component))}
    text = to_verilog(component, name)
    inner = re.findall(r"^module \\(\S+)", text, re.MULTILINE)
    legal = {module: re.sub(r"\W+", "_", module) for module in inner}
    if len(set(legal.values()) | {name}) != len(inner) + 1:
        raise NameError(f"Inner modules of {name!r} differ only in their punctuation")
    text = re.sub(r"^(module |  )\\(\S+) ", lambda match: match[1] + (
        legal[match[2]] + " " if match[2] in legal else f"\\{match[2]} "), text, flags=re.MULTILINE)

    def header(match):
        listed = [port.strip() for port in match[2].split(",")]
        listed.sort(key=lambda port: (order.get(port, -1) if match[1] == name else 0, port))
        spelt = (port + " " if port.startswith("\\") else port for port in listed)
        return f"module {match[1]}({', '.join(spelt)});"

    return re.sub(r"^module (\w+) ?\(([^;]*)\);$", header, text, flags=re.MULTILINE)


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


def fields(shape, offset=0, prefix=""):
    """Yield a line on each field of a payload: its name and bits."""
    layout = data.Layout.cast(shape) if _is_layout(shape) else None
    if layout is None:
        width = Shape.cast(shape).width
        sign = "signed " if Shape.cast(shape).signed else ""
        bits = f"{offset}" if width == 1 else f"{offset + width - 1}..{offset}"
        yield f"{sign}{prefix} {bits}"
        return
    for name, field in layout:
        path = f"{prefix}.{name}" if prefix else name
        yield from fields(field.shape, offset + field.offset, path)


def _is_layout(shape):
    try:
        data.Layout.cast(shape)
    except TypeError:
        return False
    return True


def payloads(component):
    """Map port names to the bits of their fields, where they have any."""
    return {
        "_".join(map(str, path)): ", ".join(fields(member.shape))
        for path, member, _ in component.signature.flatten(component) if _is_layout(member.shape)}


def port_table(blocks):
    """Markdown on the ports of ``blocks``: each a block, its component and its Verilog."""
    lines = ["# Ports", "", "Bits of a payload are counted from the least significant one.", ""]
    for block, component, text in blocks:
        summary = (block.component_class.__doc__ or "").strip().split("\n")[0]
        lines += [f"## {block.name}", "", summary, "",
                  "| Port | Direction | Bits | Fields |", "|---|---|---:|---|"]
        inside = payloads(component)
        # Clocks and resets first, then the members in the order of the signature.
        order = {name: place for place, name in enumerate(flat_ports(component))}
        lines += [
            f"| `{port.name}` | {port.direction} | {port.width} | {inside.get(port.name, '')} |"
            for port in sorted(ports(text, block.name), key=lambda port: order.get(port.name, -1))]
        lines.append("")
    return "\n".join(lines)


def memory_table(held):
    """Markdown on memories: pairs of a block and its memories."""
    lines = ["# Memories", "", "| Block | Module | Memory | Words | Bits | At power-up |",
             "|---|---|---|---:|---:|---|"]
    for block, found in held:
        lines += [
            f"| {block.name} | `{memory.module}` | `{memory.name}` | {len(memory.words)} | "
            f"{memory.width} | "
            + (f"`memory/{memory.file_name}`" if any(memory.words) else "zeros") + " |"
            for memory in found]
    return "\n".join([*lines, ""])


def hexadecimal(memory):
    """The text of a memory's file, which ``$readmemh`` takes."""
    digits = (memory.width + 3) // 4
    return (
        f"// {memory.module}, {memory.name}: {len(memory.words)} words of {memory.width} bits, "
        "first word first, at power-up\n"
        + "".join(f"{word:0{digits}x}\n" for word in memory.words))


def write_tables(folder, settings):
    """Write what a calibration loads: a file for each of the chip's tables, and the registers."""
    folder.mkdir()
    contents = table_contents(settings)
    for table in tables("paper" if settings.remap else "capsule"):
        words = contents[table.name]
        head = (f"table {table.number} of TABLE: {len(words)} words, each two of the external "
                "memory, the lower one first, number" if table == PLACES
                else f"table_select {table.number}: {len(words)} words, table_address")
        (folder / f"{table.name}.hex").write_text(
            f"// {head} behind the @\n"
            + "".join(f"@{address:x} {word:x}\n" for address, word in enumerate(words)))
    lines = ["| Register | Value |", "|---|---:|"]
    lines += [f"| `{name}` | {value} |" for name, value in settings.registers().items()]
    (folder / "REGISTERS.md").write_text("\n".join(["# Registers", "", *lines, ""]))


def edalize_project(folder, tool, options):
    """Write a project with edalize, which needs no vendor tool for that."""
    from edalize.edatool import get_edatool

    folder.mkdir()
    logging.disable(logging.WARNING)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            get_edatool(tool)(work_root=str(folder), edam={
                "name": TOP.name, "toplevel": TOP.name, "parameters": {},
                "files": [{"name": f"../verilog/{TOP.name}.v", "file_type": "verilogSource"}],
                "tool_options": {tool: options},
            }).configure()
    finally:
        logging.disable(logging.NOTSET)


def libero_project(folder):
    """Write a Libero script; edalize's own has an absolute path in it and a flow of newer parts."""
    folder.mkdir()
    template = Template((TEMPLATES / "libero.tcl").read_text())
    (folder / f"{TOP.name}.tcl").write_text(template.substitute(
        LIBERO, name=TOP.name, source=f"../verilog/{TOP.name}.v"))


def export(folder=BUILD, progress=lambda block: None, settings=None):
    """Write all of it to ``folder`` and return the blocks that are in it.

    Parameters
    ----------
    folder : path
        Where; what was there before is replaced at the end.
    progress : callable
        Is told of each block when it is done.
    settings : :class:`model.settings.Settings`, optional
        What the chip is loaded with.
    """
    config = PRESETS["capsule"]
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    for name in ("verilog", "vhdl", "memory"):
        (part / name).mkdir(parents=True)
    texts, held = [], []
    for block in present():
        component = block.component()
        text = verilog(component, block.name)
        texts.append((block, component, text))
        (part / "verilog" / f"{block.name}.v").write_text(text)
        if block.twin:
            shutil.copy(block.twin, part / "vhdl")
        held.append((block, memories(text)))
        for memory in held[-1][1]:
            if any(memory.words):
                (part / "memory" / memory.file_name).write_text(hexadecimal(memory))
        progress(block)
    (part / "PORTS.md").write_text(port_table(texts))
    (part / "MEMORIES.md").write_text(memory_table(held))
    (part / "README.md").write_text(README.format(
        name="Cyclope", top=TOP.name, width=config.width, height=config.height, beams=config.beams,
        lanes=config.lanes, ise=ISE, vivado=VIVADO, libero=LIBERO))
    if settings is not None:
        write_tables(part / "tables", settings)
    if TOP.source.exists():
        edalize_project(part / "ise", "ise", ISE)
        edalize_project(part / "vivado", "vivado", VIVADO)
        libero_project(part / "libero")
    shutil.rmtree(folder, ignore_errors=True)
    part.rename(folder)
    return [block for block, _, _ in texts]


def main(arguments=None):
    from rich.console import Console
    from rich.progress import Progress

    from calibration.file import load

    parser = argparse.ArgumentParser(
        prog="python -m scripts.export", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--calibration", metavar="FILE", help="also write what this calibration loads")
    options = parser.parse_args(arguments)
    settings = None
    if options.calibration:
        try:
            settings = load(Path(options.calibration)).settings
        except UserError as error:
            print(error, file=sys.stderr)
            return 1
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("Export", total=len(present()))
        blocks = export(
            progress=lambda block: progress.advance(task), settings=settings)
    twins = sum(block.twin is not None for block in blocks)
    print(f"{len(blocks)} blocks, {twins} VHDL twins and the vendor projects are in "
          f"{BUILD.relative_to(ROOT)}; its README.md tells what is what.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
