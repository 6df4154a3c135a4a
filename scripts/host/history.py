"""What came over the line, frame by frame, to look at again: points, and the texture of then."""

import io
import pickle
import threading
from array import array
from dataclasses import dataclass, field

import numpy as np

from hdl.protocol import Command, Reason
from model.errors import UserError
from scripts.host.chip import parse_identity
from scripts.host.clock import ChipClock
from scripts.host.decoder import Decoder
from scripts.host.frame_locator import FrameLocator
from scripts.host.messages import Frame, Reply, TextureFrame, TexturePiece
from scripts.host.rebuild import Rebuilder
from scripts.host.replay import Replay
from scripts.host.spool import Spool
from scripts.results.colour import colour_picture
from scripts.results.drift import Drift

__all__ = ["History", "Moment", "read_history"]

#: Frames from one remembered state of the texture to the next.
_SNAPSHOT = 250
#: Pieces of the texture that wait in memory for a frame.
_PIECES = 1024
#: Texture frames of which is remembered whether they were lit, and pieces that wait for that.
_REMEMBERED = 64


@dataclass(frozen=True)
class Moment:
    """A pattern frame.

    Parameters
    ----------
    frame : :class:`scripts.host.messages.Frame`
        What the chip said of it; without its points.
    points : array of :data:`scripts.results.points.POINT`
        Its rows.
    seconds : :class:`float`
        By the chip's clock, since the first frame; that of the frame before if it is not known.
    lost : :class:`int`
        Packets lost until then.
    drift : :class:`scripts.results.drift.Drift` or None
        Whether the rig is as it was calibrated; None without points.
    """

    frame: Frame
    points: np.ndarray = field(repr=False)
    seconds: float
    lost: int
    drift: Drift | None


class _Texture:
    """The texture as it was: its pixels, and the chip's time at which each came."""

    def __init__(self, height, width):
        self.grey = np.zeros((height, width), np.uint8)
        self.when = np.full((height, width), -np.inf, np.float32)

    def add(self, piece, seconds):
        end = piece.column + len(piece.pixels)
        height, width = self.grey.shape
        if piece.row < height and end <= width:
            self.grey[piece.row, piece.column:end] = piece.pixels
            self.when[piece.row, piece.column:end] = seconds


