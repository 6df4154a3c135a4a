"""What the page shows: a chip that is received from, or a recording."""

import threading

import numpy as np

from model.errors import UserError
from scripts.host.chip import ADJUSTABLE, REGISTERS
from scripts.host.history import History, read_history
from scripts.measure.formats import FORMATS
from scripts.measure.surface import Surface
from scripts.view.measurements import Measurements
from scripts.view.scene import describe_rig

__all__ = ["LiveSession", "ReplaySession", "Session", "ThreadSession"]


class Session:
    """What both have; a context manager.

    Parameters
    ----------
    history : :class:`scripts.host.history.History`
        The frames.
    name : :class:`str`
        What they come from.
    measurements : path or None
        Where the list of measurements is kept.

    Attributes
    ----------
    live : :class:`bool`
        Frames keep coming.
    owner : :class:`scripts.host.live_chip.LiveChip` or None
        The port of a live session.
    changed : callable
        Called, from any thread, when there is something new.
    adjustable : dict of :class:`str`
        Registers that the page may write, with what they are in a few words.
    fault : :class:`str` or None
        A fault of the program itself, in a sentence.
    """

    live, owner = False, None

    def __init__(self, history, name, measurements=None):
        self.history, self.name = history, name
        self.measurements = Measurements(history, measurements)
        self.changed = lambda: None
        self.adjustable = ADJUSTABLE["paper" if history.calibration.settings.remap else "capsule"]
        self.fault = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def hello(self):
        """The first message of the page."""
        registers = {name: {"words": words, "meaning": f"{name}: {REGISTERS[name].meaning}"}
                     for name, words in self.adjustable.items()}
        return {"type": "hello", "live": self.live, "source": self.name, "registers": registers,
                "rig": describe_rig(self.history.calibration)}

    def state(self):
        """What changes by itself."""
        return {"type": "state", "first": self.history.first, "count": self.history.count,
                "trouble": (self.fault or self.measurements.trouble or self._trouble()
                            or self.history.trouble), "chip": None, "doing": None, **self._more()}

    def _trouble(self):
        return None

    def _more(self):
        return {"recording": None}

    def download(self, path, query):
        """Content, type and name of a file to download; None if there is none."""
        if path == "/measurements.csv":
            return self.measurements.csv().encode(), "text/csv; charset=utf-8", "measurements.csv"
        name, _, kind = path[1:].partition(".")
        if name != "frame" or kind not in FORMATS:
            return None
        number = query.get("frame", [""])[0]
        if not (number.isascii() and number.isdigit() and len(number) < 12):
            raise UserError("Name a frame: /frame.ply?frame=N.")
        position = self.history.position(int(number))
        moment = self.history.moment(position)
        picture, when = self.history.picture(position)
        write, media = FORMATS[kind]
        surface = Surface(moment.points, self.history.calibration)
        return (write(surface, picture, np.isfinite(when), moment.seconds), media,
                f"frame-{int(number):04}.{kind}")


class ThreadSession(Session):
    """A session whose frames come from a thread, which :meth:`_run` is, until ``_ended`` is set."""

    def __init__(self, history, name, measurements=None):
        super().__init__(history, name, measurements)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()


class ReplaySession(ThreadSession):
    """A recording, read in a thread while it is shown already.

    Parameters
    ----------
    path : path
        ``link.raw``.
    calibration : :class:`calibration.file.Calibration`
        What the chip was loaded with.
    """

    def __init__(self, path, calibration):
        super().__init__(History(calibration), str(path), path.with_name("measurements.csv"))
        self._path, self._failed, self._reading = path, None, True

    def _run(self):
        try:
            read_history(self._path, self.history.calibration, self._ended.is_set, self.history)
        except UserError as error:
            self._failed = str(error)
        self._reading = False
        self.changed()

    def wait(self):
        """Wait until all of it was read; raises a UserError if it is no recording."""
        self._thread.join()
        if self._failed:
            raise UserError(self._failed)

    def _trouble(self):
        return self._failed

    def _more(self):
        return {"recording": {"on": False, "where": str(self._path)}, "reading": self._reading}


class LiveSession(Session):
    """A chip behind a port.

    Parameters
    ----------
    owner : :class:`scripts.host.live_chip.LiveChip`
        It receives into ``history``, and is entered with this.
    history : :class:`scripts.host.history.History`
        The frames.
    folder : path
        Where it is recorded.
    name : :class:`str`
        Of the port.
    """

    live = True

    def __init__(self, owner, history, folder, name):
        super().__init__(history, name, folder / "measurements.csv")
        self.owner, self._folder = owner, folder

    def __enter__(self):
        self.owner.__enter__()
        return self

    def __exit__(self, *details):
        self.owner.__exit__(*details)

    def _trouble(self):
        return self.owner.trouble

    def _more(self):
        return {"recording": {"on": self.owner.recording, "where": str(self._folder)},
                "chip": self.owner.state, "doing": self.owner.doing}
