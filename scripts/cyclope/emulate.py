"""``cyclope emulate``: the whole instrument, its RTL included, behind a pseudo-terminal."""

import argparse
from pathlib import Path

from model.bayer import BAYER
from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope emulate`` takes."""
    parser.description = (
        "Put the Verilated instrument behind a pseudo-terminal, with a model of the imager that\n"
        "looks at scenes through a simulated rig: what `cyclope load` and `cyclope receive` open\n"
        "like a serial device. TRUTH gets the truth of each lit frame as it is shown; Ctrl-C\n"
        "or SIGTERM ends it.")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    from scripts.cyclope.simulate import KINDS, RIGS
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"one of {', '.join(KINDS)}")
    parser.add_argument("output", type=Path, metavar="TRUTH",
                        help="truth.csv to create; it must not be there yet")
    parser.add_argument("--rig", choices=RIGS, default="endoscope", help="default: endoscope")
    parser.add_argument("--bayer", choices=BAYER,
                        help="pattern of the sensor's colour filters; default: none")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything random")
    parser.add_argument("--scenes", type=int, default=12, metavar="N",
                        help="scenes, shown in turn, one for each pair; default: 12")
    from hdl.config import Config
    parser.add_argument("--baud", type=int, default=Config.baud, metavar="N",
                        help=f"of the chip's serial line; default: {Config.baud}, which drops "
                             "points of the rig dense: it needs 1000000")


def main(arguments):
    """Emulate with parsed arguments; gives the exit status."""
    if arguments.seed < 0:
        raise UserError(f"--seed must be 0 or more, not {arguments.seed}.")
    if not 1 <= arguments.scenes <= 1000:
        raise UserError(f"--scenes must be 1 to 1000, not {arguments.scenes}.")
    from hdl.config import Config
    try:
        Config(baud=arguments.baud)
    except ValueError as error:
        raise UserError(f"--{error}.") from error
    if arguments.output.exists():
        raise UserError(f"{arguments.output} is there already: name another file, or delete it.")
    require("rtl", "`cyclope emulate`")
    from model.optics.capture import truth_header
    from model.optics.conditions import conditions_of
    from model.optics.rigs import RIGS
    from scripts.results.row_file import RowFile
    from scripts.simulation.emulator import Emulator
    from scripts.simulation.terminal import Terminal

    truth = RowFile(arguments.output, truth_header(conditions_of(arguments.kind)) + "\n")

    def record(rows):
        truth.append("".join(f"{row}\n" for row in rows))
        truth.flush()

    try:
        print(f"Preparing {arguments.scenes} scenes and the RTL, which takes a minute or two "
              "the first time.", flush=True)
        rig = RIGS[arguments.rig].with_filters(arguments.bayer)
        emulator = Emulator(arguments.kind, rig, arguments.seed,
                            arguments.scenes, arguments.baud, record=record, keep=False)
        terminal = Terminal(emulator)
    except BaseException:
        truth.close()
        truth.path.unlink(missing_ok=True)
        raise
    print(f"The instrument listens at {terminal.path}; Ctrl-C ends it.", flush=True)
    try:
        terminal.serve()
    except KeyboardInterrupt:
        pass
    finally:
        terminal.close()
        truth.close()
    print(f"{emulator.count} frames were shown; the truth of the lit ones is in "
          f"{arguments.output}")
    return 0
