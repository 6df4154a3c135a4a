"""``cyclope load``: the calibration into the chip, and how it is to run."""

from pathlib import Path

from hdl.protocol import Mode
from model.errors import UserError
from scripts.host.chip import REGISTERS, Commands, check_chip
from scripts.host.loading import load, signed, stop, wait_until, write_registers
from scripts.host.port import add_port_arguments, open_port

__all__ = ["add_arguments", "main"]

#: Mode, register ``pattern_as_texture`` and meaning.
_MODES = {"start": (Mode.CONTINUOUS, 0, "run: pattern, texture, pattern, ..."),
          "stop": (Mode.STOP, 0, "stop, the laser is off"),
          "single": (Mode.SINGLE, 0, "one pair of pattern and texture, then stop"),
          "pattern-only": (Mode.PATTERN, 0, "run, pattern frames only"),
          "pattern-images": (Mode.PATTERN, 1, "run, pattern frames only, and send them as images, "
                                              "without points: for a calibration")}
_TIMES = {"period_us": "from pattern to pattern", "pattern_us": "exposure of the pattern",
          "texture_us": "exposure of the texture", "pattern_reset_us": "reset before the pattern",
          "texture_reset_us": "reset before the texture"}


def add_arguments(parser):
    """Declare what ``cyclope load`` takes."""
    parser.description = (
        "Load the tables and registers of a calibration into the chip, read them back, have the "
        "chip check them, and say how it is to run. Without a calibration only the rest is done.")
    parser.epilog = ("Without one of the modes the chip goes on as it was. Registers change "
                     "together, at the start of a pattern frame.")
    parser.add_argument("port", metavar="PORT", help="serial device, such as /dev/ttyUSB0")
    parser.add_argument("calibration", nargs="?", type=Path, metavar="FILE",
                        help="calibration.json from `cyclope calibrate`")
    modes = parser.add_mutually_exclusive_group()
    for name, (_, _, words) in _MODES.items():
        modes.add_argument(f"--{name}", dest="mode", action="store_const", const=name, help=words)
    for name, words in _TIMES.items():
        parser.add_argument("--" + name.replace("_", "-"), type=int, metavar="US",
                            help=f"{words}, microseconds")
    parser.add_argument("--register", action="append", default=[], metavar="NAME=VALUE",
                        help="write any register; `cyclope status PORT --registers` lists them")
    parser.add_argument("--capture-ms", type=int, metavar="MS",
                        help="calibration capture: allow the laser without valid tables, for so "
                             "many milliseconds; 0 ends it")
    parser.add_argument("--clear", action="store_true", help="forget the laser guard's causes")
    add_port_arguments(parser)


def _chosen(arguments):
    """Registers from the command line, checked."""
    chosen = {name: getattr(arguments, name) for name in _TIMES
              if getattr(arguments, name) is not None}
    for words in arguments.register:
        name, equals, value = words.partition("=")
        try:
            if not equals:
                raise ValueError
            chosen[name] = int(value, 0)
        except ValueError:
            raise UserError(f"--register takes NAME=VALUE with a whole number, not {words!r}."
                            ) from None
    for name, value in chosen.items():
        if name not in REGISTERS:
            raise UserError(f"There is no register {name!r}; there are: {', '.join(REGISTERS)}.")
        register = REGISTERS[name]
        half = 1 << register.bits - 1
        low, high = (-half, half - 1) if register.signed else (register.low, 2 * half - 1)
        high = high if register.high is None else register.high
        if not low <= value <= high:
            raise UserError(f"{name} must be {low} to {high}, not {value}.")
    if "mode" in chosen or "pattern_as_texture" in chosen:
        raise UserError(f"Choose the mode by one of --{', --'.join(_MODES)}.")
    if "divisor" in chosen:
        raise UserError(
            "divisor is the speed of this very line, which this program does not change.")
    if arguments.capture_ms is not None and not 0 <= arguments.capture_ms <= 0xFFFF:
        raise UserError(f"--capture-ms must be 0 to 65535, not {arguments.capture_ms}.")
    return chosen


def _bar(console):
    from rich import progress
    return progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.MofNCompleteColumn(), progress.TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal)


def main(arguments):
    """Load with parsed arguments; gives the exit status."""
    from rich.console import Console

    from scripts.host.status import laser
    chosen = _chosen(arguments)
    mode, pictures, _ = _MODES.get(arguments.mode, (None, None, None))
    calibration = None
    if arguments.calibration is not None:
        pictures = pictures or 0
        from calibration import file
        calibration = file.load(arguments.calibration)
        chosen = {**{name: signed(name, value)
                     for name, value in calibration.settings.registers().items()}, **chosen}
    with open_port(arguments.port, arguments.baud, arguments.rtscts) as port:
        commands = Commands(port)
        identity = commands.identify()
        before = commands.status()["state"]
        if calibration is not None:
            check_chip(identity, calibration)
            mode = before.mode if mode is None else mode
            with _bar(Console(stderr=True)) as progress:
                task = progress.add_task("stopping", total=None)
                stop(commands)
                progress.update(task, description="loading and reading back")
                load(commands, calibration, lambda done, total: progress.update(
                    task, completed=done, total=total))
        elif mode == Mode.STOP:
            stop(commands)
        write_registers(commands, chosen)
        if arguments.clear:
            commands.clear()
        if arguments.capture_ms is not None:
            commands.capture(arguments.capture_ms)
        if pictures is not None and commands.read("pattern_as_texture") != pictures:
            commands.write("pattern_as_texture", pictures)
        if mode is not None:
            commands.write("mode", mode)
        # A set of tables is taken at a frame's start; a chip that stands still may have none.
        status = wait_until(
            commands, lambda state: not state.committing and (
                mode in (None, Mode.SINGLE) or state.mode == mode) and (
                mode in (None, Mode.STOP) or state.armed), 3.0)
        pictures = commands.read("pattern_as_texture")
    state = status["state"]
    if calibration is not None:
        words = calibration.settings.tables()
        print(f"loaded and read back: {len(words)} tables, {sum(map(len, words.values()))} words, "
              f"{len(chosen)} registers")
    elif chosen:
        print("written and read back: " + ", ".join(
            f"{name} = {value}" for name, value in chosen.items()))
    tables = ("loaded, they are taken at the next frame's start" if state.committing
              else "valid" if state.tables_valid else "none that are valid")
    print(f"tables: {tables}")
    print(f"laser: {laser(status)}")
    print(f"mode: {_mode(state)}" + (
        ", as pictures" if pictures and state.mode == Mode.PATTERN else ""))
    return 0


def _mode(state):
    words = {Mode.STOP: "stopped; `cyclope load PORT --start` starts it",
             Mode.CONTINUOUS: "continuous", Mode.SINGLE: "single pair",
             Mode.PATTERN: "pattern only"}[state.mode]
    return words + (", but the sensor is silent" if state.silent else "")
