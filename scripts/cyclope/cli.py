"""The command ``cyclope``.

Whatever goes wrong is one sentence on the error output and an exit status, never a traceback.
"""

import argparse
import difflib
import importlib
import os
import signal
import sys
from contextlib import contextmanager

from model.errors import UserError
from scripts.cyclope.program import pasteable, program

__all__ = ["COMMANDS", "guarded", "main"]

#: Sub-commands, each a module beside this one with ``add_arguments(parser)`` and
#: ``main(arguments)``, and what it does.
COMMANDS = {
    "simulate": "write a capture folder of a simulated rig",
    "calibrate": "learn a rig from its capture folder",
    "run": "measure frames: 3-D points, pictures and a summary",
    "measure": "lengths on the surface, and the size of a polyp",
    "surface": "the measured surfaces of a recording as PLY, GLB or PCD",
    "report": "a recording as one HTML file, with pictures and measurements",
    "spots": "find the spots of any images, without a calibration",
    "emulate": "put the simulated instrument behind a pseudo-terminal",
    "load": "load a calibration into the chip, start and stop it",
    "receive": "receive from the chip: points, textures, a recording",
    "view": "the measured surface in a browser, live or from a recording",
    "status": "what the chip is and does, all its counters",
    "export": "write the design for other tools: Verilog, VHDL, vendor projects",
}
_SHELLS = ("bash", "zsh", "tcsh")
_EPILOG = """\
first steps:
  {cyclope} calibrate CAPTURE -o calibration.json
  {cyclope} run CAPTURE --calibration calibration.json -o OUT
  {cyclope} COMMAND --help

exit status:
  0    done
  2    bad input or usage: one sentence says what is wrong and what to do
  3    it ran, but the result is not to be used: the report says why
  130  interrupted (Ctrl-C, SIGTERM): the message says what was kept
  1    a fault of the program, or the reader of its output went away

completion of commands, options and file names, for this shell:
  eval "$({cyclope} --print-completion bash)"
"""


class _Parser(argparse.ArgumentParser):
    """A parser that refuses in one sentence, and unknown options by name before all else."""

    def parse_known_args(self, args=None, namespace=None):
        self._refuse_unknown(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def _refuse_unknown(self, words):
        known = self._option_string_actions
        see = f"see `{self.prog} --help`."
        if self._subparsers and any(word in COMMANDS for word in words):
            see = f"options of a command come after its name, {see}"
        for word in words:
            if word == "--" or self._subparsers and not word.startswith("-"):
                return
            option = word.partition("=")[0]
            if not word.startswith("-") or word == "-" or " " in word or _is_number(word) or (
                    option in known or word[:2] in known and not word.startswith("--")) or any(
                    name.startswith(option) for name in known if option.startswith("--")):
                continue
            close = difflib.get_close_matches(option, known, 1)
            raise UserError(f"{option} is no option of `{self.prog}`" + (
                f"; did you mean {close[0]}?" if close else f"; {see}"))

    def error(self, message):
        raise UserError(f"{message}; see `{self.prog} --help`.")


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        from importlib.metadata import version
        print(f"cyclope {version('cyclope')}")
        parser.exit()


class _Completion(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        import shtab
        print(shtab.complete(_parser(COMMANDS), values))
        parser.exit()


def _module(name):
    return importlib.import_module(f"{__package__}.{name}")


def _complete_files(parser):
    """Let the shell complete the paths among the arguments."""
    import shtab
    for action in parser._actions:
        if getattr(action.type, "__name__", "") == "Path" or action.dest in ("port", "source"):
            action.complete = shtab.FILE


def _parser(wanted):
    """The parser; only the modules of the ``wanted`` sub-commands are imported."""
    parser = _Parser(
        prog="cyclope", description="3-D imaging by a mesh of laser dots: from frames to points.",
        epilog=_EPILOG.format(cyclope=program()),
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    parser.add_argument("--print-completion", action=_Completion, choices=_SHELLS, metavar="SHELL",
                        help=f"print what completes this command in {', '.join(_SHELLS)}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose)
        if name in wanted:
            _module(name).add_arguments(command)
            if len(wanted) > 1:
                _complete_files(command)
    return parser


def _printable(text):
    """``text`` on one line, whatever the names of files in it hold."""
    return "".join(character if character.isprintable() else
                   character.encode("unicode_escape").decode() for character in text)


def _interrupt(number, _):
    raise KeyboardInterrupt(signal.Signals(number).name)


@contextmanager
def _interrupted_by_signals():
    """SIGTERM and a closed terminal end this as Ctrl-C does."""
    previous = {number: signal.signal(number, _interrupt)
                for number in (signal.SIGTERM, signal.SIGHUP)
                if signal.getsignal(number) == signal.SIG_DFL}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def guarded(action):
    """Run ``action`` and give its exit status; whatever goes wrong becomes one sentence.

    What an exception was given by ``add_note``, for instance what became of the results, follows
    the sentence. ``CYCLOPE_TRACEBACK=1`` lets faults of the program through.

    Parameters
    ----------
    action : callable
        Gives an exit status, or None for 0.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a locale may lack letters of names
            stream.reconfigure(errors="backslashreplace")
    try:
        with _interrupted_by_signals():
            try:
                status = action() or 0
            except SystemExit as left:  # --help
                status = left.code or 0
            if sys.stdout:
                sys.stdout.flush()
            return status
    except UserError as error:
        status, message, notes = 2, str(error), error
    except KeyboardInterrupt as error:
        status, message, notes = 130, "interrupted.", error
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        status, message, notes = 2, f"{place}{error.strerror or error}.", error
    except MemoryError as error:
        status, message, notes = 2, "there is not enough memory for this.", error
    except Exception as error:
        if os.environ.get("CYCLOPE_TRACEBACK") == "1":
            raise
        status, notes = 1, error
        message = (f"a fault of the program ({type(error).__name__}: {str(error)[:300]}); "
                   "CYCLOPE_TRACEBACK=1 in the environment shows where: please report it.")
    words = [message, *getattr(notes, "__notes__", ())]
    print(f"cyclope: {_printable(pasteable(' '.join(words)))}", file=sys.stderr)
    return status


def _run(argv):
    if not argv:
        _parser(()).print_help()
        return 0
    name = next((word for word in argv if not word.startswith("-")), None)
    if not argv[0].startswith("-") and name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, 1)
        raise UserError(f"{name!r} is no command of `cyclope`" + (
            f"; did you mean `cyclope {close[0]}`?" if close else
            f"; there are {', '.join(COMMANDS)}."))
    arguments = _parser((name,)).parse_args(argv)
    return _module(arguments.command).main(arguments)


def main(argv=None):
    """Run ``cyclope``; gives the exit status.

    Parameters
    ----------
    argv : list of :class:`str` or None
        Arguments; those of the process if None.
    """
    words = sys.argv[1:] if argv is None else [str(word) for word in argv]
    return guarded(lambda: _run(words))


if __name__ == "__main__":
    sys.exit(main())
