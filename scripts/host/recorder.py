"""What ``cyclope receive`` writes: it depends on the octets of the link alone."""

import shutil
from contextlib import ExitStack

import numpy as np

from hdl.protocol import Command, Reason
from model.errors import UserError
from scripts.host.chip import check_chip, parse_identity
from scripts.host.messages import Frame, Reply, TextureFrame, TexturePiece
from scripts.results.outputs import CSV_HEADER, csv_line, ply_header, ply_line
from scripts.results.points import DUPLICATE, POINT, STATUS, find_duplicates, locate

__all__ = ["MISMATCH", "NO_CALIBRATION", "Recorder", "Texture"]

MISMATCH = ("the calibration is not the one in the chip, or the chip's depth unit is at fault: "
            "load it again with `cyclope load`")
NO_CALIBRATION = ("The points come in their compact form, which needs the calibration that the "
                  "chip was loaded with: add --calibration calibration.json, or have the chip "
                  "send records (`cyclope load PORT --register full_records=1`).")
#: Points of frames whose check failed get this word instead of ok, and no place.
_NAMES = (*STATUS, "unverified")
_UNVERIFIED = len(STATUS)
_LSB_PX = 1 / 512
_LARGEST = 512
_CLOUD = "points.ply.part"
_COUNTED = ("level", "skipped", "spots", "ok", "noise", "ambiguous", "rejected", "dropped",
            "unlisted")
_FLAGS = ("learning", "broken", "capture", "tripped", "tables_valid")
_FRAMES_HEADER = ("number,kind,laser,exposure_us,timestamp_us," + ",".join(_COUNTED)
                  + ",check,flags,lost_packets,bad_sync,overrun\n")
_CHECK = {True: "ok", False: "failed", None: ""}


#: Texture frames of which is remembered whether they were lit, and pieces that wait for that.
_REMEMBERED = 64


class Texture:
    """The picture that texture pieces add up to.

    Parameters
    ----------
    size : tuple of two :class:`int` or None
        Width and height; None if they are not known yet: the picture is then as large as what
        came, and never whole.

    Attributes
    ----------
    image : 2-D ``uint8`` array
        The last state; black where nothing came yet.
    outside : :class:`int`
        Pieces that do not lie on the sensor.
    """

    def __init__(self, size=None):
        self.size, self.outside = size, 0
        width, height = size or (0, 0)
        self.image = np.zeros((height, width), np.uint8)
        self._fresh = np.zeros((height, width), bool)
        self._came = np.zeros((height, width), bool)

    @property
    def part(self):
        """Part of the picture that ever came, 0 to 1."""
        return float(self._came.mean()) if self._came.size else 0.0

    @property
    def fresh(self):
        """Part of the picture that came since it was whole for the last time, 0 to 1."""
        return float(self._fresh.mean()) if self._fresh.size else 0.0

    def resize(self, size):
        """Take the size, which was not known."""
        width, height = size
        grown = Texture(size)
        rows, columns = min(height, len(self.image)), min(width, self.image.shape[1])
        for mine, new in ((self.image, grown.image), (self._fresh, grown._fresh),
                          (self._came, grown._came)):
            new[:rows, :columns] = mine[:rows, :columns]
        self.size, self.image = size, grown.image
        self._fresh, self._came = grown._fresh, grown._came

    def add(self, piece):
        """Put a piece in its place; whether the whole picture has been refreshed with it."""
        end = piece.column + len(piece.pixels)
        width, height = self.size or (_LARGEST, _LARGEST)
        if piece.row >= height or end > width:
            self.outside += 1
            return False
        if self.size is None and (piece.row >= len(self.image) or end > self.image.shape[1]):
            self.resize((max(end, self.image.shape[1]), max(piece.row + 1, len(self.image))))
            self.size = None
        self.image[piece.row, piece.column:end] = piece.pixels
        self._fresh[piece.row, piece.column:end] = True
        self._came[piece.row, piece.column:end] = True
        if self.size is None or not self._fresh.all():
            return False
        self._fresh[:] = False
        return True


