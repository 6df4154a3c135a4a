"""``cyclope calibrate``: calibrate a rig from its capture folder."""

from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope calibrate`` takes."""
    parser.description = (
        "Calibrate a rig from a capture folder: the lens from lens/, the beams from planes/. "
        "Writes the calibration and, beside it, a plot of lines and residuals.")
    parser.epilog = (
        "Threshold, erosion, centre and area are stored in the calibration: frames are measured "
        "with the same settings as the planes.")
    parser.add_argument("capture", type=Path, metavar="CAPTURE", help="the capture folder")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FILE",
                        help="calibration to write, calibration.json")
    parser.add_argument(
        "--threshold", default="adaptive", metavar="N|adaptive",
        help="fixed grey level, 1 to 255, or set from the histogram of each frame (default)")
    parser.add_argument(
        "--alpha", type=float, metavar="X",
        help="adaptive threshold: standard deviations above the background's mean, 0 to 15.9")
    parser.add_argument(
        "--erosion", choices=("off", "erode", "gate"),
        help="gate (default): a spot is a component that a 3x3 erosion leaves something of; "
             "erode: the eroded mask, as in the paper; off")
    parser.add_argument(
        "--centre", choices=("weighted", "binary"),
        help="weight each pixel by its grey value above the threshold (default), or all equally")
    parser.add_argument(
        "--preset", choices=("capsule", "paper"), default="capsule",
        help="the design that will measure: capsule (default), or paper, which undistorts whole "
             "images with a table and uses binary centres of eroded spots")
    parser.add_argument("--area-min", type=int, metavar="N", help="smallest spot, in pixels")
    parser.add_argument("--area-max", type=int, metavar="N",
                        help="largest spot, in pixels, up to 255")
    parser.add_argument("--depth-min", type=float, metavar="MM",
                        help="nearest distance to measure (default: the nearest plane)")
    parser.add_argument("--depth-max", type=float, metavar="MM",
                        help="farthest distance to measure (default: the farthest plane)")
    parser.add_argument("--no-picture", dest="picture", action="store_false",
                        help="do not write the plot")


def _settings(arguments):
    """Settings with the user's choices, checked."""
    from model.settings import Settings
    choices = {}
    if arguments.preset == "paper":
        if arguments.centre == "weighted":
            raise UserError("--preset paper has binary centres only: leave out --centre.")
        choices.update(erosion="erode", weighted=False)
    if arguments.threshold != "adaptive":
        if not (arguments.threshold.isascii() and arguments.threshold.isdigit()
                and 1 <= int(arguments.threshold) <= 255):
            raise UserError(f"--threshold must be 1 to 255 or 'adaptive', not "
                            f"'{arguments.threshold}'.")
        choices["level_fixed"] = int(arguments.threshold)
    if arguments.alpha is not None:
        if not 0 <= arguments.alpha * 16 < 255.5:
            raise UserError(f"--alpha must be 0 to 15.9, not {arguments.alpha:g}.")
        choices["threshold_alpha"] = round(arguments.alpha * 16)
    if arguments.erosion is not None:
        choices["erosion"] = arguments.erosion
    if arguments.centre is not None:
        choices["weighted"] = arguments.centre == "weighted"
    for name in ("area_min", "area_max"):
        value = getattr(arguments, name)
        if value is not None:
            if not 1 <= value <= 255:
                raise UserError(f"--{name.replace('_', '-')} must be 1 to 255, not {value}.")
            choices[name] = value
    settings = Settings(**choices)
    if settings.area_min > settings.area_max:
        raise UserError(f"--area-min must not be above --area-max ({settings.area_min} and "
                        f"{settings.area_max} pixels).")
    return settings


def main(arguments):
    """Run with parsed arguments; gives the exit status."""
    require("calibration", "`cyclope calibrate`")
    from rich import progress
    from rich.console import Console

    from calibration.capture import MOST_MM, read_capture
    from calibration.files import check_output

    output = arguments.output
    if output.is_dir():
        raise UserError(f"{output} is a folder: name a file, for instance "
                        f"{output / 'calibration.json'}.")
    check_output(output)
    if arguments.picture and output.suffix.lower() == ".png":
        raise UserError(f"{output} would be the calibration and its picture in one: name it "
                        f"{output.with_suffix('.json')}.")
    settings = _settings(arguments)
    for name in ("depth_min", "depth_max"):
        value = getattr(arguments, name)
        if value is not None and not 0 < value <= MOST_MM:
            raise UserError(f"--{name.replace('_', '-')} must be above 0 and up to {MOST_MM} mm, "
                            f"not {value:g}.")

    from calibration.calibrate import Options, calibrate
    from calibration.figures import health
    from calibration.file import save
    from calibration.report import beam_remarks, beams_table, summary_table

    capture = read_capture(arguments.capture)
    options = Options(settings=settings, depth_min=arguments.depth_min,
                      depth_max=arguments.depth_max, remapped=arguments.preset == "paper")
    console, errors = Console(), Console(stderr=True)
    bar = progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.MofNCompleteColumn(), console=errors, transient=True,
        disable=not errors.is_terminal)
    with bar:
        tasks = {}

        def step(phase, done, total):
            if phase not in tasks:
                tasks[phase] = bar.add_task(phase, total=total)
            bar.update(tasks[phase], completed=done)

        result = calibrate(capture, options, step)
        picture = output.with_suffix(".png")
        if arguments.picture:
            from calibration.plots import write
            step("drawing", 0, None)
            write(result, picture)
        save(result.calibration, output)
    console.print(summary_table(result))
    console.print(beams_table(result))
    for note in [*result.lens_report.flags, *beam_remarks(result), *capture.notes]:
        console.print(f"! {note}", style="yellow", markup=False, highlight=False)
    console.print(health(result), highlight=False, markup=False)
    written = f"{output}" + (f" and {picture}" if arguments.picture else "")
    console.print(f"calibration in {written}", highlight=False, markup=False)
    return 0
