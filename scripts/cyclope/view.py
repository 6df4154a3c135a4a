"""``cyclope view``: the scene in a browser, live or from a recording, with ruler and polyp tool."""

import asyncio
import contextlib
import os
import signal
import sys
import time
from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require
from scripts.cyclope.recording import is_recording
from scripts.host.port import add_port_arguments, open_port

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope view`` takes."""
    parser.description = (
        "Show the measured surface in a browser: textured, to be turned, frozen, stepped and "
        "measured. From a port it is recorded while it is shown, as `cyclope receive` does; a "
        "recording is shown with a time bar; --simulate needs no hardware. The page is served by "
        "this program, to this machine only, and asks nothing of any other. Not a medical device.")
    parser.add_argument("source", nargs="?", metavar="PORT|RECORDING",
                        help="serial device, such as /dev/ttyUSB0, or a recording (link.raw)")
    parser.add_argument("--simulate", metavar="KIND",
                        help="show a simulated rig: plane, tilted, polyp (it moves), tube, mixed, "
                             "tissue")
    parser.add_argument("--rig", default="endoscope", help="of --simulate; default: endoscope")
    parser.add_argument("--engine", choices=("model", "rtl"), default="model",
                        help="of --simulate: the golden models at video rate (default), or the "
                             "Verilated RTL as fast as it goes")
    parser.add_argument("--calibration", type=Path, metavar="FILE",
                        help="calibration.json that the chip was, or is to be, loaded with")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT",
                        help="folder to record into (default: a new one, named after the time)")
    parser.add_argument("--start", action="store_true",
                        help="load the calibration into the chip, and start it")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS",
                        help="address to serve at (default 127.0.0.1, this machine only); others "
                             "get a token, part of the page's address, that a browser needs")
    parser.add_argument("--port", dest="page_port", type=int, default=0, metavar="N",
                        help="port of the page (default: a free one)")
    parser.add_argument("--no-browser", dest="browser", action="store_false",
                        help="print the page's address, and open no browser")
    add_port_arguments(parser)


def _check(arguments):
    """Refuse what does not go together."""
    if (arguments.source is None) == (arguments.simulate is None):
        raise UserError("Name a port or a recording, or --simulate KIND; see `cyclope view "
                        "--help`.")
    if arguments.simulate is None and arguments.calibration is None:
        raise UserError("The surface needs the calibration that the chip was loaded with: add "
                        "--calibration calibration.json.")
    if not 0 <= arguments.page_port <= 65535:
        raise UserError(f"--port must be 0 to 65535, not {arguments.page_port}.")


def _folder(arguments):
    from scripts.results.outputs import check_folder
    folder = arguments.output or Path(time.strftime("cyclope-%Y%m%d-%H%M%S"))
    check_folder(folder)
    return folder


@contextlib.contextmanager
def _live(opened, calibration, folder, name, calibration_path=None):
    """A live session; what was recorded is completed at the end."""
    from scripts.host.history import History
    from scripts.host.live_chip import LiveChip
    from scripts.host.reception import Reception
    from scripts.view.session import LiveSession

    reception = Reception(folder, calibration)
    try:
        history = History(calibration, reception.folder, forgets=True)
        owner = LiveChip(opened, reception, history, calibration, lambda: session.changed())
        session = LiveSession(owner, history, reception.folder, name)
        with session:
            yield session
        reception.finish()
    except BaseException as error:
        if kept := reception.abandon(calibration_path):
            error.add_note(kept)
        raise
    from scripts.host.verdict import summarise
    print(f"{summarise(reception.recorder)}")


@contextlib.contextmanager
def _simulated(arguments, folder):
    """A session of the model of the instrument behind a pseudo-terminal."""
    require("rtl" if arguments.engine == "rtl" else "calibration", "`cyclope view --simulate`")
    from model.optics.rigs import RIGS
    from model.optics.scenes import KINDS
    from scripts.simulation.live_rig import calibrated, open_live

    if arguments.rig not in RIGS:
        raise UserError(f"There is no rig '{arguments.rig}'; there are {', '.join(RIGS)}.")
    if arguments.simulate not in KINDS:
        raise UserError(f"There is no scene of the kind '{arguments.simulate}'; choose one of "
                        f"{', '.join(KINDS)}.")
    rig = RIGS[arguments.rig]
    if arguments.calibration is None:
        rig = rig.with_filters("RGGB")
        print(f"Calibrating the simulated rig '{rig.name}', which takes some seconds the first "
              "time.", flush=True)
        calibration = calibrated(rig)
    else:
        from calibration import file
        calibration = file.load(arguments.calibration)
        rig = rig.with_filters(calibration.bayer)
    print("Preparing the scenes." if arguments.engine == "model" else
          "Preparing the scenes and the RTL, which takes a minute or two the first time.",
          flush=True)
    with open_live(arguments.simulate, rig, engine=arguments.engine) as terminal, _live(
            lambda: open_port(terminal.path), calibration, folder,
            f"simulated {arguments.simulate}, rig {rig.name}") as session:
        yield session


@contextlib.contextmanager
def _session(arguments):
    from calibration import file
    if arguments.simulate is not None:
        with _simulated(arguments, _folder(arguments)) as session:
            yield session
        return
    recording = is_recording(arguments.source)
    if recording and (arguments.start or arguments.output):
        raise UserError(f"{arguments.source} is a recording: --start and -o are for a port.")
    folder = None if recording else _folder(arguments)
    calibration = file.load(arguments.calibration)
    if recording:
        from scripts.view.session import ReplaySession
        with ReplaySession(Path(arguments.source), calibration) as session:
            session.wait()
            yield session
        return

    def opened():
        return ports.pop() if ports else open_port(*how)

    how = arguments.source, arguments.baud, arguments.rtscts
    # A port that is not there is refused before anything is written.
    with open_port(*how) as port:
        ports = [port]
        with _live(opened, calibration, folder, arguments.source,
                   arguments.calibration) as session:
            yield session


def _has_screen():
    """Whether a browser has a window; otherwise one in this terminal might start."""
    return sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextlib.contextmanager
def _stopped():
    """An event that Ctrl-C, SIGTERM and SIGHUP set; a second one interrupts."""
    event, loop = asyncio.Event(), asyncio.get_running_loop()

    def stop(number, _):
        if event.is_set():
            raise KeyboardInterrupt
        loop.call_soon_threadsafe(event.set)

    previous = {number: signal.signal(number, stop)
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
                if signal.getsignal(number) != signal.SIG_IGN or number == signal.SIGINT}
    try:
        yield event
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


async def _serve(session, arguments):
    """Until it is interrupted; what was recorded is completed then."""
    from scripts.view.server import PageServer
    with _stopped() as stopped:
        async with PageServer(session, arguments.host, arguments.page_port) as server:
            print(f"The page is at {server.address}; Ctrl-C ends it.", flush=True)
            if arguments.browser and _has_screen():
                import webbrowser
                await asyncio.to_thread(webbrowser.open, server.address)
            if session.owner is not None and (
                    arguments.start or arguments.simulate is not None):
                try:
                    print(await asyncio.wrap_future(session.owner.do("load")), flush=True)
                except UserError as error:
                    print(f"! {error}", file=sys.stderr, flush=True)
            await stopped.wait()


def main(arguments):
    """View with parsed arguments; gives the exit status."""
    require("view", "`cyclope view`")
    _check(arguments)
    with _session(arguments) as session:
        asyncio.run(_serve(session, arguments))
    return 0
