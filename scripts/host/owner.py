"""The one object that has the port: whoever asks the chip, all that comes is recorded."""

import queue
import threading
import time
from concurrent.futures import Future

from hdl.protocol import Mode
from model.errors import UserError
from scripts.host.chip import check_chip
from scripts.host.commands import Commands
from scripts.host.load_plan import LoadPlan
from scripts.host.loading import registers_of
from scripts.host.messages import Frame
from scripts.host.port import VanishedError
from scripts.host.status import causes, find_faults, laser

__all__ = ["ACTIONS", "PortOwner"]

#: Seconds from one look at the chip's state to the next, and until a lost port is tried again.
_STATUS, _AGAIN = 2.0, 1.0
#: What can be asked of the chip, with the mode that it leads to.
ACTIONS = {"start": Mode.CONTINUOUS, "stop": Mode.STOP, "single": Mode.SINGLE, "load": None,
           "clear": None, "set": None}


class PortOwner:
    """Receives from a chip, and asks it what others want, in a thread of its own.

    Every octet goes to the reception first, so the recording has what comes while the chip is
    loaded or asked, too. A port that vanishes is opened again when it is back.

    Parameters
    ----------
    open_port : callable
        Opens the port; see :func:`scripts.host.port.open_port`.
    reception : :class:`scripts.host.reception.Reception`
        Takes what comes.
    history : :class:`scripts.host.history.History`
        Takes the frames.
    calibration : :class:`calibration.file.Calibration`
        What ``load`` loads.
    changed : callable
        Called from the thread after frames, replies and changes of the state.

    Attributes
    ----------
    trouble : :class:`str` or None
        Why nothing comes, or is recorded, in a sentence.
    state : :class:`dict` or None
        What the chip said of itself last: ``mode``, ``laser`` in words, ``armed``, ``tripped``
        causes in words, ``faults`` as sentences.
    doing : :class:`str` or None
        What is being done to the chip.
    """

    def __init__(self, open_port, reception, history, calibration, changed=lambda: None):
        self._open, self.reception, self.history = open_port, reception, history
        self._calibration, self._changed = calibration, changed
        self._jobs, self._ended = queue.Queue(), threading.Event()
        self._port, self._checked = None, False
        self.trouble = self.state = self.doing = None
        self.recording = True
        self.name = "the chip"
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._port = self._open()
        self.name = self._port.name
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        if self._port is not None:
            self._port.__exit__()

    # What Commands wants of a port.

    def read(self):
        """Octets that came; they are recorded, and their frames remembered."""
        octets = self._port.read()
        if octets:
            if self.recording:
                self._record(octets)
            else:
                for _, events in self.reception.decoder.packets_of(octets):
                    self._remember(events, self.reception.recorder.locate)
            self._changed()
        return octets

    def write(self, octets):
        """Send octets."""
        self._port.write(octets)

    def do(self, action, registers=None):
        """Have the chip do one of :data:`ACTIONS`; a future of a sentence, or of a UserError."""
        future = Future()
        self._jobs.put((future, action, dict(registers or {})))
        return future

    def _record(self, octets):
        try:
            self.reception.take(octets, self._remember)
        except UserError as error:
            # The disk is full, or the points cannot be understood: go on without recording.
            self.trouble, self.recording = f"{error} Nothing more is recorded.", False

    def _remember(self, events, locate=None):
        """Give events to the history; ``locate`` makes points of frames that were not recorded."""
        recorder, decoder = self.reception.recorder, self.reception.decoder
        for event in events:
            points = None
            if isinstance(event, Frame) and not event.joined:
                points = locate(event) if locate else recorder.located
            self.history.take(event, points, decoder.lost, recorder.locate.drift)
        return False

    def _run(self):
        due = 0.0
        while not self._ended.is_set():
            try:
                if self._port is None:
                    self._port = self._open()
                    self.trouble, due = None, 0.0
                job = self._next_job()
                if job is not None:
                    self._work(*job)
                    due = 0.0
                if time.monotonic() >= due:
                    self._look()
                    due = time.monotonic() + _STATUS
                self.read()
            except UserError as error:
                self._lose(error)

    def _lose(self, error):
        """The port is gone, or could not be opened yet."""
        self.trouble = f"{str(error).rstrip('.')}: nothing comes until it is back."
        self.state = None
        if self._port is not None:
            self._port.__exit__()
            self._port, self._checked = None, False
        self._changed()
        self._ended.wait(_AGAIN)

    def _next_job(self):
        try:
            return self._jobs.get_nowait()
        except queue.Empty:
            return None

    def _look(self):
        """Ask for the chip's state; one that does not answer is no reason to stop receiving."""
        commands, frames = Commands(self, timeout=0.5, tries=2), self.history.count
        try:
            if not self._checked:
                check_chip(commands.identify(), self._calibration)
                self._checked = True
            status = commands.status()
        except VanishedError:
            raise
        except UserError as error:
            # While frames come a lost answer means nothing, but for another calibration's chip.
            if self.recording and (not self._checked or self.history.count == frames):
                self.state, self.trouble = None, str(error)
        else:
            state = status["state"]
            self.state = {
                "mode": state.mode.name.lower(), "laser": laser(status), "armed": state.armed,
                "tables": state.tables_valid, "causes": causes(status),
                "faults": find_faults(status)}
            if self.recording:
                self.trouble = None
        self._changed()

    def _work(self, future, action, registers):
        self.doing = action
        self._changed()
        try:
            future.set_result(self._carry_out(action, registers))
        except VanishedError as error:
            future.set_exception(error)
            raise
        except UserError as error:
            future.set_exception(error)
        finally:
            self.doing = None
            self._changed()

    def _carry_out(self, action, registers):
        calibration, mode = None, ACTIONS[action]
        if action == "load":
            calibration = self._calibration
            registers = {**registers_of(calibration), **registers}
            mode = Mode.CONTINUOUS
        plan = LoadPlan(calibration, registers, mode, 0 if mode is not None else None,
                        action == "clear", None)
        commands = Commands(self)
        possible = plan.check(commands)
        slow = plan.fit_line(commands)
        plan.carry_out(commands, self._progress)
        faults = [] if slow is None else [slow]
        faults += find_faults(plan.settle(commands))
        done = {"load": "The calibration is loaded, and the chip is started.",
                "start": "The chip is started.", "stop": "The chip is stopped, the laser is off.",
                "single": "The chip takes a pair.", "clear": "The laser guard is cleared.",
                "set": "Written: " + ", ".join(f"{name} = {value}"
                                               for name, value in registers.items()) + "."}[action]
        return " ".join([done, *(f"The laser guard may trip: {reason}." for reason in possible),
                         *(fault[0].upper() + fault[1:] for fault in faults)])

    def _progress(self, done, total):
        self.doing = f"load {100 * done // total} %"
        self._changed()
