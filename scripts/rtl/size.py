"""Prints what each block costs on a Virtex-II Pro.

Synthesis is ``synth_xilinx -family xc2vp -flatten`` of yosys; the limits are on what that gives.
The column "no MUXF" gives the size with ``-nowidelut``, which uses no MUXF5 to MUXF8 and
minimises tables instead of levels of logic.

LUT4 is the number of four-input tables that the cells use: LUT1 to LUT4 and INV one each, RAM16X1S
and SRL16 one, RAM16X1D two. Carry chains and MUXF5 to MUXF8 are not counted. FF counts every
FD-cell. Results are cached, see :mod:`scripts.rtl.synthesis`.
"""

import argparse
import json
import sys
from concurrent.futures import ThreadPoolExecutor

from scripts.rtl.blocks import ASSEMBLIES, find, present
from scripts.rtl.synthesis import BUILD, FAMILIES, cells_of, checked
from scripts.rtl.verilog import verilog

__all__ = ["BUILD", "CELLS", "LIMITS", "measure", "measure_verilog"]

#: Four-input tables that a cell uses.
CELLS = {
    "LUT1": 1, "LUT2": 1, "LUT3": 1, "LUT4": 1, "INV": 1,
    "RAM16X1S": 1, "RAM16X1D": 2, "RAM32X1S": 2, "RAM32X1D": 4, "RAM64X1S": 4, "RAM64X1D": 8,
    "SRL16": 1, "SRL16E": 1,
}
#: Largest allowed numbers of four-input tables, multipliers and block memories.
LIMITS = {
    "capsule": {"lut4": 5000, "mult18x18": 14, "ramb16": 19},
    "paper": {"lut4": 11700, "mult18x18": 56, "ramb16": 124},
    "instrument": {"lut4": 7400, "mult18x18": 14, "ramb16": 20},
    "labelling": {"lut4": 1500, "ramb16": 6},
}
COLUMNS = ("lut4", "ff", "mult18x18", "ramb16")


def summarise(cells):
    """Sizes from yosys's counts of cells."""
    return {
        "lut4": sum(CELLS.get(cell, 0) * count for cell, count in cells.items()),
        "ff": sum(count for cell, count in cells.items() if cell.startswith(("FD", "LD"))),
        "mult18x18": sum(n for cell, n in cells.items() if cell.startswith("MULT18X18")),
        "ramb16": sum(count for cell, count in cells.items() if cell.startswith("RAMB16")),
        "distributed": sum(
            CELLS[cell] * count for cell, count in cells.items()
            if cell in CELLS and cell.startswith("RAM")),
        "latches": sum(count for cell, count in cells.items() if cell.startswith("LD")),
        "cells": dict(sorted(cells.items())),
    }


def measure_verilog(text, name, muxf=True):
    """Size of module ``name`` of the Verilog ``text``, from the cache if it is there.

    Without ``muxf``, yosys may not join tables with MUXF5 to MUXF8.

    Raises
    ------
    RuntimeError
        If yosys cannot synthesise it; the message ends with that of yosys.
    """
    script = checked(FAMILIES["xc2vp"]).format(top=name)
    if not muxf:
        script = script.replace("-family xc2vp", "-family xc2vp -nowidelut")
    return summarise(cells_of(text, name, script))


def measure(block):
    """Size of ``block`` with its preset, its tables counted in both ways."""
    text = verilog(block.component(), block.name)
    size = measure_verilog(text, block.name)
    return size | {"lut4_no_muxf": measure_verilog(text, block.name, muxf=False)["lut4"]}


def over(name, size):
    """Sentences on the limits that ``size`` exceeds."""
    return [
        f"{name} uses {size[column]} {column}, more than its limit of {limit}"
        for column, limit in LIMITS.get(name, {}).items() if size[column] > limit]


def main(arguments=None):
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    parser = argparse.ArgumentParser(
        prog="python -m scripts.rtl.size", description=__doc__.split("\n")[0])
    parser.add_argument("block", nargs="*", help="blocks to measure (default: all and the top)")
    parser.add_argument("--json", metavar="FILE", help="also write the sizes there")
    parser.add_argument("--cells", action="store_true", help="list the cells of each block")
    parser.add_argument("--jobs", type=int, default=1, help="syntheses at a time (default: 1)")
    options = parser.parse_args(arguments)
    try:
        blocks = [find(name) for name in options.block] or list(present())
    except LookupError as error:
        parser.error(str(error))

    sizes, faults = {}, []
    # The first synthesis on a machine fills yowasp's cache; two at once would both do so.
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("Synthesis", total=len(blocks))

        def step(block):
            try:
                return block.name, measure(block), None
            except Exception as error:  # one bad block must not hide the others
                return block.name, None, f"{type(error).__name__}: {error}"
            finally:
                progress.advance(task)

        with ThreadPoolExecutor(options.jobs) as pool:
            for name, size, fault in pool.map(step, blocks):
                if fault:
                    faults.append(f"{name}: {fault}")
                else:
                    sizes[name] = size
                    faults.extend(over(name, size))

    table = Table(title="Virtex-II Pro, yosys synth_xilinx -family xc2vp")
    table.add_column("block")
    for title in ("LUT4", "no MUXF", "FF", "MULT18X18", "RAMB16"):
        table.add_column(title, justify="right")

    def row(name, size, style=None):
        table.add_row(name, *(f"{size[key]:,}" for key in (
            "lut4", "lut4_no_muxf", "ff", "mult18x18", "ramb16")), style=style)

    assemblies = [block.name for block in ASSEMBLIES if block.name in sizes]
    parts = [name for name in sizes if name not in assemblies]
    for name in parts:
        row(name, sizes[name])
    if len(parts) > 1:
        table.add_section()
        row("sum of blocks", {
            key: sum(sizes[name][key] for name in parts) for key in (*COLUMNS, "lut4_no_muxf")},
            style="dim")
    for name in assemblies:
        row(f"{name} (assembly)", sizes[name], style="bold")
    console = Console()
    if sizes:
        console.print(table)
    if options.cells:
        for name, size in sizes.items():
            console.print(f"{name}: " + ", ".join(f"{n} {c}" for c, n in size["cells"].items()))
    if options.json:
        with open(options.json, "w") as file:
            json.dump({"limits": LIMITS, "sizes": sizes}, file, indent=1)
            file.write("\n")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
