"""What ``cyclope receive`` writes: it depends on the octets of the link alone."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from hdl.protocol import Command, Reason
from model.errors import UserError
from scripts.host.chip import check_chip, parse_identity, parse_status
from scripts.host.clock import ChipClock
from scripts.host.frame_locator import NAMES, FrameLocator
from scripts.host.image_assembly import ImageAssembly
from scripts.host.messages import Frame, Reply, TextureFrame, TexturePiece
from scripts.results.cloud import CloudFiles
from scripts.results.colour import colour_picture, to_file
from scripts.results.outputs import TIMED_CSV_HEADER, csv_line, whole_file
from scripts.results.points import DOUBTFUL, DUPLICATE, OK
from scripts.results.row_file import RowFile

__all__ = ["MISMATCH", "NO_CALIBRATION", "Recorder"]

MISMATCH = ("the calibration is not the one in the chip, or the chip's depth unit is at fault: "
            "load it again with `cyclope load`")
NO_CALIBRATION = ("The points come in their compact form, which needs the calibration that the "
                  "chip was loaded with: add --calibration calibration.json, or have the chip "
                  "send records (`cyclope load PORT --register full_records=1`).")
#: Grey values in the tables, and how many of the chip's units make one.
_GREY_UNITS = {"level": 16, "grey_noise": 8}
_COUNTED = ("level", "grey_noise", "saturated", "skipped", "spots", "ok", "noise", "ambiguous",
            "rejected", "dropped", "unlisted")
_FLAGS = ("learning", "broken", "capture", "tripped", "tables_valid")
_FRAMES_HEADER = ("number,kind,laser,exposure_us,timestamp_us," + ",".join(_COUNTED)
                  + ",check,flags,lost_packets,bad_sync,overrun,duplicate,doubtful"
                  + ",line_distance_px,line_distance_normal_px,moved,every\n")
_CHECK = {True: "ok", False: "failed", None: ""}
#: Texture frames of which is remembered whether they were lit, and fragments that wait for that.
_REMEMBERED = 64


class Recorder:
    """Writes tables, points and images into a folder as events come; a context manager.

    ``points.csv`` and ``frames.csv`` grow with each :meth:`flush`, and so do the folders of
    complete images and of frames' point clouds; ``points.ply`` and the last state of the images
    come with :meth:`finish`.

    A frame in whose middle the recording starts is left out.

    Parameters
    ----------
    folder : path
        Exists.
    calibration : :class:`calibration.file.Calibration` or None
        What the chip was loaded with.
    which, pcd
        Of the point clouds, as of :class:`scripts.results.cloud.CloudFiles`.
    doubtful : :class:`bool`
        The point clouds have the doubtful points too.

    Attributes
    ----------
    frames, points, unverified : :class:`int`
        Pattern frames; ok points with a beam; frames whose check failed.
    verified, lit, tabled, tripped : :class:`int`
        Pattern frames with points whose check is right; with the laser on; with valid tables in
        the chip; frames of either kind for which the laser guard held a cause.
    reported : :class:`int`
        Ok points as the chip sent them.
    images : dict of :class:`scripts.host.image_assembly.ImageAssembly` by :class:`str`
        What came of ``texture``, exposed without the laser, and of ``pattern``, with it.
    complete : dict of :class:`int` by :class:`str`
        How often each was refreshed completely.
    seen : set of :class:`str`
        Images of which something came.
    orphans : :class:`int`
        Fragments of images whose frame was never announced.
    last : :class:`scripts.host.messages.Frame` or None
        The last pattern frame.
    located : array of :data:`scripts.results.points.POINT` or None
        Its points.
    drift : :class:`scripts.results.drift.Drift` or None
        Whether the rig is as it was calibrated, by the last frame with points.
    locate : :class:`scripts.host.frame_locator.FrameLocator`
        What makes points of frames.
    identity, status : :class:`dict` or None
        What the chip replied to IDENTIFY, and last to STATUS.
    """

    def __init__(self, folder, calibration=None, which="all", doubtful=True, pcd=False):
        self.folder, self.calibration, self.doubtful = Path(folder), calibration, doubtful
        self.locate, self._clock = FrameLocator(calibration), ChipClock()
        self.frames = self.points = self.unverified = 0
        self.verified = self.lit = self.tabled = self.tripped = self.reported = 0
        self.last = self.located = self.identity = self.status = self.drift = None
        size = calibration and (calibration.width, calibration.height)
        self.images = {kind: ImageAssembly(size) for kind in ("texture", "pattern")}
        self.complete = dict.fromkeys(self.images, 0)
        self.seen = set()
        self.orphans = 0
        self._lit = {}  # of the last texture frames, by index
        self._begin = None  # index of the first frame of which anything came
        self._early = []  # fragments that came before their frame was announced
        self._written = set()
        try:
            self._points = self._table("points.csv", TIMED_CSV_HEADER + "\n")
            self._frames = self._table("frames.csv", _FRAMES_HEADER)
            self._clouds = CloudFiles(self.folder, which, pcd)
        except BaseException:
            for path in self._written:
                path.unlink()
            raise

    @property
    def written(self):
        """Files and folders that were created."""
        return self._written | self._clouds.written

    def take(self, event):
        """Write what an event of the decoder contains.

        Raises
        ------
        UserError
            If the points cannot be understood, or the calibration is of another sensor.
        """
        if self._begin is None and isinstance(event, (Frame, TextureFrame)):
            self._begin = event.index
        if isinstance(event, Frame):
            if not event.joined:
                self._frame(event)
        elif isinstance(event, TextureFrame):
            self._clock(event)
            self.tripped += event.tripped
            self._lit[event.index] = event.laser
            if len(self._lit) > _REMEMBERED:
                del self._lit[min(self._lit)]
            self._add_early()
            self._row(event, "texture", [str(event.skipped) if name == "skipped" else ""
                                         for name in _COUNTED], "", "", [""] * 6)
        elif isinstance(event, TexturePiece):
            self._early.append(event)
            if event.index in self._lit or len(self._early) > _REMEMBERED:
                self._add_early()
        elif isinstance(event, Reply):
            self._reply(event)

    def flush(self):
        """Write all rows."""
        self._points.flush()
        self._frames.flush()

    def finish(self):
        """Complete all files."""
        self._add_early()
        self.flush()
        for kind in sorted(self.seen):
            self._write_image(kind, self.folder / f"{kind}.png")
        self._clouds.finish(self._texture(), self.images["texture"].came)

    def close(self):
        """Flush the tables, and write no more."""
        try:
            self._points.close()
        finally:
            self._frames.close()
            self._clouds.close()

    def __enter__(self):
        return self

    def __exit__(self, *details):
        self.close()

    def _table(self, name, header):
        table = RowFile(self.folder / name, header)
        self._written.add(table.path)
        return table

    def _add_early(self):
        """Give fragments to the image of their frame's kind; unknown ones will come again."""
        for fragment in self._early:
            if fragment.index in self._lit:
                self._add(fragment, "pattern" if self._lit[fragment.index] else "texture")
            else:
                # One from before the recording began is no loss.
                self.orphans += self._begin is None or fragment.index >= self._begin
        self._early = []

    def _add(self, fragment, kind):
        image = self.images[kind]
        outside = image.outside
        complete = image.add(fragment)
        if image.outside == outside:
            self.seen.add(kind)
        if complete:
            folder = self.folder / kind
            if folder not in self._written:
                folder.mkdir()
                self._written.add(folder)
            self._write_image(kind, folder / f"{fragment.index:04}.png")
            self.complete[kind] += 1

    def _texture(self):
        """The newest texture, in colour if the sensor has colour filters."""
        texture = self.images["texture"]
        return colour_picture(texture.image, texture.came,
                              self.calibration and self.calibration.bayer)

    def _write_image(self, kind, path):
        import cv2
        # Pattern images stay as they are: a calibration wants the sensor's own pixels.
        picture = self._texture() if kind == "texture" else self.images[kind].image
        done, data = cv2.imencode(
            ".png", to_file(picture), [cv2.IMWRITE_PNG_COMPRESSION, 3])
        assert done
        with whole_file(path) as file:
            file.write(data.tobytes())
        self._written.add(path)

    def _row(self, event, kind, counts, check, lost, found):
        flags = " ".join(name for name in _FLAGS if getattr(event, name))
        self._frames.append(",".join([
            str(event.index), kind, "on" if event.laser else "off", str(event.exposure_us),
            str(event.timestamp_us), *counts, check, flags, lost, str(event.bad_sync),
            str(event.overrun), *found]) + "\n")

    def _frame(self, frame):
        self.frames += 1
        self.last = frame
        self.lit += frame.laser
        self.tabled += frame.tables_valid
        self.tripped += frame.tripped
        if frame.verified is not None:
            self.unverified += not frame.verified
            self.verified += frame.verified and frame.ok > 0
        reported = int(np.count_nonzero(frame.points["status"] == OK))
        self.reported += reported
        if frame.compact and reported and self.calibration is None:
            raise UserError(NO_CALIBRATION)
        points = self.located = self.locate(frame)
        drift = self.locate.drift
        self.drift = drift or self.drift
        found = [str(np.count_nonzero(points["status"] == status))
                 for status in (DUPLICATE, DOUBTFUL)]
        found += [f"{drift.distance_px:.4f}", f"{drift.normal_px:.4f}",
                  " or ".join(drift.causes)] if drift else [""] * 3
        if frame.summarised:
            self._row(frame, "pattern", [f"{getattr(frame, name) / _GREY_UNITS.get(name, 1):.10g}"
                                         for name in _COUNTED],
                      _CHECK[frame.verified], str(frame.lost), [*found, str(max(1, frame.every))])
        else:
            # Laser, exposure and time were in the packet that is missing.
            blank = [""] * (3 + len(_COUNTED) + 1)
            self._frames.append(",".join([
                str(frame.index), "pattern", *blank, "incomplete", str(frame.lost), "", "",
                *found, ""]) + "\n")
        time_us = str(frame.timestamp_us) if frame.summarised else ""
        for point in points:
            self._points.append(csv_line(point, NAMES, time_us))
        self.points += int(np.count_nonzero(points["status"] == OK))
        located = points[~np.isnan(points["z"])
                         & (self.doubtful | (points["status"] != DOUBTFUL))]
        columns = self.calibration and self.calibration.columns
        self._clouds.add(located, columns, self._clock(frame), self._texture(),
                         self.images["texture"].came)

    def _reply(self, reply):
        if reply.reason != Reason.OK:
            return
        if reply.command == Command.STATUS:
            with suppress(UserError):  # it is for a message only
                self.status = parse_status(reply.data)
        elif reply.command == Command.IDENTIFY:
            self.identity = parse_identity(reply.data)
            if self.calibration is not None:
                check_chip(self.identity, self.calibration)
            size = self.identity["width"], self.identity["height"]
            self.locate.size = size
            for image in self.images.values():
                if image.size is None:
                    image.resize(size)
