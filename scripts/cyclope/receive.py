"""``cyclope receive``: from the serial line, or a recording of it, to points and pictures."""

import signal
import stat
import time
from collections import deque
from contextlib import contextmanager
from pathlib import Path

from model.errors import UserError
from scripts.host.port import VanishedError, add_port_arguments, open_port

__all__ = ["add_arguments", "main"]

#: Seconds of octets without a packet after which the line's speed must be wrong, and octets.
_GARBAGE_SECONDS, _GARBAGE_OCTETS = 3.0, 300
#: How often the chip is asked what it is, in seconds from the start.
_ASK_AT = (0.0, 1.0, 3.0)
_CHUNK = 1 << 16


def add_arguments(parser):
    """Declare what ``cyclope receive`` takes."""
    parser.description = (
        "Receive from the chip, or replay a recording: write points.csv and points.ply, frames.csv "
        "(a row per frame), texture/NNNN.png each time the whole texture has been refreshed, the "
        "last state in texture.png, and link.raw, the recording itself. Pictures that were taken "
        "with the laser on go to pattern/NNNN.png and pattern.png. Ctrl-C ends it, as does the "
        "device when it is unplugged; all is then in OUT.")
    parser.epilog = (
        "NNNN and the column `frame` are the chip's frame numbers. Points of a frame whose check "
        "failed have the status `unverified` and no place.")
    parser.add_argument("source", metavar="PORT|FILE",
                        help="serial device, such as /dev/ttyUSB0, or a recording (link.raw)")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument("--calibration", type=Path, metavar="FILE",
                        help="calibration.json that the chip was loaded with")
    parser.add_argument("--frames", type=int, metavar="N", help="end after so many pattern frames")
    parser.add_argument("--images", type=int, metavar="N",
                        help="end after so many whole pictures, with or without the laser")
    parser.add_argument("--seconds", type=float, metavar="S",
                        help="end after so long; in a recording, by the chip's clock")
    parser.add_argument("--ply", choices=("all", "last"), default="all",
                        help="points.ply: all frames (default), or the last one that has points")
    add_port_arguments(parser)


class _Recording:
    """A file, read as a port is."""

    live = False

    def __init__(self, path):
        self._file = open(path, "rb")  # noqa: SIM115

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def read(self):
        """The next octets, None at the end."""
        return self._file.read(_CHUNK) or None


class _Live:
    """The chip behind a port: it is asked what it is, and told wrong speeds."""

    live = True

    def __init__(self, port):
        self._port, self._start = port, time.monotonic()
        self._asked = 0

    def __enter__(self):
        return self

    def __exit__(self, *details):
        self._port.__exit__(*details)

    def read(self):
        return self._port.read()

    def ask(self, identified):
        """Ask the chip what it is, a few times."""
        from hdl.protocol import Command
        from scripts.host.framing import frame_packet
        if not identified and self._asked < len(_ASK_AT) and (
                time.monotonic() - self._start >= _ASK_AT[self._asked]):
            self._asked += 1
            self._port.write(frame_packet(bytes([Command.IDENTIFY, self._asked])))


def _open(arguments):
    path = Path(arguments.source)
    try:
        mode = path.stat().st_mode if "://" not in arguments.source else None
    except OSError:
        mode = None
    if mode is not None and stat.S_ISREG(mode):
        return _Recording(path)
    if mode is not None and stat.S_ISDIR(mode):
        raise UserError(f"{path} is a folder: name a serial device or a recording.")
    return _Live(open_port(arguments.source, arguments.baud, arguments.rtscts))


@contextmanager
def _stoppable():
    """A list that gets the signal's number when this is told to end."""
    stopped = []

    def stop(number, _):
        stopped.append(number)

    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _pieces(octets):
    """Cut after each zero, so that what is used ends with a packet."""
    start = 0
    while (end := octets.find(0, start)) >= 0:
        yield octets[start:end + 1]
        start = end + 1
    if start < len(octets):
        yield octets[start:]


