"""A chip that is received from in a thread, and does what others ask meanwhile."""

import queue
import threading
import time
from concurrent.futures import Future
from contextlib import suppress

from hdl.protocol import Mode
from model.errors import UserError
from scripts.host.chip import ADJUSTABLE, check_chip
from scripts.host.load_plan import MODES, LoadPlan
from scripts.host.loading import registers_of
from scripts.host.messages import Frame
from scripts.host.owner import PortOwner
from scripts.host.port import VanishedError
from scripts.host.status import causes, find_faults, laser

__all__ = ["ACTIONS", "LiveChip"]

#: Seconds from one look at the chip's state to the next, and until a lost port is tried again.
_STATUS, _AGAIN = 2.0, 1.0
#: What can be asked of the chip, and what is said when it is done.
ACTIONS = {
    "load": "The calibration is loaded, and the chip is started.",
    "start": "The chip is started.", "stop": "The chip is stopped, the laser is off.",
    "single": "The chip takes a pair.",
    "pattern-only": "The chip takes patterns only.",
    "pattern-images": "The chip sends patterns as images, without points.",
    "clear": "The laser guard is cleared.", "set": "Written"}


def _fault(error):
    return (f"This program has a fault ({type(error).__name__}: {error}): start it again; the "
            "recording keeps what came.")


class LiveChip(PortOwner):
    """Receives from a chip, and asks it what others want, in a thread of its own.

    A port that vanishes is opened again when it is back. If the recording fails, it goes on
    without.

    Parameters
    ----------
    open_port : callable
        As of :class:`scripts.host.owner.PortOwner`.
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
        causes in words, ``faults`` as sentences, ``as_images`` if patterns are sent as such,
        ``registers`` of :data:`scripts.host.chip.ADJUSTABLE` by name, None until they are read.
    doing : :class:`str` or None
        What is being done to the chip.
    """

    def __init__(self, open_port, reception, history, calibration, changed=lambda: None):
        super().__init__(open_port, self._record)
        self.reception, self.history = reception, history
        self._calibration, self._changed = calibration, changed
        self._jobs, self._ended = queue.Queue(), threading.Event()
        self._names = ("pattern_as_texture",
                       *ADJUSTABLE["paper" if calibration.settings.remap else "capsule"])
        self._checked, self._registers, self._accepted = False, {}, 0
        self.trouble = self.state = self.doing = None
        self.recording, self._failed = True, False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self.open()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self.close()

    def do(self, action, registers=None):
        """Have the chip do one of :data:`ACTIONS`; a future of a sentence, or of a UserError."""
        future = Future()
        self._jobs.put((future, action, dict(registers or {})))
        if self._failed:
            self._refuse_jobs()
        return future

    def _record(self, octets):
        """Record octets, and remember their frames."""
        if not octets:
            return
        if self.recording:
            try:
                self.reception.take(octets, self._remember)
            except UserError as error:
                # The disk is full, or the points cannot be understood.
                self.trouble, self.recording = f"{error} Nothing more is recorded.", False
        else:
            for _, events in self.reception.decoder.packets_of(octets):
                self._remember(events, self.reception.recorder.locate)
        self._changed()

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
        try:
            self._serve()
        except Exception as error:
            self.trouble, self._failed = _fault(error), True
            self._refuse_jobs()
            self._changed()
            raise

    def _refuse_jobs(self):
        """Nobody is left to do them."""
        with suppress(queue.Empty):
            while True:
                self._jobs.get_nowait()[0].set_exception(UserError(self.trouble))

    def _serve(self):
        due = 0.0
        while not self._ended.is_set():
            try:
                if self._port is None:
                    self.open()
                    self.trouble, due = None, 0.0
                if not self._jobs.empty():
                    self._work(*self._jobs.get())
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
        self.state, self._checked, self._registers = None, False, {}
        self.close()
        self._changed()
        self._ended.wait(_AGAIN)

    def _look(self):
        """Ask for the chip's state; one that does not answer is no reason to stop receiving."""
        commands, frames = self.commands(timeout=0.5, tries=2), self.history.count
        try:
            if not self._checked:
                check_chip(commands.identify(), self._calibration)
                self._checked = True
            status = commands.status()
            if status["accepted"] < self._accepted:
                self._registers = {}  # the chip was reset
            self._accepted = status["accepted"]
            self._tell(status)
            for name in self._names:
                if name not in self._registers:
                    self._registers[name] = commands.read(name)
            self._tell(status)
        except VanishedError:
            raise
        except UserError as error:
            # While frames come a lost answer means nothing, but for another calibration's chip.
            if self.recording and (not self._checked or self.history.count == frames):
                self.state, self.trouble = None, str(error)
        self._changed()

    def _tell(self, status):
        """Make the state of what the chip said; registers are those before until all are read."""
        state, read = status["state"], self._registers
        if len(read) < len(self._names):
            read = (self.state or {}).get("registers")
        self.state = {
            "mode": state.mode.name.lower(), "laser": laser(status), "armed": state.armed,
            "tables": state.tables_valid, "causes": causes(status), "faults": find_faults(status),
            "registers": read and dict(read),
            "as_images": state.mode == Mode.PATTERN and bool(read and read["pattern_as_texture"])}
        if self.recording:
            self.trouble = None

    def _work(self, future, action, registers):
        self.doing, self._registers = action, {}
        self._changed()
        try:
            words = self._carry_out(action, registers)
            self._look()  # what it did shows with the answer
            future.set_result(words)
        except VanishedError as error:
            future.set_exception(error)
            raise
        except UserError as error:
            future.set_exception(error)
        except Exception as error:
            future.set_exception(UserError(_fault(error)))
            raise
        finally:
            self.doing = None
            self._changed()

    def _carry_out(self, action, registers):
        calibration, (mode, as_images) = None, MODES.get(action, (None, None))
        if action == "load":
            calibration, (mode, as_images) = self._calibration, MODES["start"]
            registers = {**registers_of(calibration), **registers}
        plan = LoadPlan(calibration, registers, mode, as_images, action == "clear", None)
        commands = self.commands()
        notes = plan.check(commands)
        plan.carry_out(commands, self._progress)
        notes += find_faults(plan.settle(commands))
        done = ACTIONS[action] if action != "set" else "Written: " + ", ".join(
            f"{name} = {value}" for name, value in registers.items()) + "."
        return " ".join([done, *(note[0].upper() + note[1:] for note in notes)])

    def _progress(self, done, total):
        self.doing = f"load {100 * done // total} %"
        self._changed()
