"""``cyclope emulate``: the whole instrument, its RTL included, behind a pseudo-terminal."""

import argparse
from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope emulate`` takes."""
    parser.description = (
        "Put the Verilated instrument behind a pseudo-terminal, with a model of the imager that "
        "looks at scenes through a simulated rig: what `cyclope load` and `cyclope receive` open "
        "like a serial device. Ctrl-C ends it, and writes the truth of what was shown.")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    from scripts.cyclope.simulate import KINDS, RIGS
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"one of {', '.join(KINDS)}")
    parser.add_argument("output", type=Path, metavar="TRUTH", help="truth.csv to write")
    parser.add_argument("--rig", choices=RIGS, default="endoscope", help="default: endoscope")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything random")
    parser.add_argument("--scenes", type=int, default=12, metavar="N",
                        help="scenes, shown in turn, one for each pair; default: 12")


def main(arguments):
    """Emulate with parsed arguments; gives the exit status."""
    if arguments.seed < 0:
        raise UserError(f"--seed must be 0 or more, not {arguments.seed}.")
    if not 1 <= arguments.scenes <= 1000:
        raise UserError(f"--scenes must be 1 to 1000, not {arguments.scenes}.")
    if arguments.output.exists():
        raise UserError(f"{arguments.output} is there already: name another file, or delete it.")
    require("rtl", "`cyclope emulate`")
    from model.optics.rigs import RIGS
    from scripts.simulation.emulator import Emulator
    from scripts.simulation.terminal import Terminal

    emulator = Emulator(arguments.kind, RIGS[arguments.rig], arguments.seed, arguments.scenes)
    terminal = Terminal(emulator)
    print(f"The instrument listens at {terminal.path}; Ctrl-C ends it.", flush=True)
    try:
        terminal.serve()
    except KeyboardInterrupt:
        pass
    finally:
        terminal.close()
    arguments.output.write_text("\n".join(emulator.truth()) + "\n")
    print(f"{len(emulator.shown)} frames were shown; their truth is in {arguments.output}")
    return 0
