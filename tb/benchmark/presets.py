"""The two presets side by side: size, clocks, and depth on the same captures."""

import re

import numpy as np

__all__ = ["memory_bits", "presets"]

_SEEDS = range(1, 6)
_KINDS = ("plane", "tilted", "polyp", "tube")
_MEMORY = re.compile(r"^ *reg \[(\d+):0\] \S+ +\[(\d+):0\];", re.MULTILINE)


def memory_bits(verilog):
    """Bits of all memories of a Verilog text."""
    return sum((int(high) + 1) * (int(last) + 1) for high, last in _MEMORY.findall(verilog))


def _sizes():
    from scripts.rtl.blocks import find
    from scripts.rtl.size import measure_verilog
    from scripts.rtl.verilog import verilog

    sizes = {}
    for name in ("capsule", "paper", "vga", "sram_frames"):
        text = verilog(find(name).component(), name)
        sizes[name] = measure_verilog(text, name) | {"bits": memory_bits(text)}
    return sizes


def _clocks(config, image):
    """Clocks of the preset paper: per frame, and from its last pixel to its last point."""
    from tb.system.paper_rig import PaperBench
    from tb.system.stimuli import any_settings

    table = tuple(range(config.width * config.height))
    bench = PaperBench(config, any_settings(
        config.width, config.height, config.beams, area_min=1, remap=table, level_fixed=100,
        erosion="erode", weighted=False))
    return bench.until_free(image), bench.measure(image).latency


def _depth(rig):
    from tb.benchmark.depth_error import Case, measure

    cases = {"capsule": Case(rig, _KINDS, "weighted", None),
             "paper": Case(rig, _KINDS, "binary", None, preset="paper")}
    figures = {}
    for preset, case in cases.items():
        depth = measure(case, _SEEDS)
        figures[preset] = (f"{100 * depth.error.mean():.3f} %",
                           f"{100 * depth.found / depth.expected:.2f} %",
                           f"{100 * np.mean(depth.error > 0.05):.3f} %")
    return figures


def presets(console):
    """Both presets: size on a Virtex-II Pro, clocks, and depth on the same captures."""
    from rich.table import Table

    from hdl.config import PRESETS
    from tb.system.chain import last_point_latency, spots_on_the_last_row

    config = PRESETS["capsule"]
    table = Table(title=f"Presets, {config.width} x {config.height}, {config.beams} beams",
                  title_justify="left")
    table.add_column("")
    for name in ("capsule", "paper"):
        table.add_column(name, justify="right")
    sizes = _sizes()
    for title, key in (("LUT4", "lut4"), ("flip-flops", "ff"), ("MULT18X18", "mult18x18"),
                       ("RAMB16", "ramb16"), ("memory, bits", "bits")):
        display = sizes["vga"][key] + sizes["sram_frames"][key]
        table.add_row(title, f"{sizes['capsule'][key]:,}",
                      f"{sizes['paper'][key]:,} (display {display:,})")
    pixels = config.width * config.height
    banks = 3 * -(-config.width // 4) * config.height
    table.add_row("external memory, words of 32 bits", "",
                  f"{2 * -(-pixels // 2):,} (display {banks:,} more)")
    table.add_section()
    image = spots_on_the_last_row(config)
    period, latency = _clocks(PRESETS["paper"], spots_on_the_last_row(PRESETS["paper"]))
    table.add_row("clocks from a frame's first pixel until the next may begin", f"{pixels:,}",
                  f"{period:,}")
    table.add_row("clocks from the last pixel to the last of 64 points",
                  f"{last_point_latency(config, image)[0]:,}", f"{latency:,}")
    for rig in ("endoscope", "demonstrator"):
        table.add_section()
        figures = _depth(rig)
        for title, *values in zip(("mean depth error", "found", "wrong"), figures["capsule"],
                                  figures["paper"], strict=True):
            table.add_row(f"{title}, rig {rig}", *values)
    console.print(table)
