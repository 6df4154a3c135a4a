"""``cyclope calibrate``: calibrate a rig from its capture folder."""

import re
from pathlib import Path

from hdl.protocol import MEAN_WINDOW_PIXELS
from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope calibrate`` takes."""
    parser.description = (
        "Calibrate a rig from a capture folder: the lens from lens/, the beams from planes/. "
        "Writes the calibration and, beside it, a plot of lines and residuals.")
    parser.epilog = (
        "Levels, centre and area are stored in the calibration: frames are measured with the same "
        "settings as the planes.")
    parser.add_argument("capture", type=Path, metavar="CAPTURE", help="the capture folder")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE",
                        help="calibration to write, calibration.json")
    parser.add_argument(
        "--plan", metavar="ROWSxCOLUMNS",
        help="calibrate nothing: print how such a mesh should be turned against the base, from "
             "the nominal values in capture.toml, for --depth-min to --depth-max (default: those "
             "of the planes). The mesh spans the same angle as the one in capture.toml")
    parser.add_argument(
        "--preset", choices=("capsule", "paper"), default="capsule",
        help="the design that will measure: capsule (default), or paper, which undistorts whole "
             "images with a table and uses binary centres of eroded spots")
    parser.add_argument(
        "--centre", choices=("weighted", "binary"),
        help="weight each pixel by its grey value above the lit level (default), or all equally")
    capsule = parser.add_argument_group(
        "preset capsule", "pixels against the mean of a window around them, in multiples of the "
        "noise below it")
    capsule.add_argument(
        "--noise", default="adaptive", metavar="GREY|adaptive",
        help="fixed noise in grey values, 0.125 to 63.8, or learnt on the frame before (default)")
    capsule.add_argument("--lit", type=float, metavar="X",
                         help="a pixel is lit from this multiple on, 0.0625 to 3.9")
    capsule.add_argument(
        "--core", type=float, metavar="X",
        help="a spot has a pixel that reaches this multiple in the smoothed image, 0.0625 to 3.9")
    capsule.add_argument(
        "--dent", type=float, metavar="X",
        help="a pixel parts two spots if it lies by this multiple below both, 0 to 3.9; 0: never")
    capsule.add_argument(
        "--window", type=int, metavar="N",
        help="side of the window in pixels, odd, 5 to 31: that of the chip")
    capsule.add_argument(
        "--saturation", type=int, metavar="N",
        help="grey value from which on a pixel is saturated, 1 to 255 (default 255)")
    paper = parser.add_argument_group("preset paper")
    paper.add_argument(
        "--threshold", metavar="N|adaptive",
        help="fixed grey level, 1 to 255, or set from the histogram of each frame (default)")
    paper.add_argument(
        "--alpha", type=float, metavar="X",
        help="adaptive threshold: standard deviations above the background's mean, 0 to 15.9")
    paper.add_argument(
        "--erosion", choices=("off", "erode", "gate"),
        help="erode (default): the eroded mask, as in the paper; gate: a spot is a component that "
             "a 3x3 erosion leaves something of; off")
    parser.add_argument("--area-min", type=int, metavar="N", help="smallest spot, in pixels")
    parser.add_argument("--area-max", type=int, metavar="N",
                        help="largest spot, in pixels, up to 1023")
    parser.add_argument("--depth-min", type=float, metavar="MM",
                        help="nearest distance to measure (default: the nearest plane)")
    parser.add_argument("--depth-max", type=float, metavar="MM",
                        help="farthest distance to measure (default: the farthest plane)")
    parser.add_argument(
        "--dead", nargs="+", action="extend", default=[], metavar="ROW,COLUMN",
        help="beams without light, counted from 0, besides those of dead in capture.toml: they "
             "are not looked for, even a whole row or column")
    parser.add_argument("--no-picture", dest="picture", action="store_false",
                        help="do not write the plot")


_CAPSULE = ("noise", "lit", "core", "dent", "window", "saturation")
_PAPER = ("threshold", "alpha", "erosion")


def _capsule_choices(arguments):
    """Levels of the preset ``capsule``, checked."""
    choices = {}
    if arguments.noise != "adaptive":
        try:
            noise = float(arguments.noise) * 8
        except ValueError:
            noise = 0.0
        if not 0.5 < noise < 511.5:
            raise UserError(f"--noise must be 0.125 to 63.8 or 'adaptive', not "
                            f"'{arguments.noise}'.")
        choices["fixed_noise"] = round(noise)
    for name, least in (("lit", 1), ("core", 1), ("dent", 0)):
        value = getattr(arguments, name)
        if value is not None:
            if not least - 0.5 <= value * 16 < 63.5 or value < 0:
                raise UserError(f"--{name} must be {least / 16:g} to 3.9, not {value:g}.")
            choices[f"{name}_gain"] = round(value * 16)
    if arguments.window is not None:
        least, most = MEAN_WINDOW_PIXELS
        if not least <= arguments.window <= most or arguments.window % 2 == 0:
            raise UserError(f"--window must be odd and {least} to {most}, not {arguments.window}.")
        choices["mean_window"] = arguments.window
    if arguments.saturation is not None:
        if not 1 <= arguments.saturation <= 255:
            raise UserError(f"--saturation must be 1 to 255, not {arguments.saturation}.")
        choices["saturation"] = arguments.saturation
    return choices


def _paper_choices(arguments):
    """Threshold and erosion of the preset ``paper``, checked."""
    if arguments.centre == "weighted":
        raise UserError("--preset paper has binary centres only: leave out --centre.")
    choices = {"erosion": arguments.erosion or "erode", "weighted": False, "area_min": 3}
    if arguments.threshold not in (None, "adaptive"):
        if not (arguments.threshold.isascii() and arguments.threshold.isdigit()
                and 1 <= int(arguments.threshold) <= 255):
            raise UserError(f"--threshold must be 1 to 255 or 'adaptive', not "
                            f"'{arguments.threshold}'.")
        choices["level_fixed"] = int(arguments.threshold)
    if arguments.alpha is not None:
        if not 0 <= arguments.alpha * 16 < 255.5:
            raise UserError(f"--alpha must be 0 to 15.9, not {arguments.alpha:g}.")
        choices["threshold_alpha"] = round(arguments.alpha * 16)
    return choices


def _settings(arguments):
    """Settings with the user's choices, checked."""
    from model.preprocessing.area import LARGEST_AREA
    from model.settings import Settings

    paper = arguments.preset == "paper"
    for name in _CAPSULE if paper else _PAPER:
        if getattr(arguments, name) not in (None, "adaptive"):
            raise UserError(f"--{name} is for the preset {'capsule' if paper else 'paper'} only: "
                            f"leave it out, or choose another --preset.")
    choices = _paper_choices(arguments) if paper else _capsule_choices(arguments)
    if arguments.centre is not None:
        choices["weighted"] = arguments.centre == "weighted"
    for name in ("area_min", "area_max"):
        value = getattr(arguments, name)
        if value is not None:
            if not 1 <= value <= LARGEST_AREA:
                raise UserError(f"--{name.replace('_', '-')} must be 1 to {LARGEST_AREA}, not "
                                f"{value}.")
            choices[name] = value
    settings = Settings(**choices)
    if settings.area_min > settings.area_max:
        raise UserError(f"--area-min must not be above --area-max ({settings.area_min} and "
                        f"{settings.area_max} pixels).")
    return settings


