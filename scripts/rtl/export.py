"""Writes every block and the top for other tools: Verilog, VHDL twins, tables, vendor projects.

In the folder, ``verilog/`` holds a file a block, with port names that VHDL
can also spell, ``vhdl/`` the hand-written twins, ``memory/`` what memories hold at power-up,
``tables/`` what a calibration loads, ``PORTS.md`` and ``MEMORIES.md`` the tables, and ``ise/``,
``vivado/`` and ``libero/`` a project of the whole design each.
"""

import shutil

from amaranth.hdl import Shape
from amaranth.lib import data

from hdl.config import PRESETS
from hdl.export import flat_ports
from hdl.protocol import REMAP, tables
from scripts.rtl.blocks import TOP, present
from scripts.rtl.vendor_projects import ISE, LIBERO, VIVADO, edalize_project, libero_project
from scripts.rtl.verilog import memories, ports, verilog

__all__ = ["export"]

README = """\
# {name}, exported

Preset `capsule`: {width} x {height} pixels, {beams} beams on {lanes} lanes; `paper.v` and the
blocks that only it uses are of the preset `paper`. `paper.v` is the measuring half alone, without
commands, sequencer and laser guard. `PORTS.md` lists the ports of all blocks, `MEMORIES.md` the
contents of memories at power-up.

| Folder | Holds |
|---|---|
| `verilog/` | each block on its own; `{top}.v` is the whole design in one file, from the imager's \
pins to the serial pins, and `capsule.v` the part between pixels and packets |
| `vhdl/` | hand-written twins in VHDL-93 with the same ports; generics are the constructor's \
arguments |
| `memory/` | contents of the memories that do not start as zeros, one hexadecimal word per line |
| `tables/` | with `--calibration FILE`: the contents of registers and tables |
| `ise/` | project for the {ise[device]}-{ise[package]}{ise[speed]}: `make` there, ISE <= 10.1 |
| `vivado/` | project for the {vivado[part]}: `make` there |
| `libero/` | project for the {libero[family]} {libero[die]}: `libero SCRIPT:{top}.tcl` there |

The Verilog contains the memory contents; `memory/` is for tools that need files. `clk` is the
clock of the domain `sync`, `rst` its synchronous reset, high for one clock or more; other domains
put their name before it, as in `pixel_clk`. The projects have no pins and no timing constraints.

Flash parts (ProASIC3, IGLOO, PolarFire) give neither flip-flops nor memories a value at power-up:
hold `rst` (and `pixel_rst`) until the clocks run, and load all tables over the serial line
(`cyclope load`) after each power-up; `MEMORIES.md` shows which memories do not start as zeros. The
projects were written without the vendors' tools and have not been run.
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


def export(folder, progress=lambda block: None, settings=None):
    """Write all of it to ``folder`` and return the blocks that are in it.

    Parameters
    ----------
    folder : path
        Where; a new or an empty folder.
    progress : callable
        Is called with each block when it is done.
    settings : :class:`model.settings.Settings`, optional
        What the chip is loaded with.
    """
    config = PRESETS["capsule"]
    for name in ("verilog", "vhdl", "memory"):
        (folder / name).mkdir(parents=True)
    texts, held = [], []
    for block in present():
        component = block.component()
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
    (folder / "README.md").write_text(README.format(
        name="Cyclope", top=TOP.name, width=config.width, height=config.height, beams=config.beams,
        lanes=config.lanes, ise=ISE, vivado=VIVADO, libero=LIBERO))
    if settings is not None:
        write_tables(folder / "tables", settings)
    if TOP.source.exists():
        edalize_project(folder / "ise", "ise", ISE)
        edalize_project(folder / "vivado", "vivado", VIVADO)
        libero_project(folder / "libero")
    return [block for block, _, _ in texts]
