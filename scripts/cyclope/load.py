"""``cyclope load``: the calibration into the chip, and how it is to run."""

import shlex
from pathlib import Path

from hdl.protocol import Mode
from model.errors import UserError
from scripts.cyclope.program import pasteable
from scripts.host.chip import check_value
from scripts.host.load_plan import MODES, LoadPlan
from scripts.host.loading import registers_of
from scripts.host.owner import PortOwner
from scripts.host.port import add_port_arguments, open_port
from scripts.host.status import find_faults, laser

__all__ = ["add_arguments", "main"]

#: What :data:`scripts.host.load_plan.MODES` mean.
_MODES = {"start": "run: pattern, texture, pattern, ...",
          "stop": "stop, the laser is off",
          "single": "one pair of pattern and texture, then stop; `cyclope receive PORT --single` "
                    "takes a pair and receives it",
          "pattern-only": "run, pattern frames only",
          "pattern-images": "run, pattern frames only, and send them as images, without points: "
                            "for a calibration"}
_TIMES = {"period_us": "from pattern to pattern", "pattern_us": "exposure of the pattern",
          "texture_us": "exposure of the texture", "pattern_reset_us": "reset before the pattern",
          "texture_reset_us": "reset before the texture"}


def add_arguments(parser):
    """Declare what ``cyclope load`` takes."""
    parser.description = (
        "Load the tables and registers of a calibration into the chip, read them back, have the "
        "chip check them, and set how it runs. Without a calibration only the rest is done.")
    parser.epilog = (
        "Without one of the modes the chip stays in the one it was in. Registers take effect "
        "together, at the start of a pattern frame. Times that trip the laser guard are refused. "
        "The exit status is 3 if all was done, but the chip runs without light, without a sensor "
        "or with a laser guard that has tripped.")
    parser.add_argument("port", metavar="PORT", help="serial device, such as /dev/ttyUSB0")
    parser.add_argument("calibration", nargs="?", type=Path, metavar="FILE",
                        help="calibration.json from `cyclope calibrate`")
    modes = parser.add_mutually_exclusive_group()
    for name, words in _MODES.items():
        modes.add_argument(f"--{name}", dest="mode", action="store_const", const=name, help=words)
    for name, words in _TIMES.items():
        parser.add_argument("--" + name.replace("_", "-"), type=int, metavar="US",
                            help=f"{words}, microseconds")
    parser.add_argument("--register", action="append", default=[], metavar="NAME=VALUE",
                        help="write any register; `cyclope status PORT --registers` lists them")
    parser.add_argument("--capture-ms", type=int, metavar="MS",
                        help="calibration capture: allow the laser without valid tables, for so "
                             "many milliseconds; 0 ends it")
    parser.add_argument("--clear", action="store_true",
                        help="clear the causes that the laser guard holds")
    add_port_arguments(parser)


def _chosen(arguments):
    """Registers of the command line, checked."""
    chosen = {name: getattr(arguments, name) for name in _TIMES
              if getattr(arguments, name) is not None}
    for words in arguments.register:
        name, equals, value = words.partition("=")
        try:
            if not equals:
                raise ValueError
            chosen[name] = int(value, 0)
        except ValueError:
            raise UserError("--register takes NAME=VALUE with a whole number, not "
                            f"{words[:40]!r}.") from None
    for name, value in chosen.items():
        check_value(name, value)
    if "mode" in chosen or "pattern_as_texture" in chosen:
        raise UserError(f"Choose the mode by one of --{', --'.join(_MODES)}.")
    if "divisor" in chosen:
        raise UserError(
            "divisor is the speed of this very line, which this program does not change.")
    if arguments.capture_ms is not None and not 0 <= arguments.capture_ms <= 0xFFFF:
        raise UserError(f"--capture-ms must be 0 to 65535, not {arguments.capture_ms}.")
    return chosen


def _again(arguments):
    """The command line, for the shell."""
    words = ["load", arguments.port, *([] if arguments.calibration is None
                                       else [arguments.calibration])]
    words += [f"--{arguments.mode or 'start'}"]
    for name in _TIMES:
        if getattr(arguments, name) is not None:
            words += ["--" + name.replace("_", "-"), getattr(arguments, name)]
    for register in arguments.register:
        words += ["--register", register]
    if arguments.capture_ms is not None:
        words += ["--capture-ms", arguments.capture_ms]
    return "cyclope " + shlex.join(map(str, words)) + " --clear" * arguments.clear


def _bar():
    """A progress bar, where there is a terminal for it."""
    from rich import progress
    from rich.console import Console
    console = Console(stderr=True)
    return progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.MofNCompleteColumn(), progress.TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal)


def main(arguments):
    """Load with parsed arguments; gives the exit status."""
    chosen = _chosen(arguments)
    mode, pattern_as_texture = MODES.get(arguments.mode, (None, None))
    calibration = None
    if arguments.calibration is not None:
        pattern_as_texture = pattern_as_texture or 0
        from calibration import file
        calibration = file.load(arguments.calibration)
        chosen = {**registers_of(calibration), **chosen}
    plan = LoadPlan(calibration, chosen, mode, pattern_as_texture, arguments.clear,
                    arguments.capture_ms)
    with PortOwner(lambda: open_port(arguments.port, arguments.baud, arguments.rtscts)) as owner:
        commands = owner.commands()
        try:
            for warning in plan.check(commands):
                print(f"! {warning}")
            with _bar() as bar:
                task = bar.add_task("loading and reading back", total=None,
                                    visible=calibration is not None)
                plan.carry_out(commands, lambda done, total: bar.update(
                    task, completed=done, total=total))
            status = plan.settle(commands)
            as_images = commands.read("pattern_as_texture")
        except (UserError, KeyboardInterrupt) as error:
            if plan.began or isinstance(error, KeyboardInterrupt):
                error.add_note(plan.describe(owner, _again(arguments)))
            raise
    return _report(plan, status, as_images)


def _report(plan, status, as_images):
    """Print what was done; gives the exit status."""
    state = status["state"]
    if plan.calibration is not None:
        words = plan.calibration.settings.tables()
        print(f"loaded and read back: {len(words)} tables, {sum(map(len, words.values()))} words, "
              f"{len(plan.chosen)} registers")
    elif plan.chosen:
        print("written and read back: " + ", ".join(
            f"{name} = {value}" for name, value in plan.chosen.items()))
    tables = ("loaded, they are taken at the next frame's start" if state.committing
              else "valid" if state.tables_valid else "none that are valid")
    print(f"tables: {tables}")
    print(f"laser: {laser(status)}")
    print(pasteable(f"mode: {_mode(state)}") + (
        ", as images" if as_images and state.mode == Mode.PATTERN else ""))
    if plan.mode == Mode.SINGLE:
        print(pasteable("! the pair is sent while this command has the port: `cyclope receive PORT "
                        "--single` takes another one and receives it."))
    faults = find_faults(status)
    if plan.mode == Mode.SINGLE and not (state.tables_valid or state.capture):
        faults.append("the pair is dark: there are no valid tables.")
    if plan.mode not in (None, Mode.SINGLE, state.mode):
        faults.insert(0, "the chip is not in the mode that it was told to take.")
    for fault in faults:
        print(pasteable(f"! {fault}"))
    return 3 if faults else 0


def _mode(state):
    words = {Mode.STOP: "stopped; `cyclope load PORT --start` starts it",
             Mode.CONTINUOUS: "continuous", Mode.SINGLE: "single pair",
             Mode.PATTERN: "pattern only"}[state.mode]
    return words + (", but the sensor is silent" if state.silent else "")
