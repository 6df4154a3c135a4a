"""``cyclope receive``: from the serial line, or a recording of it, to points and images."""

import signal
import time
from contextlib import contextmanager, suppress
from pathlib import Path

from hdl.protocol import Mode
from model.errors import UserError
from scripts.cyclope.program import pasteable
from scripts.cyclope.recording import is_recording
from scripts.host.port import VanishedError, add_port_arguments, open_port

__all__ = ["add_arguments", "main"]

def add_arguments(parser):
    """Declare what ``cyclope receive`` takes."""
    parser.description = (
        "Receive from the chip, or replay a recording. OUT gets link.raw, the recording itself, "
        "points.csv and frames.csv (a row per frame), all of which grow as octets come, and "
        "texture/NNNN.png each time the whole texture has been refreshed; at the end also "
        "points.ply and the last state in texture.png. Images that were taken with the laser on "
        "go to pattern/NNNN.png and pattern.png. Ctrl-C ends it, as does the device when it is "
        "unplugged. Whatever else ends it, link.raw is there, and can be replayed.")
    parser.epilog = (
        "NNNN and the column `frame` are the chip's frame numbers. Points of a frame whose check "
        "failed have the status `unverified` and no coordinates; of two points of one beam the one "
        "that fits its line less well is a `duplicate`. A point that contradicts its neighbours in "
        "the mesh, and the last depth of its beam, is `doubtful`; it keeps its coordinates. "
        "A frame that was under way when the port "
        "was opened is left out. The exit status is 3 if all of it is there, but not to be used, "
        "and the report then says why: no frame, no light, no valid tables, a laser guard that has "
        "tripped, no frame whose check is right, no point, a rig that has moved since it was "
        "calibrated, or fewer images than wanted. It is 130 if the replay of a recording was "
        "interrupted.")
    parser.add_argument("source", metavar="PORT|FILE",
                        help="serial device, such as /dev/ttyUSB0, or a recording (link.raw)")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument("--calibration", type=Path, metavar="FILE",
                        help="calibration.json that the chip was loaded with")
    parser.add_argument("--frames", type=int, metavar="N", help="end after so many pattern frames")
    parser.add_argument("--images", type=int, metavar="N",
                        help="end after so many complete images, with or without the laser")
    parser.add_argument("--single", action="store_true",
                        help="have the chip take one pair of frames, and end when it came")
    parser.add_argument("--seconds", type=float, metavar="S",
                        help="end after so long; in a recording, by the chip's clock")
    parser.add_argument("--ply", choices=("all", "last", "each"), default="all",
                        help="points.ply: all frames (default), or the last one that has points; "
                             "each: points/NNNN.ply in its place, one file a frame")
    parser.add_argument("--pcd", action="store_true", help="the same as PCD too, for PCL")
    parser.add_argument("--no-doubtful", dest="doubtful", action="store_false",
                        help="leave doubtful points out of these files")
    add_port_arguments(parser)


class _Over(Exception):  # noqa: N818
    """All that is to be received has come."""


def _open(arguments, take):
    """The recording, or the owner of the port, which gives ``take`` what comes."""
    if is_recording(arguments.source):
        from scripts.host.replay import Replay
        if arguments.single:
            raise UserError(f"--single is for a chip, and {arguments.source} is a recording.")
        return Replay(Path(arguments.source))
    from scripts.host.owner import PortOwner
    return PortOwner(
        lambda: open_port(arguments.source, arguments.baud, arguments.rtscts), take)


@contextmanager
def _stoppable():
    """A list that gets a signal's number when this is to end; a second one interrupts."""
    stopped = []

    def stop(number, _):
        if stopped:
            raise KeyboardInterrupt
        stopped.append(number)

    previous = {number: signal.signal(number, stop)
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
                if signal.getsignal(number) != signal.SIG_IGN}
    try:
        yield stopped
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _from_port(owner, end, single):
    """Ask the chip what it is, and receive from it."""
    from scripts.host.chip import RefusedError
    from scripts.host.commands import NoReplyError
    with suppress(NoReplyError, RefusedError):
        owner.commands(tries=2).identify()
    if single:
        owner.commands().write("mode", Mode.SINGLE, "the command to take a single pair")
    asked = False
    while True:
        owner.read()
        if end.status_wanted and not asked:
            asked = True
            with suppress(NoReplyError, RefusedError):
                owner.commands().status()


def _receive(source, end, take, single):
    """Until there is a reason to end."""
    try:
        if source.live:
            _from_port(source, end, single)
        else:
            while (octets := source.read()) is not None:
                take(octets)
    except VanishedError as error:
        end.why = str(error).rstrip(".")
    except _Over:
        pass


def _show_on(console, line, source, reception):
    """What shows the live line, not too often."""
    from rich.live import Live
    live, shown = Live(console=console, transient=True, auto_refresh=False), 0.0

    def show():
        nonlocal shown
        now = time.monotonic()
        if console.is_terminal and now - shown > 0.2:
            shown = now
            done = None if source.live or not source.size else source.done / source.size
            live.update(line.text(reception.decoder, reception.recorder, done), refresh=True)

    return live, show


def main(arguments):
    """Receive with parsed arguments; gives the exit status."""
    for name in ("frames", "images", "seconds"):
        value = getattr(arguments, name)
        if value is not None and not value > 0:
            raise UserError(f"--{name} must be more than 0, not {value}.")
    from scripts.results.outputs import check_folder
    check_folder(arguments.output)
    calibration = None
    if arguments.calibration is not None:
        from calibration import file
        calibration = file.load(arguments.calibration)
    from rich.console import Console

    from scripts.cyclope.ending import Ending
    from scripts.cyclope.live_line import LiveLine
    from scripts.host.reception import Reception
    with _open(arguments, lambda octets: take(octets)) as source, _stoppable() as stopped:
        reception = Reception(arguments.output, calibration, source.live, which=arguments.ply,
                              pcd=arguments.pcd, doubtful=arguments.doubtful)
        end = Ending(arguments, source, reception)
        live, show = _show_on(Console(stderr=True), LiveLine(arguments.source), source, reception)

        def take(octets):
            if octets and reception.take(octets, end.by_packet) or end.by_time(octets):
                raise _Over
            show()
            if stopped:
                end.why = "interrupted"
                raise _Over

        try:
            with live:
                _receive(source, end, take, arguments.single)
            if not reception.decoder.packets:
                raise end.nothing()
            reception.finish()
        except BaseException as error:
            if kept := reception.abandon(arguments.calibration):
                error.add_note(kept)
            raise
    faulty = _report(arguments, reception, end.why)
    return 130 if end.why == "interrupted" and not source.live else 3 if faulty else 0


def _report(arguments, reception, why):
    """Print what came, what was lost, and why it is not to be used, if so; whether it is so."""
    from scripts.host.verdict import find_losses, find_unusable, summarise
    if why:
        print(f"{why}.")
    print(summarise(reception.recorder))
    unusable = find_unusable(reception.recorder, arguments.images)
    for sentence in [*find_losses(reception.decoder, reception.recorder), *unusable]:
        print(pasteable(f"! {sentence}"))
    if unusable:
        print("The result is not to be used.")
    return bool(unusable)
