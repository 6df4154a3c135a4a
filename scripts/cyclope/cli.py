"""The command ``cyclope``.

What the person at the terminal did wrong is said in one sentence on the error output, with exit
status 2 and no traceback.
"""

import argparse
import importlib
import os
import signal
import sys

from model.errors import UserError

__all__ = ["main"]

#: Sub-commands: module with ``add_arguments(parser)`` and ``main(arguments)``, and what it does.
COMMANDS = {
    "simulate": ("scripts.cyclope.simulate", "write a capture folder of a simulated rig"),
    "calibrate": ("scripts.cyclope.calibrate", "learn a rig from its capture folder"),
    "run": ("scripts.cyclope.run", "measure frames: 3-D points, pictures and a summary"),
    "emulate": ("scripts.cyclope.emulate", "put the simulated instrument behind a pseudo-terminal"),
    "load": ("scripts.cyclope.load", "load a calibration into the chip, start and stop it"),
    "receive": ("scripts.cyclope.receive", "receive from the chip: points, textures, a recording"),
    "status": ("scripts.cyclope.status", "what the chip is and does, all its counters"),
}


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        raise UserError(f"{message}; see `{self.prog} --help`.")


def _parser(wanted):
    """The parser; only the module of the wanted sub-command is imported."""
    parser = _Parser(
        prog="cyclope", description="3-D imaging by a mesh of laser dots: from frames to points.",
        epilog="First `cyclope calibrate CAPTURE -o calibration.json`, then `cyclope run`. "
               "`cyclope COMMAND --help` tells more.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module, purpose) in COMMANDS.items():
        command = commands.add_parser(name, help=purpose)
        if name == wanted:
            importlib.import_module(module).add_arguments(command)
    return parser


def _terminate(number, _):
    sys.exit(128 + number)


def main(argv=None):
    """Run ``cyclope``; gives the exit status.

    Parameters
    ----------
    argv : list of :class:`str` or None
        Arguments; those of the process if None.
    """
    argv = sys.argv[1:] if argv is None else [str(word) for word in argv]
    wanted = next((word for word in argv if not word.startswith("-")), None)
    try:
        arguments = _parser(wanted).parse_args(argv)
        previous = signal.signal(signal.SIGTERM, _terminate)
        try:
            return importlib.import_module(COMMANDS[arguments.command][0]).main(arguments) or 0
        finally:
            signal.signal(signal.SIGTERM, previous)
    except UserError as error:
        message = str(error)
    except KeyboardInterrupt:
        print("cyclope: interrupted, nothing was written.", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        message = f"{place}{error.strerror or error}."
    print(f"cyclope: {message}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
