"""``cyclope simulate``: a capture folder of a rig that does not exist."""

import os
import shutil
import tempfile
from pathlib import Path

from scripts.errors import UserError

__all__ = ["add_arguments", "main", "simulate"]


def add_arguments(parser):
    """Declare what ``cyclope simulate`` takes."""
    parser.description = (
        "Write a capture folder of a simulated rig: chessboard photographs, plane frames, frames "
        "to measure, and truth.csv with the exact truth of every beam.")
    parser.add_argument("kind", metavar="KIND",
                        help="what the frames show: plane, tilted, polyp, tube, or mixed")
    parser.add_argument("output", type=Path, metavar="OUT",
                        help="folder to create; it must not hold anything yet")
    parser.add_argument(
        "--rig", default="capsule",
        help="capsule (default; CIF, 5 mm base, 40-110 mm), demonstrator (CIF, 150 mm base, "
             "600-1100 mm) or small (64 x 64, 5 mm base)")
    parser.add_argument("--frames", type=int, default=8, metavar="N",
                        help="frames to measure (default: 8)")
    parser.add_argument("--seed", type=int, default=1, metavar="N",
                        help="another seed is another rig capture (default: 1)")


def simulate(kind, output, rig="capsule", frames=8, seed=1, progress=None):
    """Write a capture folder; nothing is left behind if that fails.

    Raises
    ------
    UserError
        If there is no such kind or rig, or the folder cannot be made or holds something.
    """
    from model.optics import capture, scenes
    from model.optics.rigs import RIGS

    output = Path(output)
    if rig not in RIGS:
        raise UserError(f"There is no rig '{rig}'; choose one of {', '.join(RIGS)}.")
    if kind not in scenes.KINDS:
        raise UserError(f"There is no scene of the kind '{kind}'; choose one of "
                        f"{', '.join(scenes.KINDS)}.")
    if not 1 <= frames <= 9999:
        raise UserError(f"--frames must be 1 to 9999, not {frames}.")
    if seed < 0:
        raise UserError(f"--seed must not be negative, and {seed} is.")
    if output.exists() and not output.is_dir():
        raise UserError(f"{output} is a file: name a folder that does not exist yet.")
    if output.is_dir() and any(output.iterdir()):
        raise UserError(f"{output} is not empty: name a folder that does not exist yet.")
    partial = None
    try:
        output.absolute().parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{output.name}-", dir=output.absolute().parent))
        partial.chmod(0o755)
        capture.write(RIGS[rig], kind, partial, frames, seed, progress)
        os.replace(partial, output)
    except OSError as error:
        raise UserError(f"{output} cannot be written: {error.strerror or error}.") from error
    finally:
        if partial is not None and partial.exists():
            shutil.rmtree(partial, ignore_errors=True)


def main(arguments):
    """Run with parsed arguments; gives the exit status."""
    from rich import progress
    from rich.console import Console

    errors = Console(stderr=True)
    with progress.Progress(
            progress.TextColumn("{task.description}"), progress.BarColumn(),
            progress.MofNCompleteColumn(), console=errors, transient=True,
            disable=not errors.is_terminal) as bar:
        task = bar.add_task("pictures", total=None)
        simulate(arguments.kind, arguments.output, arguments.rig, arguments.frames,
                 arguments.seed,
                 lambda done, total: bar.update(task, completed=done, total=total))
    print(f"capture in {arguments.output}")
    return 0
