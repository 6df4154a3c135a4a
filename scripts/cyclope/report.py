"""``cyclope report``: a recording as one HTML file with pictures and measurements."""

from pathlib import Path

from model.errors import UserError
from scripts.cyclope.recording import add_recording_arguments, open_recording

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope report`` takes."""
    parser.description = (
        "Write a recording as one HTML file: its figures, pictures with spots and measured "
        "surface, and the measurements that `cyclope view` kept in measurements.csv beside it. "
        "The file needs no other. The same recording gives the same octets. Not a medical device.")
    add_recording_arguments(parser)
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FILE",
                        help="file to write, report.html")


def main(arguments):
    """Report with parsed arguments; gives the exit status."""
    from calibration.files import beside, check_output
    from scripts.view.measurements import Measurements
    from scripts.view.report import write_report

    recording = arguments.recording
    check_output(arguments.output)
    history = open_recording(arguments)
    if not history.count:
        raise UserError(f"{recording} has no frame, so there is nothing to report.")
    measured = Measurements(history, recording.with_name("measurements.csv")).plain()
    name = f"{recording.resolve().parent.name}/{recording.name}"
    with beside(arguments.output) as output:
        output.write(write_report(history, name, measured))
    print(f"report in {arguments.output}")
    return 0
