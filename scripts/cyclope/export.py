"""``cyclope export``: the design for other tools."""

import re
from pathlib import Path

from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope export`` takes."""
    parser.description = (
        "Write every block and the whole design for other tools: Verilog, VHDL twins, contents of "
        "memories, tables of ports, and a folder for each flow with project, constraints and a top "
        "for a board. OUT/README.md says what is what. What fits no part of a flow is left out, "
        "and refused if that flow was asked for.")
    parser.add_argument("output", type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument("--flow", action="append", default=[], metavar="FLOW",
                        help="generic, xilinx-ise, xilinx-vivado, libero or lattice-ecp5; may be "
                             "repeated (default: all)")
    parser.add_argument("--part", metavar="PART", help="only projects for this part, as in XC7A35T")
    parser.add_argument("--preset", default="capsule", metavar="PRESET",
                        help="capsule or paper (default: capsule)")
    parser.add_argument("--size", metavar="WxH", help="pixels of the sensor, as in 352x288")
    parser.add_argument("--beams", type=int, metavar="K", help="beams of the mesh")
    parser.add_argument("--lanes", type=int, metavar="P", help="lines compared at a time")
    parser.add_argument("--calibration", type=Path, metavar="FILE",
                        help="also write the registers and tables of this calibration.json")


def main(arguments):
    """Write the folder; gives the exit status."""
    require("export", "`cyclope export`")
    from rich.console import Console
    from rich.progress import Progress

    from calibration.file import load
    from model.errors import UserError
    from scripts.results.outputs import check_folder, new_folder
    from scripts.rtl.blocks import present
    from scripts.rtl.export import export
    from scripts.rtl.flows.make import choose

    size = None
    if arguments.size is not None:
        found = re.fullmatch(r"(\d+)x(\d+)", arguments.size)
        if not found:
            raise UserError(f"--size must be two numbers like 352x288, not {arguments.size!r}.")
        size = int(found[1]), int(found[2])
    config = choose(arguments.preset, size, arguments.beams, arguments.lanes)
    settings = load(arguments.calibration).settings if arguments.calibration else None
    check_folder(arguments.output)
    progress = Progress(console=Console(stderr=True), transient=True)
    with new_folder(arguments.output) as folder, progress:
        task = progress.add_task("Export", total=len(present()))
        blocks, left_out = export(
            folder, config, arguments.flow, arguments.part,
            lambda block: progress.advance(task), settings)
    twins = sum(block.twin is not None for block in blocks)
    for sentence in left_out:
        print(f"Left out: {sentence}.")
    held = f"{len(blocks)} blocks and {twins} VHDL twins are" if blocks else "The flows are"
    print(f"{held} in {arguments.output}; its README.md says what is what.")
    return 0
