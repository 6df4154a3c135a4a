"""``cyclope run``: frames in, 3-D points, pictures and a summary out."""

from dataclasses import replace
from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main", "run"]

_TABLE_LINES = 24
#: Exit status of a run whose result is not to be used.
_UNUSABLE = 3


def add_arguments(parser):
    """Declare what ``cyclope run`` takes."""
    parser.description = (
        "Measure frames: write points.csv, points.ply, a picture per frame, a point cloud, a "
        "summary and, where the capture has a truth.csv, the depth errors.")
    parser.epilog = (
        "points.csv grows while frames are measured, and stays if the run is interrupted or fails; "
        "the other files appear at the end, summary.txt last. The exit status is 3 if no frame has "
        "an ok point. The column `frame` is the number in the file's name where all names are "
        "numbers (0007.png or 0007_ir.png), else the position in the sorted list, from 0. The chip "
        "learns its levels on the frame before: the first frame is therefore shown twice, and with "
        "--independent every frame is; with --noise none is.")
    parser.add_argument(
        "frames", nargs="+", type=Path, metavar="CAPTURE|FOLDER|FILE",
        help="a capture folder, a folder of grey 8-bit images, or such images")
    parser.add_argument(
        "--calibration", required=True, type=Path, metavar="FILE",
        help="calibration.json from `cyclope calibrate`")
    parser.add_argument(
        "--engine", choices=("rtl", "model"), default="rtl",
        help="the RTL, Verilated (default), or the numpy model; both give identical points, unless "
             "a frame has more spots than the chip's buffers hold")
    parser.add_argument(
        "--noise", type=float, metavar="GREY",
        help="fixed noise of the background in grey values, 0.125 to 63.8, instead of the "
             "calibration's choice: all levels are multiples of it; 0 learns it on the frames; "
             "preset capsule")
    parser.add_argument(
        "--level", type=int, metavar="N",
        help="fixed threshold, 1 to 255, instead of the calibration's choice; 0 learns it from "
             "each frame's histogram; preset paper")
    parser.add_argument(
        "--independent", action="store_true",
        help="the frames are unrelated pictures: learn the levels of each on itself, and judge "
             "doubtful points by their own frame alone")
    parser.add_argument(
        "--no-doubtful", dest="doubtful", action="store_false",
        help="leave points that contradict their neighbours in the mesh, and the last depth of "
             "their beam, out of points.ply and the pictures; points.csv has them anyway")
    parser.add_argument(
        "--no-pictures", dest="pictures", action="store_false",
        help="tables and point cloud only")
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="OUT",
        help="folder to create; it must not hold anything yet")


def _with_levels(settings, noise, level):
    """Settings with the user's noise or threshold, checked."""
    if noise is not None:
        if settings.remap:
            raise UserError("--noise is for the preset capsule, and the calibration is for paper: "
                            "use --level.")
        if not (noise == 0 or 0.0625 < noise < 63.9375):
            raise UserError(f"--noise must be 0, or 0.125 to 63.8, not {noise:g}.")
        settings = replace(settings, fixed_noise=round(noise * 8))
    if level is not None:
        if not 0 <= level <= 255:
            raise UserError(f"--level must be 0 to 255, not {level}.")
        if not settings.remap:
            raise UserError("--level is for the preset paper, and the calibration is for capsule: "
                            "use --noise.")
        settings = replace(settings, level_fixed=level or None)
    return settings


def _bar(console):
    from rich import progress
    return progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.MofNCompleteColumn(), progress.TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal)


def run(targets, calibration_path, output, engine="rtl", *, independent=False, pictures=True,
        noise=None, level=None, doubtful=True, console=None):
    """Do what ``cyclope run`` does; arguments as there.

    Returns
    -------
    :class:`scripts.results.measurement.Measurement`

    Raises
    ------
    UserError
        If something cannot be read or written. Points that were measured before are kept, and a
        note on the error names their file.
    """
    from rich.console import Console

    from scripts.results.frames import check_images, find_frames
    from scripts.results.outputs import check_folder

    check_folder(output)
    found = find_frames(targets)

    from calibration import file
    from scripts.results.accuracy import load_truth
    from scripts.results.measure import measure
    from scripts.results.measurement import (
        Measurement,
        keep_results,
        print_report,
        write_frames,
        write_rest,
    )
    from scripts.results.summary import plural
    from scripts.simulation.engine import open_engine

    calibration = file.load(calibration_path)
    calibration = replace(
        calibration, settings=_with_levels(calibration.settings, noise, level))
    truth = None if found.truth is None else load_truth(found.truth)
    entries = found.entries
    check_images(entries, calibration.width, calibration.height)
    console = console or Console()
    result = Measurement(notes=found.notes)
    with _bar(Console(stderr=True)) as progress:
        opening = progress.add_task(f"opening engine {engine}", total=None)
        opened = open_engine(engine, calibration, report_rejected=True)
        progress.remove_task(opening)
        with keep_results(output, result, len(entries)) as folder:
            measured = progress.track(
                measure(entries, calibration, opened, independent), total=len(entries),
                description="measuring")
            write_frames(folder, measured, result, calibration, pictures, doubtful)
            progress.add_task("plotting" if pictures else "writing", total=None)
            write_rest(folder, result, calibration, ", ".join(map(str, targets[:3])), truth,
                       pictures, doubtful)
    print_report(console, result, _TABLE_LINES)
    console.print(f"{plural(len(result.points), 'spot')} of {plural(len(entries), 'frame')} in "
                  f"{output}", highlight=False, markup=False)
    return result


def main(arguments):
    """Run with parsed arguments; gives the exit status."""
    if arguments.engine == "rtl":
        require("rtl", "`cyclope run`", ", or use --engine model")
    elif arguments.pictures:
        require("calibration", "Plotting", ", or use --no-pictures")
    result = run(
        arguments.frames, arguments.calibration, arguments.output, arguments.engine,
        independent=arguments.independent, pictures=arguments.pictures, noise=arguments.noise,
        level=arguments.level, doubtful=arguments.doubtful)
    return 0 if result.ok else _UNUSABLE