class _Line:
    """The live line: frame rate, points, lost packets, laser."""

    def __init__(self, name):
        self.name = name
        self._samples = deque(maxlen=10)  # frames, and when they were taken
        self._changed = time.monotonic()

    def _rate(self, recorder):
        """Pattern frames a second by the chip's clock, 0 if none come any more."""
        now = time.monotonic()
        if not self._samples or recorder.frames != self._samples[-1][0]:
            self._changed = now
            if recorder.last.timestamp_us:
                self._samples.append((recorder.frames, recorder.last.timestamp_us))
        if len(self._samples) < 2 or now - self._changed > 2:
            return 0.0
        (first, begin), (last, end) = self._samples[0], self._samples[-1]
        return (last - first) * 1e6 / (end - begin) if end > begin else 0.0

    def text(self, decoder, recorder):
        """The line, as it stands."""
        from rich.text import Text

        from scripts.host.recorder import MISMATCH
        last = recorder.last
        if last is None and recorder.seen:
            return Text(f"{self.name}  " + "  ".join(
                f"{kind}: {recorder.whole[kind]} whole pictures, the next {picture.fresh:.0%}"
                for kind, picture in recorder.pictures.items() if kind in recorder.seen))
        if last is None:
            words = ("nothing but garbage" if decoder.octets and not decoder.packets else
                     "no frame yet: `cyclope load PORT --start` starts the chip" if decoder.packets
                     else "nothing arrives")
            return Text(f"{self.name}  {words}")
        ok = int((last.points["status"] == 0).sum())
        laser = "on" if last.laser else "off"
        text = Text(f"{self.name}  frame {last.index}  {self._rate(recorder):4.1f} frames/s  "
                    f"{ok:2} of {last.spots} spots ok  {recorder.whole['texture']} textures  "
                    "lost packets ")
        text.append(str(decoder.lost), style="yellow" if decoder.lost else "")
        text.append(f"  laser {laser}")
        if last.summarised and not last.tables_valid:
            text.append(", no valid tables", style="yellow")
        if last.capture:
            text.append(", calibration capture", style="yellow")
        if last.tripped:
            text.append(", tripped: see `cyclope status`", style="bold red")
        if last.verified is False:
            text.append(f"  {MISMATCH}", style="bold red")
        return text


def _receive(arguments, source, decoder, recorder, raw, stopped, show):
    """Until there is a reason to end; gives it in words."""
    from scripts.host.messages import Frame, TextureFrame
    begin, first_us, first_octet = time.monotonic(), None, None
    while not stopped:
        if source.live:
            source.ask(recorder.identity)
            now = time.monotonic()
            if arguments.seconds is not None and now - begin >= arguments.seconds:
                return f"{arguments.seconds:g} s are over"
            if decoder.octets and first_octet is None:
                first_octet = now
            if not decoder.packets and decoder.octets >= _GARBAGE_OCTETS and (
                    now - first_octet > _GARBAGE_SECONDS):
                raise UserError(f"What comes from {arguments.source} is no packet: is "
                                f"--baud {arguments.baud} right, and is this the chip's port?")
        try:
            octets = source.read()
        except VanishedError as error:
            return str(error).rstrip(".")
        if octets is None:
            return None
        for piece in _pieces(octets):
            raw.write(piece)
            for event in decoder.events(piece):
                recorder.take(event)
                if isinstance(event, (Frame, TextureFrame)) and event.timestamp_us:
                    first_us = event.timestamp_us if first_us is None else first_us
                    seconds = (event.timestamp_us - first_us) / 1e6
                    if not source.live and arguments.seconds is not None and (
                            seconds >= arguments.seconds):
                        return f"{arguments.seconds:g} s are over"
            if arguments.frames is not None and recorder.frames >= arguments.frames:
                return None
            if arguments.images is not None and (
                    sum(recorder.whole.values()) >= arguments.images):
                return None
        show()
    return "interrupted"


