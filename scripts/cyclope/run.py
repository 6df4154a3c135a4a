"""``cyclope run``: frames in, 3-D points, pictures and a summary out."""

from dataclasses import replace
from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require
from scripts.results.frames import check_images, find_frames
from scripts.results.measure import measure

__all__ = ["add_arguments", "main", "run"]

_TABLE_LINES = 24


def add_arguments(parser):
    """Declare what ``cyclope run`` takes."""
    parser.description = (
        "Measure frames: write points.csv, points.ply, a picture per frame, a point cloud, a "
        "summary and, where the capture has a truth.csv, the depth errors.")
    parser.epilog = (
        "The column `frame` is the number in the file's name where all names are numbers (0007.png "
        "or 0007_ir.png), else the position in the sorted list, from 0. The chip learns its "
        "threshold on the frame before: the first frame is therefore shown twice, and with "
        "--independent every frame is; with a fixed threshold none is.")
    parser.add_argument(
        "frames", nargs="+", type=Path, metavar="CAPTURE|FOLDER|FILE",
        help="a capture folder, a folder of grey 8-bit images, or such images")
    parser.add_argument(
        "--calibration", required=True, type=Path, metavar="FILE",
        help="calibration.json from `cyclope calibrate`")
    parser.add_argument(
        "--engine", choices=("rtl", "model"), default="rtl",
        help="the RTL, Verilated (default), or the numpy model; both give identical points, unless "
             "a frame has more spots than the chip has room for")
    parser.add_argument(
        "--level", type=int, metavar="N",
        help="fixed threshold, 1 to 255, instead of the calibration's choice; 0 learns it from "
             "each frame's histogram")
    parser.add_argument(
        "--independent", action="store_true",
        help="the frames are unrelated pictures: learn the threshold of each on itself")
    parser.add_argument(
        "--no-pictures", dest="pictures", action="store_false",
        help="tables and point cloud only")
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="OUT",
        help="folder to create; it must not hold anything yet")


def _bar(console):
    from rich import progress
    return progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.MofNCompleteColumn(), progress.TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal)


def run(targets, calibration_path, output, engine="rtl", *, independent=False, pictures=True,
        level=None, console=None):
    """Do what ``cyclope run`` does; arguments as there.

    Returns
    -------
    list of :class:`scripts.results.points.FrameResult`,
    :class:`scripts.results.accuracy.Accuracy` or None
        The latter where there is truth.
    """
    from rich.console import Console

    from scripts.results.outputs import check_folder, new_folder

    check_folder(output)
    entries, truth_path = find_frames(targets)

    import numpy as np

    from calibration import file
    from scripts.results.accuracy import compare, load_truth
    from scripts.results.outputs import write_csv, write_ply
    from scripts.results.points import POINT
    from scripts.results.summary import plural
    from scripts.simulation.engine import open_engine

    calibration = file.load(calibration_path)
    if level is not None:
        if not 0 <= level <= 255:
            raise UserError(f"--level must be 0 to 255, not {level}.")
        calibration = replace(
            calibration, settings=replace(calibration.settings, level_fixed=level or None))
    truth = None if truth_path is None else load_truth(truth_path)
    check_images(entries, calibration.width, calibration.height)
    console = console or Console()
    progress = _bar(Console(stderr=True))
    with new_folder(output) as folder, progress:
        opening = progress.add_task(f"opening engine {engine}", total=None)
        opened = open_engine(engine, calibration, report_rejected=True)
        progress.remove_task(opening)
        measured = progress.track(
            measure(entries, calibration, opened, independent), total=len(entries),
            description="measuring")
        frames = []
        if pictures:
            from scripts.results.overlay import beam_segments, draw_frame, write_picture
            (folder / "frames").mkdir()
            segments = beam_segments(calibration)
        for image, frame in measured:
            frames.append(frame)
            if pictures:
                write_picture(folder / "frames" / f"{frame.index:04}.png",
                              draw_frame(image, frame, segments))
        points = np.concatenate([frame.points for frame in frames] or [np.zeros(0, POINT)])
        accuracy = None if truth is None else compare(
            points, truth, [frame.index for frame in frames])
        write_csv(folder / "points.csv", points)
        write_ply(folder / "points.ply", points, ", ".join(map(str, targets[:3])))
        if pictures:
            plotting = progress.add_task("plotting", total=None)
            from scripts.results.report_plots import plot_cloud, plot_error
            plot_cloud(folder / "point_cloud.png", points, calibration.columns)
            if accuracy is not None and len(accuracy.points):
                plot_error(folder / "depth_error.png", accuracy, calibration.width,
                           calibration.height)
            progress.remove_task(plotting)
        with open(folder / "summary.txt", "w") as text:
            _report(Console(file=text, width=130, color_system=None), frames, accuracy)
    _report(console, frames, accuracy, _TABLE_LINES)
    console.print(f"{plural(len(points), 'spot')} of {plural(len(frames), 'frame')} in {output}",
                  highlight=False)
    return frames, accuracy


def _report(console, frames, accuracy, limit=None):
    from scripts.results.summary import accuracy_table, frames_table, notes_text
    console.print(frames_table(frames, limit))
    notes = notes_text(frames, limit)
    if notes:
        console.print(notes)
    if accuracy is not None:
        console.print(accuracy_table({"all frames": accuracy}))


def main(arguments):
    """Run with parsed arguments; gives the exit status."""
    if arguments.engine == "rtl":
        require("rtl", "`cyclope run`", ", or use --engine model")
    elif arguments.pictures:
        require("calibration", "Plotting", ", or use --no-pictures")
    run(arguments.frames, arguments.calibration, arguments.output, arguments.engine,
        independent=arguments.independent, pictures=arguments.pictures, level=arguments.level)
    return 0
