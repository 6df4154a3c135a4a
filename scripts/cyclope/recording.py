"""The recording that a command works on: its arguments, and its frames."""

import stat
from pathlib import Path

from model.errors import UserError

__all__ = ["add_recording_arguments", "is_recording", "open_recording"]


def add_recording_arguments(parser):
    """Declare RECORDING and ``--calibration``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING",
                        help="link.raw of `cyclope receive` or `cyclope view`")
    parser.add_argument("--calibration", type=Path, required=True, metavar="FILE",
                        help="calibration.json that the chip was loaded with")


def open_recording(arguments):
    """The :class:`scripts.host.history.History` of the recording.

    Raises :class:`model.errors.UserError` if calibration or recording cannot be used.
    """
    from calibration import file
    from scripts.host.history import read_history

    calibration = file.load(arguments.calibration)
    if not arguments.recording.is_file():
        raise UserError(f"{arguments.recording} is no recording: name a link.raw.")
    return read_history(arguments.recording, calibration)


def is_recording(source):
    """Whether what is named as PORT|RECORDING is a recording.

    Raises :class:`model.errors.UserError` if it is a folder.
    """
    try:
        mode = Path(source).stat().st_mode if "://" not in source else None
    except (OSError, ValueError):
        return False
    if mode is not None and stat.S_ISDIR(mode):
        raise UserError(f"{source} is a folder: name a serial device or a recording.")
    return mode is not None and stat.S_ISREG(mode)
