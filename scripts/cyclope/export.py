"""``cyclope export``: the design for other tools."""

from pathlib import Path

from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope export`` takes."""
    parser.description = (
        "Write every block and the whole design for other tools: Verilog, VHDL twins, contents of "
        "memories, tables of ports, and projects for ISE, Vivado and Libero. OUT/README.md says "
        "what is what.")
    parser.add_argument("output", type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument("--calibration", type=Path, metavar="FILE",
                        help="also write the registers and tables of this calibration.json")


def main(arguments):
    """Write the folder; gives the exit status."""
    require("export", "`cyclope export`")
    from rich.console import Console
    from rich.progress import Progress

    from calibration.file import load
    from scripts.results.outputs import new_folder
    from scripts.rtl.blocks import present
    from scripts.rtl.export import export

    settings = load(arguments.calibration).settings if arguments.calibration else None
    progress = Progress(console=Console(stderr=True), transient=True)
    with new_folder(arguments.output) as folder, progress:
        task = progress.add_task("Export", total=len(present()))
        blocks = export(folder, lambda block: progress.advance(task), settings)
    twins = sum(block.twin is not None for block in blocks)
    print(f"{len(blocks)} blocks, {twins} VHDL twins and the vendor projects are in "
          f"{arguments.output}; its README.md describes the files.")
    return 0