class History:
    """Frames in their order; safe to read from other threads while frames are added.

    They are kept on the disk; what is in memory is the newest frame, the newest texture, and some
    tens of octets for each of the others.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration`
        What the chip was loaded with.
    folder : path or None
        Where they are kept, without a name; None for the system's temporary folder.
    forgets : :class:`bool`
        Where the disk is full, forget older frames and say so in :attr:`trouble`, rather than
        raise a UserError.

    Attributes
    ----------
    first, count : :class:`int`
        Position of the oldest frame that is remembered, and of the one after the newest.
    identity : :class:`dict` or None
        What the chip replied to IDENTIFY.
    trouble : :class:`str` or None
        Why older frames were forgotten, in a sentence.
    """

    def __init__(self, calibration, folder=None, forgets=False):
        self.calibration, self._forgets = calibration, forgets
        self.first = self.count = 0
        self.identity = self.trouble = None
        self._lock = threading.Lock()
        self._newest = None
        self._moments, self._pieces, self._states = (Spool(folder) for _ in range(3))
        self._base = 0  # position of the frame in the first record of `_moments`
        self._begin_anew()
        self._failed = None  # why pieces could not be written
        self._now, self._since = _Texture(calibration.height, calibration.width), []
        self._announced, self._early = {}, []
        self._clock = ChipClock()

    def take(self, event, points=None, lost=0, drift=None):
        """Take an event of the decoder; of a frame with its rows, the packets lost so far, and
        whether the rig has moved."""
        if isinstance(event, Frame):
            if not event.joined:
                with self._lock:
                    self._add(event, points, lost, drift)
        elif isinstance(event, TextureFrame):
            seconds = self._clock(event)
            self._announced[event.index] = None if event.laser else seconds
            if len(self._announced) > _REMEMBERED:
                del self._announced[min(self._announced)]
            self._settle()
        elif isinstance(event, TexturePiece):
            self._early.append(event)
            if event.index in self._announced or len(self._early) > _REMEMBERED:
                self._settle()
        elif isinstance(event, Reply) and (event.command, event.reason) == (
                Command.IDENTIFY, Reason.OK):
            self.identity = parse_identity(event.data)

    def moment(self, position):
        """The frame at a position; the nearest one if that is not remembered.

        Raises
        ------
        UserError
            If there is no frame.
        """
        with self._lock:
            if self._newest is None:
                raise UserError("There is no frame yet.")
            position = min(max(position, self.first), self.count - 1)
            if position == self.count - 1:
                return self._newest
            octets = self._moments.read(position - self._base)
        return pickle.loads(octets)

    def numbers(self):
        """Numbers of the frames that are remembered, in the order of their positions; an array."""
        with self._lock:
            return np.array(self._numbers, np.int64)

    def seconds(self, position):
        """:attr:`Moment.seconds` of the frame at a position that is remembered."""
        with self._lock:
            return self._times[min(max(position, self.first), self.count - 1) - self.first]

    def position(self, number):
        """Where the frame with this number is; the last one, if there are several.

        Raises
        ------
        UserError
            If there is none.
        """
        with self._lock:
            first, known = self.first, np.array(self._numbers, np.int64)
        found = np.flatnonzero(known == number)
        if not len(found):
            raise UserError(f"There is no frame {number}" + (
                f": they are numbered {known[0]} to {known[-1]}, and some may be missing."
                if len(known) else ", nor any other one."))
        return first + int(found[-1])

    def texture(self, position):
        """Grey values, and the time of each pixel in :attr:`Moment.seconds`, -inf where none came.

        The texture is as it was when the frame at that position came.
        """
        with self._lock:
            if position >= self.count - 1:
                return self._now.grey.copy(), self._now.when.copy()
            record = max(position, self.first) - self._base
            state = record // _SNAPSHOT
            octets = self._states.read(state)
            first, end = self._piece_ends[state * _SNAPSHOT], self._piece_ends[record]
            pieces = self._pieces.read(first, end - first)
        state = _Texture(*self._now.grey.shape)
        size = state.grey.size
        state.grey.flat = np.frombuffer(octets, np.uint8, size)
        state.when.flat = np.frombuffer(octets, np.float32, size, size)
        file = io.BytesIO(pieces)
        while file.tell() < len(pieces):
            for piece, seconds in pickle.load(file):
                state.add(piece, seconds)
        return state.grey, state.when

    def picture(self, position):
        """As :meth:`texture`, but as :func:`scripts.results.colour.colour_picture` shows it."""
        image, when = self.texture(position)
        return colour_picture(image, np.isfinite(when), self.calibration.bayer), when

    def _add(self, frame, points, lost, drift):
        # The frame's own points are in the rows: no need to keep them twice.
        plain = Frame(**{**vars(frame), "points": frame.points[:0]})
        moment = Moment(plain, points, self._clock(frame), lost, drift)
        if self.first < self._base:
            self._begin_anew()  # the frame before could not be kept
        try:
            self._keep(moment)
        except UserError as error:
            if not self._forgets:
                raise
            self._forget(error)
        self._newest = moment
        self._numbers.append(frame.index)
        self._times.append(moment.seconds)
        self.count += 1

    def _keep(self, moment):
        """Write a frame, the pieces that came before it, and at times the whole texture."""
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed
        self._spill()
        if len(self._moments) % _SNAPSHOT == 0:
            self._states.add(self._now.grey.tobytes() + self._now.when.tobytes())
        self._piece_ends.append(len(self._pieces))
        self._moments.add(pickle.dumps(moment))

    def _spill(self):
        pieces, self._since = self._since, []
        if pieces:
            self._pieces.add(pickle.dumps(pieces))

    def _forget(self, error):
        """Forget all frames, and the one that is being added when another one comes."""
        for spool in (self._moments, self._pieces, self._states):
            spool.clear()
        self._begin_anew()
        self._base = self.count + 1
        self.trouble = f"{error} Older frames are only in the recording."

    def _begin_anew(self):
        """The next frame is the first that is remembered."""
        self.first = self.count
        # From position `first` on: numbers, seconds, and records of pieces that came before.
        self._numbers, self._times, self._piece_ends = array("q"), array("d"), array("q")

    def _settle(self):
        """Add pieces whose frame was announced; those of lit frames are no texture."""
        with self._lock:
            for piece in self._early:
                seconds = self._announced.get(piece.index)
                if seconds is not None:
                    self._now.add(piece, seconds)
                    self._since.append((piece, seconds))
            self._early = []
            if len(self._since) > _PIECES and self._failed is None:
                try:
                    self._spill()
                except UserError as error:
                    self._failed = error  # for the next frame


def read_history(path, calibration, stopped=lambda: False, history=None):
    """The history of a recording.

    Parameters
    ----------
    path : path
        ``link.raw``.
    calibration : :class:`calibration.file.Calibration`
        What the chip was loaded with.
    stopped : callable
        Whether to read no further.
    history : :class:`History` or None
        To be filled; new if None.

    Raises
    ------
    UserError
        If it cannot be read, or holds no packet of the chip.
    """
    history = History(calibration) if history is None else history
    decoder = Decoder(Rebuilder(calibration.settings, calibration.width, calibration.height))
    locate = FrameLocator(calibration)

    def take(events):
        for event in events:
            points = None
            if isinstance(event, Frame) and not event.joined:
                points = locate(event)
            history.take(event, points, decoder.lost, locate.drift)

    with Replay(path) as source:
        while not stopped() and (octets := source.read()) is not None:
            take(decoder.events(octets))
    take(decoder.finish())
    if not decoder.packets:
        raise UserError(f"{path} holds no packet of the chip: name a link.raw of `cyclope "
                        "receive`.")
    return history