def _dead(texts, mesh):
    """Numbers of the beams that the user knows to be dead."""
    beams = set()
    for text in texts:
        match = re.fullmatch(r"(\d{1,3}),(\d{1,3})", text, re.ASCII)
        row, column = (int(part) for part in match.groups()) if match else (-1, -1)
        if not (0 <= row < mesh.rows and 0 <= column < mesh.columns):
            raise UserError(f"--dead must be ROW,COLUMN, counted from 0, of the {mesh.rows} x "
                            f"{mesh.columns} mesh, not '{text}'.")
        beams.add(row * mesh.columns + column)
    return frozenset(beams)


def _check_depths(arguments):
    """Refuse distances that are none."""
    from calibration.capture import MOST_MM

    for name in ("depth_min", "depth_max"):
        value = getattr(arguments, name)
        if value is not None and not 0 < value <= MOST_MM:
            raise UserError(f"--{name.replace('_', '-')} must be above 0 and up to {MOST_MM} mm, "
                            f"not {value:g}.")


def main(arguments):
    """Run with parsed arguments; gives the exit status."""
    require("calibration", "`cyclope calibrate`")
    from rich import progress
    from rich.console import Console

    from calibration.capture import read_capture
    from calibration.files import check_output

    _check_depths(arguments)
    if arguments.plan is not None:
        from scripts.cyclope.mesh_plan import print_plan
        return print_plan(arguments.capture, arguments.plan, arguments.depth_min,
                          arguments.depth_max)
    output = arguments.output
    if output is None:
        raise UserError("`cyclope calibrate` needs the calibration to write: add -o FILE.")
    if output.is_dir():
        raise UserError(f"{output} is a folder: name a file, for instance "
                        f"{output / 'calibration.json'}.")
    check_output(output)
    if arguments.picture and output.suffix.lower() == ".png":
        raise UserError(f"{output} would be the calibration and its picture in one: name it "
                        f"{output.with_suffix('.json')}.")
    settings = _settings(arguments)

    from calibration.calibrate import Options, calibrate
    from calibration.figures import health
    from calibration.file import save
    from calibration.report import beam_remarks, beams_table, summary_table

    capture = read_capture(arguments.capture)
    options = Options(settings=settings, depth_min=arguments.depth_min,
                      depth_max=arguments.depth_max, remapped=arguments.preset == "paper",
                      dead=_dead(arguments.dead, capture.projector))
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
