"""What ``cyclope calibrate --plan`` prints: how a mesh should be turned against the base."""

import re
from dataclasses import replace

import numpy as np

from calibration.capture import read_nominal
from calibration.plan import plan_mesh
from calibration.tables import SEPARATION_PX
from model.errors import UserError

__all__ = ["print_plan"]


def _mesh(nominal, text):
    """The nominal projector with another mesh that spans the same angle."""
    match = re.fullmatch(r"([0-9]{1,3})[x×]([0-9]{1,3})", text.strip().lower())
    rows, columns = (int(part) for part in match.groups()) if match else (0, 0)
    if not rows or not columns:
        raise UserError(f"--plan must be rows x columns, for instance 19x19, not '{text}'.")
    if (rows, columns) == (nominal.rows, nominal.columns):
        return nominal
    before, after = max(nominal.rows, nominal.columns) - 1, max(rows, columns) - 1
    pitch = nominal.pitch_deg
    if before and after:
        pitch = np.degrees(np.arctan(np.tan(np.radians(pitch)) * before / after))
    return replace(nominal, rows=rows, columns=columns, pitch_deg=float(pitch))


def _range(capture, nominal, depth_min, depth_max):
    """The depth range in mm: what was asked for, else that of the planes."""
    low, high = nominal["depth"] or (None, None)
    low = low if depth_min is None else depth_min
    high = high if depth_max is None else depth_max
    if low is None or high is None:
        raise UserError(f"{capture} has no planes/planes.csv to take the depth range from: add "
                        "--depth-min and --depth-max.")
    return low, high


def print_plan(capture, text, depth_min, depth_max):
    """Print the best rotations of a mesh; gives the exit status.

    Parameters
    ----------
    capture : :class:`pathlib.Path`
        Folder with a ``capture.toml``; planes and photographs may still be missing.
    text : :class:`str`
        Rows and columns of the mesh, ``19x19``.
    depth_min, depth_max : :class:`float` or None
        Depth range in mm; None is that of the plane frames.

    Returns
    -------
    :class:`int`
        0, or 3 if the lines of no rotation are far enough apart.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    nominal = read_nominal(capture)
    mesh = _mesh(nominal["projector"], text)
    low, high = _range(capture, nominal, depth_min, depth_max)
    plans = plan_mesh(nominal["width"], nominal["height"], nominal["focal_px"], mesh, low, high)
    table = Table(box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title=(
        f"A mesh of {mesh.rows} x {mesh.columns} beams, {mesh.pitch_deg:.3f} degrees apart, "
        f"{low:g} to {high:g} mm"))
    for name in ("rotation", "line separation", "spots apart", "always", "sometimes", "highlights"):
        table.add_column(name, justify="right", no_wrap=True)
    for plan in plans:
        table.add_row(
            f"{plan.projector.rotation_deg:.2f} deg",
            "no neighbour" if np.isinf(plan.separation_px) else f"{plan.separation_px:.2f} px",
            "-" if np.isinf(plan.pitch_px) else f"{plan.pitch_px:.1f} px",
            str(plan.always), str(plan.sometimes), f"{plan.chance:.1%}",
            style="" if plan.usable else "red")
    console = Console()
    console.print(table)
    best = plans[0]
    console.print(
        f"line separation: smallest vertical distance of two epipolar lines where spots of both "
        f"can be, at least {SEPARATION_PX:g} px is needed; spots apart: smallest distance of two "
        "spots on a flat target; always, sometimes: beams in the picture at every distance of the "
        "range, and at some; highlights: the chance that a random highlight in the picture is "
        "taken for a beam.", style="dim", highlight=False)
    if not best.usable:
        console.print(f"No rotation keeps the lines {SEPARATION_PX:g} px apart: use fewer beams, a "
                      "narrower depth range or a longer base.", highlight=False)
        return 3
    console.print(f"Set rotation_deg = {best.projector.rotation_deg:.2f} and pitch_deg = "
                  f"{best.projector.pitch_deg:.3f} in capture.toml, and turn the projector so.",
                  highlight=False)
    return 0
