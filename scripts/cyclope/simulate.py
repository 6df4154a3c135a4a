"""``cyclope simulate``: write a capture folder of a simulated rig."""

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

from model.bayer import BAYER
from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["KINDS", "RIGS", "add_arguments", "main"]

_MOST_FRAMES = 10000
KINDS = ("plane", "tilted", "polyp", "tube", "mixed", "tissue")
RIGS = ("endoscope", "demonstrator", "small", "dense", "vga")


def add_arguments(parser):
    """Declare what ``cyclope simulate`` takes."""
    parser.description = (
        "Write a capture folder as a rig would record it: chessboard photographs, plane\n"
        "frames, frames to measure with their texture, nominal values that are not quite\n"
        "right, and the truth. The same arguments give the same bytes.")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        "kinds:\n"
        "  plane   flat targets square to the axis, at other distances than the calibration's\n"
        "  tilted  flat targets tilted by up to 35 degrees\n"
        "  polyp   domes and stalked polyps on a gut wall\n"
        "  tube    a gut with haustral folds, seen obliquely\n"
        "  mixed   one of each in turn\n"
        "  tissue  tilted, polyp and tube in turn, under --ramp 40 --highlights 4 --speckle 12\n"
        "          --dim 0.15; options change single ones\n"
        "rigs:\n"
        "  endoscope     352 x 288,  7 x 7 beams,   5 mm base,   40 to  110 mm\n"
        "  demonstrator  352 x 288,  7 x 7 beams, 150 mm base,  600 to 1100 mm\n"
        "  small          64 x 64,   4 x 4 beams,   5 mm base,   40 to  110 mm\n"
        "  dense         352 x 288, 19 x 19 beams,  5 mm base,   40 to  110 mm\n")
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help="what the rig looks at")
    parser.add_argument("output", type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument("--rig", choices=RIGS, default="endoscope", help="default: endoscope")
    parser.add_argument("--bayer", choices=BAYER,
                        help="pattern of the sensor's colour filters: textures in colour, and "
                             "a response to the laser that differs by 5 %% between colours")
    parser.add_argument("--seed", type=int, default=0, metavar="N",
                        help="seed of all random numbers, 0 or more; default: 0")
    parser.add_argument("--frames", type=int, default=10, metavar="N",
                        help="frames to measure; default: 10")
    parser.add_argument("--split-spots", action="store_true",
                        help="follow many rays of each beam: spots are bent by curved surfaces and "
                             "torn by edges, instead of ellipses around the beam's axis; slower")
    frames = parser.add_argument_group(
        "conditions of the frames to measure",
        "truth.csv then also says which spots are visible, which beams are dead, and the factor "
        "on their light")
    rig = parser.add_argument_group("faults of the rig, in the plane frames too")
    for group, conditions in ((frames, _OF_FRAMES), (rig, _OF_RIG)):
        for name, (metavar, words) in conditions.items():
            group.add_argument(
                f"--{name}", type=int if metavar == "N" else float, metavar=metavar, help=words)


#: Names, units and meanings of the conditions, see :class:`model.optics.conditions.Conditions`.
_OF_FRAMES = {
    "ramp": ("LEVELS", "light that grows by so many levels across the picture"),
    "pool": ("LEVELS", "a pool of light with so many levels at its middle"),
    "flicker": ("LEVELS", "background that is brighter by so many levels in every other frame"),
    "highlights": ("N", "wet highlights in each frame, saturated"),
    "speckle": ("N", "speckle of so many looks: contrast 1 / sqrt(N); 1 is full contrast"),
    "light": ("FACTOR", "factor on the laser's light"),
    "dim": ("SHARE", "share of the beams of each frame, 0 to 1, that have a third of their light"),
    "defocus": ("PX", "diameter of the circle of confusion"),
    "motion": ("PX", "movement during the exposure"),
    "gain": ("FACTOR", "factor on the grey values after conversion: gaps, and saturation"),
}
_OF_RIG = {
    "dead": ("N", "beams without light"),
    "overbright": ("N", "beams with ten times their light"),
    "hot-pixels": ("N", "pixels of 60 to 300 levels too many; in photographs and textures too"),
    "bits": ("N", "bits of a grey value, 1 to 8; in photographs and textures too"),
}


def _conditions(arguments):
    """The conditions that were asked for; refuses values that make no sense."""
    from model.optics.conditions import LIMITS, conditions_of

    names = [name.replace("-", "_") for name in (*_OF_FRAMES, *_OF_RIG)]
    chosen = {name: getattr(arguments, name) for name in names}
    for name, value in chosen.items():
        low, high, _ = LIMITS[name]
        if value is not None and not low <= value <= high:
            raise UserError(
                f"--{name.replace('_', '-')} must be {low} to {high}, not {value:g}.")
    return conditions_of(arguments.kind, arguments.seed, **chosen)


def _check_room(output, most):
    """Refuse what does not fit on the disk, before hours are spent on it."""
    folder = output.absolute()
    while not folder.is_dir():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if most > free:
        raise UserError(f"That is a capture of up to {most / 1e6:.0f} MB, and {folder} has "
                        f"{free / 1e6:.0f} MB left: ask for fewer --frames.")


def main(arguments):
    """Write the folder; gives the exit status."""
    if arguments.seed < 0:
        raise UserError(f"--seed must be 0 or more, not {arguments.seed}.")
    if not 1 <= arguments.frames <= _MOST_FRAMES:
        raise UserError(f"--frames must be 1 to {_MOST_FRAMES}, not {arguments.frames}.")

    require("calibration", "`cyclope simulate`")
    from scripts.results.outputs import check_folder, new_folder
    check_folder(arguments.output)

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from model.optics import capture
    from model.optics.rigs import RIGS

    rig, conditions = RIGS[arguments.rig], _conditions(arguments)
    conditions.beam_light(rig.projector.beams, 0)
    rig = replace(rig.with_filters(arguments.bayer),
                  spots=replace(rig.spots, split=arguments.split_spots))
    _check_room(arguments.output, capture.most_octets(rig, arguments.frames))
    errors = Console(stderr=True)
    bar = Progress(TextColumn("simulating {task.description}"), BarColumn(), MofNCompleteColumn(),
                   console=errors, transient=True, disable=not errors.is_terminal)
    with new_folder(arguments.output) as folder, bar:
        task = bar.add_task("lens", total=capture.image_count(arguments.frames))
        capture.write(folder, arguments.kind, rig, arguments.seed, arguments.frames,
                      progress=lambda name: bar.update(task, advance=1, description=name),
                      conditions=conditions)
    print(f"{arguments.frames} frames of a simulated {arguments.rig} rig in {arguments.output}")
    return 0
