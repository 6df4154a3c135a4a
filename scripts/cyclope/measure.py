"""``cyclope measure``: lengths on the surface, and the size of a polyp."""

import json
from pathlib import Path

from model.errors import UserError

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope measure`` takes."""
    parser.description = (
        "Measure on the surface of a frame: the distance between two points, or the longest "
        "diameter and the height of a polyp whose rim is marked. Points are given in pixels of "
        "the picture. Every length comes with its uncertainty of 68 %, in which the choice of the "
        "points is not included. Not a medical device.")
    parser.epilog = (
        "The page of `cyclope view` gives the same numbers. A polyp's size class is that of its "
        "longest diameter in whole millimetres.")
    parser.add_argument("source", type=Path, metavar="RESULT|RECORDING",
                        help="folder of `cyclope run` or `cyclope receive`, or a link.raw")
    parser.add_argument("--calibration", type=Path, required=True, metavar="FILE",
                        help="calibration.json that the points were measured with")
    parser.add_argument("--frame", type=int, required=True, metavar="N", help="number of the frame")
    parser.add_argument("--mean", type=int, default=1, metavar="N",
                        help="mean of so many measured frames, from that one on, if neither scene "
                             "nor camera moves")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--points", nargs=2, metavar="U,V", help="distance between two points")
    what.add_argument("--polyp", nargs="+", metavar="U,V",
                      help="polyp with three points or more on its rim")
    what.add_argument("--circle", metavar="U,V,R", help="polyp with a circle for its rim")
    parser.add_argument("--format", choices=("text", "json", "csv"), default="text",
                        help="what to print; default: text")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE",
                        help="write to FILE.json or FILE.csv instead")


def _numbers(text, count, option):
    """Numbers between commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(-1e5 < value < 1e5 for value in values):
        raise UserError(f"{option} takes {count} numbers with commas between them, such as "
                        f"{','.join(['120.5', '88', '15'][:count])}, not {text[:40]!r}.")
    return values


def _marks(arguments):
    """Kind of the measurement, and its marks."""
    from scripts.measure.polyp import circle
    if arguments.points is not None:
        return "ruler", [_numbers(text, 2, "--points") for text in arguments.points]
    if arguments.polyp is not None:
        return "polyp", [_numbers(text, 2, "--polyp") for text in arguments.polyp]
    u, v, radius = _numbers(arguments.circle, 3, "--circle")
    if radius <= 0:
        raise UserError(f"The radius of --circle must be above 0, not {radius:g}.")
    return "polyp", circle(u, v, radius)


def _frames_of_folder(folder):
    """Numbers of a result's frames, in their order, and what gives the rows of one."""
    from scripts.results.accuracy import load_points
    path = folder / "points.csv"
    if not path.exists():
        raise UserError(f"{folder} holds no points.csv: name a folder of `cyclope run` or `cyclope "
                        "receive`, or a link.raw.")
    points = load_points(path)
    known = sorted(set(points["frame"].tolist()))
    return known, lambda at: points[points["frame"] == known[at]]


def _frames(source, calibration):
    """As :func:`_frames_of_folder`, of a folder or a recording."""
    if source.is_dir():
        return _frames_of_folder(source)
    if not source.exists():
        raise UserError(f"{source} does not exist.")
    if not source.is_file():
        raise UserError(f"{source} is neither a folder nor a recording.")
    from scripts.host.history import read_history
    history = read_history(source, calibration)
    return history.numbers().tolist(), lambda at: history.moment(at).points


def _chosen(frames, number, count, source):
    """Rows of the frames to measure."""
    known, rows = frames
    if number not in known:
        raise UserError(f"{source} has no points of frame {number}" + (
            f": its frames are numbered {known[0]} to {known[-1]}, and some may be missing."
            if known else ", nor of any other one."))
    at = known.index(number)
    return [rows(each) for each in range(at, min(at + count, len(known)))]


def main(arguments):
    """Measure with parsed arguments; gives the exit status."""
    from calibration import file
    from calibration.files import beside, check_output
    from scripts.measure.records import CSV_HEADER, measure_frames
    from scripts.measure.surface import Surface

    if not 1 <= arguments.mean <= 1000:
        raise UserError(f"--mean must be 1 to 1000, not {arguments.mean}.")
    kind, marks = _marks(arguments)
    style = arguments.format
    if arguments.output is not None:
        style = arguments.output.suffix[1:].lower()
        if style not in ("json", "csv"):
            raise UserError(f"-o takes the name of a .json or a .csv, not {arguments.output}.")
        check_output(arguments.output)
    calibration = file.load(arguments.calibration)
    frames = _frames(arguments.source, calibration)
    chosen = _chosen(frames, arguments.frame, arguments.mean, arguments.source)
    for points in chosen:
        if points["beam"].max(initial=0) >= len(calibration.beams):
            raise UserError(f"{arguments.source} has points of more beams than the calibration: "
                            "name the one that they were measured with.")
    record = measure_frames([Surface(points, calibration) for points in chosen], kind, marks)
    text = {"json": lambda: json.dumps(record.plain(), indent=1),
            "csv": lambda: f"{CSV_HEADER}\n{record.row()}",
            "text": lambda: "\n".join([record.sentence(), *(f"! {note}" for note in record.notes)])}
    if arguments.output is None:
        print(text[style]())
        return 0
    with beside(arguments.output) as output:
        output.write((text[style]() + "\n").encode())
    print(record.sentence())
    return 0