def main(arguments):
    """Receive with parsed arguments; gives the exit status."""
    for name in ("frames", "images", "seconds"):
        value = getattr(arguments, name)
        if value is not None and not value > 0:
            raise UserError(f"--{name} must be more than 0, not {value}.")
    from scripts.results.outputs import check_folder, new_folder
    check_folder(arguments.output)
    calibration = rebuild = None
    if arguments.calibration is not None:
        from calibration import file
        from scripts.host.rebuild import Rebuilder
        calibration = file.load(arguments.calibration)
        rebuild = Rebuilder(calibration.settings, calibration.width, calibration.height)
    from rich.console import Console
    from rich.live import Live

    from scripts.host.decoder import Decoder
    from scripts.host.recorder import Recorder
    decoder = Decoder(rebuild)
    console = Console(stderr=True)
    with _open(arguments) as source, _stoppable() as stopped, \
            new_folder(arguments.output) as folder, \
            Recorder(folder, calibration, arguments.ply == "last") as recorder:
        line = _Line(arguments.source)
        shown = 0.0
        with open(folder / "link.raw", "wb") as raw, Live(
                console=console, transient=True, auto_refresh=False) as live:
            def show():
                nonlocal shown
                now = time.monotonic()
                if console.is_terminal and now - shown > 0.2:
                    shown = now
                    live.update(line.text(decoder, recorder), refresh=True)

            why = _receive(arguments, source, decoder, recorder, raw, stopped, show)
        for event in decoder.finish():
            recorder.take(event)
        if not decoder.packets:
            raise UserError(_nothing(arguments.source, source.live, decoder))
        recorder.finish()
    _report(arguments, decoder, recorder, why)
    return 0


def _nothing(name, live, decoder):
    if not live:
        return f"{name} holds no packet of the chip: name a link.raw of `cyclope receive`."
    if decoder.octets:
        return (f"What came from {name} is no packet: is --baud right, and is this the chip's "
                "port?")
    return (f"Nothing came from {name}: is the chip powered and running (`cyclope load {name} "
            "--start`), and is this its port?")


def _report(arguments, decoder, recorder, why):
    """What came, and all that was not as it should be."""
    from scripts.host.recorder import MISMATCH
    from scripts.results.summary import plural
    if why:
        print(f"{why}.")
    *counts, last = [
        plural(recorder.frames, "frame"), plural(recorder.points, "point"),
        *(plural(count, f"whole {kind}") for kind, count in recorder.whole.items()
          if kind == "texture" or kind in recorder.seen)]
    print(f"{', '.join(counts)} and {last} in {arguments.output}")
    for number, words in (
            (decoder.lost, "packets lost"), (decoder.damaged, "packets damaged"),
            (decoder.garbage, "octets of garbage"), (decoder.unknown, "unknown packets"),
            (decoder.unbalanced, "frames whose counts do not add up"),
            (sum(picture.outside for picture in recorder.pictures.values()),
             "pieces of texture outside of the sensor"),
            (recorder.unplaced, "pieces of pictures whose frame was not told of")):
        if number:
            print(f"! {number} {words}")
    if recorder.unverified:
        print(f"! {plural(recorder.unverified, 'frame')} whose check failed: {MISMATCH}.")
    for kind in recorder.seen:
        wanted = kind == "pattern" or recorder.seen == {"texture"}
        if arguments.images is not None and wanted and not recorder.whole[kind]:
            print(f"! {kind}.png is not whole, only {recorder.pictures[kind].part:.0%} of it came")
    if recorder.seen == {"texture"} and not recorder.frames:
        print("! no pattern came, only pictures without the laser: `cyclope load PORT "
              "--pattern-images --capture-ms MS` lights it for so long.")
    elif not recorder.frames and not recorder.seen:
        print("! no frame came: `cyclope load PORT --start` starts the chip.")
