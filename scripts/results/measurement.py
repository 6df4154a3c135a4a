"""A measurement on disk: points as they are measured, and what follows from all of them."""

import shutil
import tempfile
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from scripts.results.accuracy import compare
from scripts.results.cloud import write_ply
from scripts.results.outputs import CSV_HEADER, csv_line, take_folder
from scripts.results.overlay import beam_segments, draw_frame, write_picture
from scripts.results.points import DOUBTFUL, POINT
from scripts.results.row_file import RowFile
from scripts.results.summary import accuracy_table, frames_table, notes_text

__all__ = ["Measurement", "keep_results", "print_report", "write_frames", "write_rest"]


@dataclass
class Measurement:
    """What was measured.

    Parameters
    ----------
    frames : list of :class:`scripts.results.points.FrameResult`
        In the order measured.
    notes : list of :class:`str`
        On what was named on the command line.
    accuracy : :class:`scripts.results.accuracy.Accuracy` or None
        Where there is truth.
    """

    frames: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    accuracy: object = None

    @property
    def points(self):
        """Array of :data:`scripts.results.points.POINT` with the spots of all frames."""
        return np.concatenate([frame.points for frame in self.frames] or [np.zeros(0, POINT)])

    @property
    def ok(self):
        """How many ok points there are."""
        return sum(frame.count("ok") for frame in self.frames)

    def warnings(self):
        """What the user has to know of the measurement as a whole."""
        if self.ok:
            return self.notes
        return [*self.notes, "no frame has an ok point, so nothing here is to be used: check the "
                             "exposure, the levels (--noise), and whether the calibration is of "
                             "this rig"]


@contextmanager
def keep_results(output, measurement, total):
    """The folder ``output``, in which what was measured stays, however this ends.

    An error, or an interrupt, gets a note that says what there is. If nothing was measured yet,
    nothing is left.

    Parameters
    ----------
    output : path
        Folder to create, or an empty one.
    measurement : :class:`Measurement`
        To be filled meanwhile.
    total : :class:`int`
        Frames to measure.
    """
    folder, created = take_folder(output)
    try:
        yield folder
    except BaseException as error:
        if measurement.frames:
            error.add_note(f"The points of {len(measurement.frames)} of {total} frames are in "
                           f"{folder / 'points.csv'}.")
        else:
            (folder / "points.csv").unlink(missing_ok=True)
            shutil.rmtree(folder / "frames", ignore_errors=True)
            if created:
                folder.rmdir()
            error.add_note("Nothing was written.")
        raise


def write_frames(folder, measured, measurement, calibration, pictures, doubtful=True):
    """Write every frame's points to ``points.csv``, and its picture, as soon as it is measured.

    Parameters
    ----------
    folder : path
        Where to write.
    measured : iterable
        From :func:`scripts.results.measure.measure`.
    measurement : :class:`Measurement`
        Gets the frames.
    calibration : calibration
        Its epipolar lines are drawn.
    pictures : :class:`bool`
        Draw a picture of each frame.
    doubtful : :class:`bool`
        Draw doubtful points too.
    """
    if pictures:
        (folder / "frames").mkdir()
        segments = beam_segments(calibration)
    with closing(RowFile(folder / "points.csv", CSV_HEADER + "\n")) as rows:
        for image, frame in measured:
            for point in frame.points:
                rows.append(csv_line(point))
            rows.flush()
            measurement.frames.append(frame)
            if pictures:
                write_picture(folder / "frames" / f"{frame.index:04}.png",
                              draw_frame(image, _drawn(frame, doubtful), segments))
        rows.sync()


def _shown(points, doubtful):
    """The points, without doubtful ones if those are not wanted."""
    return points if doubtful else points[points["status"] != DOUBTFUL]


def _drawn(frame, doubtful):
    return replace(frame, points=_shown(frame.points, doubtful))


def write_rest(folder, measurement, calibration, source, truth=None, pictures=True,
               doubtful=True):
    """Compare with the truth, and write what follows from all points; it appears all at once.

    Parameters
    ----------
    folder : path
        Where to write.
    measurement : :class:`Measurement`
        With all frames; gets the accuracy.
    calibration : calibration
        Columns of the mesh, and size of the sensor.
    source : :class:`str`
        What was measured, for a comment.
    truth : array or None
        From :func:`scripts.results.accuracy.load_truth`.
    pictures : :class:`bool`
        Draw the point cloud and the errors.
    doubtful : :class:`bool`
        ``points.ply`` and the point cloud have the doubtful points too.
    """
    points = measurement.points
    if truth is not None:
        measurement.accuracy = compare(
            points, truth, [frame.index for frame in measurement.frames])
    accuracy = measurement.accuracy
    points = _shown(points, doubtful)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".part-") as part:
        part = Path(part)
        write_ply(part / "points.ply", points, calibration.columns, source)
        if pictures:
            from scripts.results.report_plots import plot_cloud, plot_error
            plot_cloud(part / "point_cloud.png", points, calibration.columns)
            if accuracy is not None and len(accuracy.points):
                plot_error(part / "depth_error.png", accuracy, calibration.width,
                           calibration.height)
        with open(part / "summary.txt", "w", encoding="utf-8") as text:
            print_report(Console(file=text, width=130, color_system=None), measurement)
        for path in sorted(part.iterdir()):  # summary.txt is the last one
            path.rename(folder / path.name)


def print_report(console, measurement, limit=None):
    """Print the tables of frames and accuracy, and all notes.

    Parameters
    ----------
    console : :class:`rich.console.Console`
        Where to.
    measurement : :class:`Measurement`
        All of it.
    limit : :class:`int` or None
        See :func:`scripts.results.summary.frames_table`.
    """
    console.print(frames_table(measurement.frames, limit))
    notes = notes_text(measurement.frames, limit)
    if notes:
        console.print(notes)
    for warning in measurement.warnings():
        console.print(Text(f"! {warning}", style="yellow"))
    if measurement.accuracy is not None:
        console.print(accuracy_table({"all frames": measurement.accuracy}))
