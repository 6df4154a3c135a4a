"""``cyclope surface``: the surface of each frame of a recording as a file of its own."""

from pathlib import Path

from model.errors import UserError
from scripts.cyclope.recording import add_recording_arguments, open_recording

__all__ = ["add_arguments", "main"]

FORMATS = ("ply", "glb", "pcd")


def add_arguments(parser):
    """Declare what ``cyclope surface`` takes."""
    parser.description = (
        "Write the measured surface of the frames of a recording, each to a file of its own: PLY "
        "with normals, colours, time and triangles; GLB (glTF) with the picture on it; or PCD, the "
        "points of the PLY. "
        "They are the files that the page of `cyclope view` downloads. The same recording gives "
        "the same octets.")
    add_recording_arguments(parser)
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT",
                        help="folder to create")
    parser.add_argument("--format", choices=FORMATS, default="ply", help="default: ply")
    parser.add_argument("--from", dest="first", type=int, metavar="N",
                        help="number of the first frame; default: that of the recording")
    parser.add_argument("--to", dest="last", type=int, metavar="N",
                        help="number of the last frame; default: that of the recording")


def main(arguments):
    """Write with parsed arguments; gives the exit status."""
    import numpy as np

    from scripts.measure.formats import FORMATS as WRITERS
    from scripts.measure.surface import Surface
    from scripts.results.outputs import check_folder, new_folder
    from scripts.results.summary import plural

    check_folder(arguments.output)
    history = open_recording(arguments)
    write, _ = WRITERS[arguments.format]
    count = 0
    with new_folder(arguments.output) as folder:
        for position in range(history.first, history.count):
            moment = history.moment(position)
            index = moment.frame.index
            if not ((arguments.first is None or index >= arguments.first)
                    and (arguments.last is None or index <= arguments.last)):
                continue
            surface = Surface(moment.points, history.calibration)
            if not len(surface.points):
                continue
            picture, when = history.picture(position)
            (folder / f"frame-{index:04}.{arguments.format}").write_bytes(
                write(surface, picture, np.isfinite(when), moment.seconds))
            count += 1
        if not count:
            raise UserError(f"{arguments.recording} has no ok point in these frames, so there is "
                            "no surface to write.")
    print(f"{plural(count, 'surface')} in {arguments.output}")
    return 0