class Recorder:
    """Writes tables, points and textures into a folder as events come; a context manager.

    Parameters
    ----------
    folder : path
        Exists and is empty.
    calibration : :class:`calibration.file.Calibration` or None
        What the chip was loaded with.
    last_only : :class:`bool`
        ``points.ply`` has the last frame with points only, not all frames.

    Attributes
    ----------
    frames, points, unverified : :class:`int`
        Pattern frames; points with a beam; frames whose check failed.
    pictures : dict of :class:`Texture` by :class:`str`
        What came of ``texture``, exposed without the laser, and of ``pattern``, with it.
    whole : dict of :class:`int` by :class:`str`
        How often each was refreshed as a whole.
    last : :class:`scripts.host.messages.Frame` or None
        The last pattern frame.
    identity : :class:`dict` or None
        What the chip said it is.
    """

    def __init__(self, folder, calibration=None, last_only=False):
        self.folder, self.calibration, self.last_only = folder, calibration, last_only
        self.frames = self.points = self.unverified = 0
        self.last = self.identity = None
        size = calibration and (calibration.width, calibration.height)
        self.pictures = {kind: Texture(size) for kind in ("texture", "pattern")}
        self.whole = dict.fromkeys(self.pictures, 0)
        self.seen = set()  # pictures of which something came
        self._lit = {}  # of the last texture frames, by index
        self._early = []  # pieces that came before what tells of their frame
        self.unplaced = 0  # those of which it did not come
        self._trusted = False  # the last check that could be made was right
        self._placed = 0
        self._files = ExitStack()
        self._points, self._frames, self._cloud = (
            self._files.enter_context((folder / name).open("w+", newline="\n"))
            for name in ("points.csv", "frames.csv", _CLOUD))
        self._points.write(CSV_HEADER + "\n")
        self._frames.write(_FRAMES_HEADER)

    def take(self, event):
        """Write what an event of the decoder tells.

        Raises
        ------
        UserError
            If the points cannot be understood, or the calibration is of another sensor.
        """
        if isinstance(event, Frame):
            self._frame(event)
        elif isinstance(event, TextureFrame):
            self._lit[event.index] = event.laser
            if len(self._lit) > _REMEMBERED:
                del self._lit[min(self._lit)]
            self._place_early()
            self._row(event, "texture", [str(event.skipped) if name == "skipped" else ""
                                         for name in _COUNTED], "", "")
        elif isinstance(event, TexturePiece):
            self._early.append(event)
            if event.index in self._lit or len(self._early) > _REMEMBERED:
                self._place_early()
        elif isinstance(event, Reply):
            self._reply(event)

    def finish(self):
        """Complete all files."""
        self._place_early()
        for kind in self.seen:
            self._picture(kind, self.folder / f"{kind}.png")
        with open(self.folder / "points.ply", "w", newline="\n") as file:
            file.write(ply_header(self._placed, "frames from the link"))
            self._cloud.seek(0)
            shutil.copyfileobj(self._cloud, file)
        self._files.close()
        (self.folder / _CLOUD).unlink()

    def __enter__(self):
        return self

    def __exit__(self, *details):
        self._files.close()

    def _place_early(self):
        """Pieces go to the picture of their frame's kind; they will come again if it is unknown."""
        for piece in self._early:
            if piece.index in self._lit:
                self._piece(piece, self._lit[piece.index])
            else:
                self.unplaced += 1
        self._early = []

    def _piece(self, piece, lit):
        kind = "pattern" if lit else "texture"
        self.seen.add(kind)
        if self.pictures[kind].add(piece):
            (self.folder / kind).mkdir(exist_ok=True)
            self._picture(kind, self.folder / kind / f"{piece.index:04}.png")
            self.whole[kind] += 1

    def _picture(self, kind, path):
        import cv2
        done, data = cv2.imencode(
            ".png", self.pictures[kind].image, [cv2.IMWRITE_PNG_COMPRESSION, 3])
        assert done
        path.write_bytes(data.tobytes())

    def _row(self, event, kind, counts, check, lost):
        flags = " ".join(name for name in _FLAGS if getattr(event, name))
        self._frames.write(",".join([
            str(event.index), kind, "on" if event.laser else "off", str(event.exposure_us),
            str(event.timestamp_us), *counts, check, flags, lost, str(event.bad_sync),
            str(event.overrun)]) + "\n")

    def _frame(self, frame):
        self.frames += 1
        self.last = frame
        if frame.verified is not None:
            self._trusted = frame.verified and (self._trusted or frame.ok > 0)
            self.unverified += not frame.verified
        if frame.compact and len(frame.points) and self.calibration is None and (
                frame.points["status"] == 0).any():
            raise UserError(NO_CALIBRATION)
        if frame.summarised:
            self._row(frame, "pattern", [str(getattr(frame, name)) for name in _COUNTED],
                      _CHECK[frame.verified], str(frame.lost))
        else:
            # Laser, exposure and time were in the packet that is missing.
            blank = [""] * (3 + len(_COUNTED) + 1)
            self._frames.write(",".join(
                [str(frame.index), "pattern", *blank, "incomplete", str(frame.lost), "", ""])
                + "\n")
        points = self._located(frame)
        for point in points:
            self._points.write(csv_line(point, _NAMES))
        self.points += int(np.count_nonzero(points["status"] == STATUS.index("ok")))
        placed = points[~np.isnan(points["z"])]
        if self.last_only and len(placed):
            self._cloud.seek(0)
            self._cloud.truncate()
            self._placed = 0
        for point in placed:
            self._cloud.write(ply_line(point))
        self._placed += len(placed)

    def _located(self, frame):
        reported = frame.points.copy()
        if not self._trusted:
            reported["status"][reported["status"] == 0] = _UNVERIFIED
        if self.calibration is not None:
            return locate(
                reported, frame.index, self.calibration, self.pictures["texture"].image)
        points = np.zeros(len(reported), POINT)
        points["frame"] = frame.index
        for name in ("status", "area"):
            points[name] = reported[name]
        points["beam"] = np.where(points["status"] == 0, np.asarray(reported["beam"], np.int16), -1)
        points["status"][find_duplicates(reported)] = DUPLICATE
        for name in "uv":
            points[name] = np.asarray(reported[name], float) * _LSB_PX
        for name in "xyz":
            points[name] = np.nan
        return points

    def _reply(self, reply):
        if (reply.command, reply.reason) != (Command.IDENTIFY, Reason.OK):
            return
        self.identity = parse_identity(reply.data)
        if self.calibration is not None:
            check_chip(self.identity, self.calibration)
            return
        for picture in self.pictures.values():
            if picture.size is None:
                picture.resize((self.identity["width"], self.identity["height"]))
