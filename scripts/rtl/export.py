"""Writes the design for other tools: every block, and a folder for each flow.

In ``generic/`` are a Verilog file a block, with port names that VHDL can also spell, the
hand-written VHDL twins, what memories hold at power-up, what a calibration loads, tables of ports,
memories and clock crossings, a list of files and a FuseSoC core. The other folders are those of
:mod:`scripts.rtl.flows.make`.
"""

import shutil

from amaranth.hdl import Shape
from amaranth.lib import data

from hdl.config import PRESETS
from hdl.export import flat_ports
from hdl.protocol import REMAP, tables
from model.errors import UserError
from scripts.rtl.blocks import TOP, present
from scripts.rtl.flows.make import TooSmallError, choose, describe, design, prepare
from scripts.rtl.flows.parts import FLOWS, PARTS, boards_of
from scripts.rtl.synthesis import synthesise
from scripts.rtl.verilog import memories, ports, verilog

__all__ = ["export", "generic", "write_tables"]

INDEX = """\
# Cyclope, exported

{choice}.
The system clock of a flow is what its boards make of their oscillators, see its page.

| Folder | For |
|---|---|
{rows}

Each folder has a page: what you get, how to build, what to check. Nothing of this was run with a
vendor's tool.
{left_out}"""
_FOR = {
    "generic": "any tool: blocks, file list, FuseSoC core, contents of memories, tables of ports",
    "xilinx-ise": "ISE 10.1", "xilinx-vivado": "Vivado", "libero": "Libero",
    "lattice-ecp5": "yosys and nextpnr",
}
GENERIC = """\
# Cyclope for any tool

{choice}. Blocks that only the other preset has are of that preset, at the same size. `capsule.v`
and `paper.v` are the measuring half alone, without commands, sequencer and laser guard.

## What you get

| File | Holds |
|---|---|
| `verilog/` | each block on its own; `{top}.v` is the whole design in one file, from the imager's \
pins to the serial pins |
| `vhdl/` | hand-written twins in VHDL-93 with the same ports; generics are the constructor's \
arguments |
| `memory/` | contents of the memories that do not start as zeros, one hexadecimal word per line |
| `tables/` | with a calibration: the contents of registers and tables |
| `PORTS.md`, `MEMORIES.md`, `CROSSINGS.md` | ports of all blocks, memories at power-up, paths \
between clocks and what each needs |
| `files.f` | the files of the whole design, for tools that take a list |
| `cyclope.core` | the same as a FuseSoC core |

## How to build

Read `files.f` and choose the top `{top}`. The Verilog contains the memory contents; `memory/` is
for tools that need files. `clk` is the clock of the domain `sync`, `rst` its synchronous reset,
high for one clock or more; other domains put their name before it, as in `pixel_clk`. Constrain the
clocks, and each path of `CROSSINGS.md`.

Flash parts (ProASIC3, IGLOO, PolarFire) give neither flip-flops nor memories a value at power-up:
hold `rst` (and `pixel_rst`) until the clocks run, and load all tables over the serial line
(`cyclope load`) after each power-up.

## What to check

- Flip-flops of synchronisers (`stage0`, `stage1`) are neither merged nor made shift registers.
- Registers of `laser_guard` are all there: some are equal unless a bit has flipped.
- `laser` has a register in its I/O cell, behind the guard; the driver is AC-coupled.
"""
_CORE = """\
CAPI=2:
name: cyclope:rtl:{top}:1.0.0
description: 3-D imaging in a video capsule
filesets:
  rtl:
    files:
      - verilog/{top}.v
    file_type: verilogSource
targets:
  default:
    filesets: [rtl]
    toplevel: {top}
  lint:
    filesets: [rtl]
    toplevel: {top}
    default_tool: verilator
    tools:
      verilator:
        mode: lint-only
"""


def fields(shape, offset=0, prefix=""):
    """Yield the name and bits of each field of a payload."""
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
    """Markdown table of the ports of ``blocks``: each a block, its component and its Verilog."""
    lines = ["# Ports", "", "Bits of a payload are counted from the least significant one.", ""]
    for block, component, text in blocks:
        summary = (block.component_class.__doc__ or "").strip().split("\n")[0]
        lines += [f"## {block.name}", "", summary, "",
                  "| Port | Direction | Bits | Fields |", "|---|---|---:|---|"]
        inside = payloads(component)
        # Clocks and resets first, then the members in the order of the signature.
        order = {name: index for index, name in enumerate(flat_ports(component))}
        lines += [
            f"| `{port.name}` | {port.direction} | {port.width} | {inside.get(port.name, '')} |"
            for port in sorted(ports(text, block.name), key=lambda port: order.get(port.name, -1))]
        lines.append("")
    return "\n".join(lines)


def memory_table(held):
    """Markdown table of memories, from pairs of a block and its memories."""
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
    """The text of a memory's file for ``$readmemh``."""
    digits = (memory.width + 3) // 4
    return (
        f"// {memory.module}, {memory.name}: {len(memory.words)} words of {memory.width} bits, "
        "first word first, at power-up\n"
        + "".join(f"{word:0{digits}x}\n" for word in memory.words))


