"""What came over the line, frame by frame, to look at again: points, and the texture of then."""

import threading
from dataclasses import dataclass, field

import numpy as np

from hdl.protocol import Command, Reason
from model.errors import UserError
from scripts.host.chip import parse_identity
from scripts.host.decoder import Decoder
from scripts.host.frame_locator import FrameLocator
from scripts.host.messages import Frame, Reply, TextureFrame, TexturePiece
from scripts.host.rebuild import Rebuilder
from scripts.host.replay import Replay
from scripts.results.drift import Drift

__all__ = ["History", "Moment", "read_history"]

#: Rows of points that are remembered at most (some 300 MB); older frames are only in the recording.
MOST_POINTS = 6_000_000
#: Frames from one remembered state of the texture to the next.
_SNAPSHOT = 250
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
    pieces : :class:`int`
        Pieces of the texture that came before it.
    drift : :class:`scripts.results.drift.Drift` or None
        Whether the rig is as it was calibrated; None without points.
    """

    frame: Frame
    points: np.ndarray = field(repr=False)
    seconds: float
    lost: int
    pieces: int
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

    def copy(self):
        other = _Texture(*self.grey.shape)
        other.grey[:], other.when[:] = self.grey, self.when
        return other


class History:
    """Frames in their order; safe to read from other threads while frames are added.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration`
        What the chip was loaded with.
    most_points : :class:`int`
        Rows that are remembered at most.

    Attributes
    ----------
    first, count : :class:`int`
        Position of the oldest frame that is remembered, and of the one after the newest.
    identity : :class:`dict` or None
        What the chip replied to IDENTIFY.
    """

    def __init__(self, calibration, most_points=MOST_POINTS):
        self.calibration, self._most = calibration, most_points
        self.first = self.count = 0
        self.identity = None
        self._lock = threading.Lock()
        self._moments, self._rows, self._positions = [], 0, {}
        self._pieces, self._first_piece = [], 0
        self._snapshots = {}  # by position
        self._now = _Texture(calibration.height, calibration.width)
        self._announced, self._early = {}, []
        self._begin_us, self._seconds = None, 0.0

    def take(self, event, points=None, lost=0, drift=None):
        """Take an event of the decoder; of a frame with its rows, the packets lost so far, and
        whether the rig has moved."""
        if isinstance(event, Frame):
            if not event.joined:
                with self._lock:
                    self._add(event, points, lost, drift)
        elif isinstance(event, TextureFrame):
            self._announced[event.index] = None if event.laser else self._time(event)
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
            if self.count == self.first:
                raise UserError("There is no frame yet.")
            position = min(max(position, self.first), self.count - 1)
            return self._moments[position - self.first]

    def position(self, index):
        """Where the frame with this number is.

        Raises
        ------
        UserError
            If there is none.
        """
        with self._lock:
            found = self._positions.get(index)
            known = list(self._positions)
        if found is None:
            raise UserError(f"There is no frame {index}" + (
                f": they are numbered {known[0]} to {known[-1]}, and some may be missing."
                if known else ", nor any other one."))
        return found

    def texture(self, position):
        """Grey values, and the time of each pixel in :attr:`Moment.seconds`, -inf where none came.

        The texture is as it was when the frame at that position came.
        """
        with self._lock:
            position = min(max(position, self.first), max(self.count - 1, self.first))
            if position >= self.count - 1:
                return self._now.grey.copy(), self._now.when.copy()
            begin = max((each for each in self._snapshots if each <= position), default=None)
            if begin is None:
                state, done = _Texture(*self._now.grey.shape), self._first_piece
            else:
                state = self._snapshots[begin].copy()
                done = self._moments[begin - self.first].pieces
            end = self._moments[position - self.first].pieces
            pieces = self._pieces[done - self._first_piece:end - self._first_piece]
        for piece, seconds in pieces:
            state.add(piece, seconds)
        return state.grey, state.when

    def _time(self, event):
        """Seconds of an event by the chip's clock."""
        if event.timestamp_us:
            if self._begin_us is None:
                self._begin_us = event.timestamp_us
            self._seconds = max(self._seconds, (event.timestamp_us - self._begin_us) / 1e6)
        return self._seconds

    def _add(self, frame, points, lost, drift):
        # The frame's own points are in the rows: no need to keep them twice.
        plain = Frame(**{**vars(frame), "points": frame.points[:0]})
        pieces = self._first_piece + len(self._pieces)
        if self.count % _SNAPSHOT == 0:
            self._snapshots[self.count] = self._now.copy()
        self._moments.append(Moment(plain, points, self._time(frame), lost, pieces, drift))
        self._positions[frame.index] = self.count
        self.count += 1
        self._rows += len(points)
        if self._rows > self._most:
            self._forget(_SNAPSHOT)

    def _forget(self, frames):
        """Forget the oldest frames, and pieces of the texture that came before the rest."""
        frames = min(frames, len(self._moments) - 1)
        for moment in self._moments[:frames]:
            self._rows -= len(moment.points)
            self._positions.pop(moment.frame.index, None)
        self.first += frames
        del self._moments[:frames]
        older = [each for each in self._snapshots if each <= self.first]
        for each in older[:-1]:
            del self._snapshots[each]
        if older and older[-1] == self.first:
            begin = self._moments[0].pieces
            del self._pieces[:begin - self._first_piece]
            self._first_piece = begin

    def _settle(self):
        """Add pieces whose frame was announced; those of lit frames are no texture."""
        with self._lock:
            for piece in self._early:
                seconds = self._announced.get(piece.index)
                if seconds is not None:
                    self._now.add(piece, seconds)
                    self._pieces.append((piece, seconds))
        self._early = []


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