def write_tables(folder, settings):
    """Write the contents of a calibrated chip: a file for each table, and the registers."""
    folder.mkdir()
    contents = settings.tables()
    for table in tables("paper" if settings.remap else "capsule"):
        words = contents[table.name]
        head = (f"table {table.number} of TABLE: {len(words)} words, each two of the external "
                "memory, the lower one first, number" if table == REMAP
                else f"table_select {table.number}: {len(words)} words, table_address")
        (folder / f"{table.name}.hex").write_text(
            f"// {head} behind the @\n"
            + "".join(f"@{address:x} {word:x}\n" for address, word in enumerate(words)))
    lines = ["| Register | Value |", "|---|---:|"]
    lines += [f"| `{name}` | {value} |" for name, value in settings.registers().items()]
    (folder / "REGISTERS.md").write_text("\n".join(["# Registers", "", *lines, ""]))


def crossing_table(timing):
    """Markdown table of the paths between clocks of a :class:`scripts.rtl.timing.Timing`."""
    lines = ["# Clock crossings", "", "| From | To | Bits | Longest delay, ns | Why it is safe |",
             "|---|---|---:|---:|---|"]
    for one in timing.exceptions:
        path = one.crossing
        lines.append(
            f"| `{path.source}` ({path.source_clock}) | `{path.destination}` "
            f"({path.destination_clock}) | {path.bits} | "
            f"{'any' if one.ns is None else f'{one.ns:.3f}'} | {one.why} |")
    return "\n".join([*lines, ""])


def generic(folder, config, progress=lambda block: None, settings=None):
    """Write the folder for any tool and return the blocks that are in it.

    Parameters
    ----------
    folder : path
        Where; a new or an empty folder.
    config : :class:`hdl.config.Config`
        Choices; blocks of the other preset get the same size.
    progress : callable
        Is called with each block when it is done.
    settings : :class:`model.settings.Settings`, optional
        What the chip is loaded with.
    """
    other = {
        preset: config if preset == config.preset else choose(
            preset, (config.width, config.height), config.beams) for preset in PRESETS}
    for name in ("verilog", "vhdl", "memory"):
        (folder / name).mkdir(parents=True)
    texts, held = [], []
    for block in present():
        chosen = config if block == TOP else other[block.preset]
        if block == TOP:
            component, text, timing = design(chosen)
            (folder / "CROSSINGS.md").write_text(crossing_table(timing))
        else:
            component = block.component(chosen)
            text = verilog(component, block.name)
        texts.append((block, component, text))
        (folder / "verilog" / f"{block.name}.v").write_text(text)
        if block.twin:
            shutil.copy(block.twin, folder / "vhdl")
        held.append((block, memories(text)))
        for memory in held[-1][1]:
            if any(memory.words):
                (folder / "memory" / memory.file_name).write_text(hexadecimal(memory))
        progress(block)
    (folder / "PORTS.md").write_text(port_table(texts))
    (folder / "MEMORIES.md").write_text(memory_table(held))
    (folder / "README.md").write_text(GENERIC.format(choice=describe(config), top=TOP.name))
    (folder / "files.f").write_text(f"verilog/{TOP.name}.v\n")
    (folder / "cyclope.core").write_text(_CORE.format(top=TOP.name))
    if settings is not None:
        write_tables(folder / "tables", settings)
    return [block for block, _, _ in texts]


def export(folder, config=PRESETS["capsule"], flows=(), part=None,
           progress=lambda block: None, settings=None, count=synthesise):
    """Write all of it to ``folder``; gives the blocks, and a sentence for each part left out.

    Parameters
    ----------
    folder : path
        Where; a new or an empty folder.
    config : :class:`hdl.config.Config`
        Choices before synthesis.
    flows : sequence of :class:`str`
        Of :data:`scripts.rtl.flows.parts.FLOWS`; all that have a part for the design if empty.
    part : :class:`str`, optional
        The only part to write projects for.
    progress, settings
        See :func:`generic`.
    count : callable
        See :func:`scripts.rtl.flows.make.prepare`.

    Raises
    ------
    UserError
        If a flow that is named has no part for the design, or a path between clocks no waiver.
        Nothing is written then.
    """
    wrong = [name for name in flows if name not in FLOWS]
    if wrong:
        raise UserError(f"There is no flow {wrong[0]!r}; there are {', '.join(FLOWS)}.")
    if part is not None and part not in PARTS:
        raise UserError(f"There is no part {part!r}; there are {', '.join(PARTS)}.")
    ready, left_out = [], []
    for name in flows or FLOWS:
        if name == "generic":
            continue
        if not flows and part is not None and not boards_of(name, part):
            continue
        try:
            ready.append(prepare(name, config, part, count=count))
            left_out += ready[-1].left_out
        except TooSmallError as error:
            if flows or part:
                raise
            left_out.append(str(error).rstrip("."))
    folder.mkdir(parents=True, exist_ok=True)
    blocks = []
    if not flows or "generic" in flows:
        blocks = generic(folder / "generic", config, progress, settings)
    for flow in ready:
        flow.write(folder / flow.name)
    names = [*(["generic"] if blocks else []), *(flow.name for flow in ready)]
    (folder / "README.md").write_text(INDEX.format(
        choice=describe(config), rows="\n".join(f"| `{name}/` | {_FOR[name]} |" for name in names),
        left_out="".join(f"\nLeft out: {sentence}.\n" for sentence in left_out)))
    return blocks, left_out
