"""Tables of a calibration's results, for the terminal."""

import math

from rich import box
from rich.table import Table

__all__ = ["beam_remarks", "beams_table", "summary_table"]

#: The largest error that the chip's undistortion is meant to have.
_UNDISTORTION_PX = 0.01


def _table(title):
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1),
                  pad_edge=False)
    table.add_column("")
    return table


def _names(names, limit=6):
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


def _offset_words(offset):
    """What was done about a constant error of the planes' distances."""
    sigma = f"+-{offset.sigma_mm:.3f} mm"
    if offset.correction_mm:
        return (f"{sigma}; added to every z_mm of planes.csv: z counts from the pinhole. A wrong "
                "scale of z_mm cannot be seen")
    return f"{sigma}; no constant error of z_mm is visible. A wrong scale of z_mm cannot be seen"


def summary_table(result):
    """The main figures of a :class:`calibration.calibrate.Result`."""
    calibration, lens, lines = result.calibration, result.lens_report, result.lines
    fitted, windows, budget = result.identity.projector, result.windows, calibration.budget
    table = _table("Calibration")
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("meaning", style="dim")
    left = [f"{len(lens.used)} chessboards used"]
    if lens.without_board:
        left.append(f"no complete board in {_names(lens.without_board)}")
    if lens.outliers:
        left.append(f"left out as outliers: {_names(lens.outliers)}")
    camera = calibration.lens
    table.add_row("lens", f"{lens.rms_px:.3f} px RMS", "; ".join(left))
    table.add_row("focal length", f"{camera.focal:.2f} px",
                  f"principal point {camera.principal_u:.2f}, {camera.principal_v:.2f}")
    table.add_row("distortion", f"{camera.k1:+.4f} {camera.k2:+.4f}",
                  f"k1 k2; p1 p2 {camera.p1:+.5f} {camera.p2:+.5f}")
    table.add_section()
    base = ", ".join(f"{part:.3f}" for part in fitted.base_mm)
    margin = result.identity.margin
    table.add_row("spots", f"{100 * result.identity.matched:.1f} %",
                  f"of those expected in {len(result.planes)} plane frames were found; "
                  + ("no other numbering is possible" if math.isinf(margin) else
                     f"any other numbering leaves {margin:.0f} more unexplained"))
    table.add_row("base", f"{base} mm",
                  f"fitted; pitch {fitted.pitch_deg:.3f}, rotation {fitted.rotation_deg:.2f}, "
                  f"toe-in {fitted.toe_in_deg:.2f} degrees")
    table.add_row("lines", f"{lines.rms_px:.3f} px RMS",
                  f"distance of the spots from their lines; {lines.outliers} outliers left out")
    worst = int(lines.residual_v.argmax())
    table.add_row("worst beam", f"{lines.residual_v[worst]:.3f} px RMS",
                  f"beam {lines.numbers[worst]}; every beam that is used was found in "
                  f"{int(lines.planes.min())} planes or more")
    if calibration.left_out:
        table.add_row("left out", f"{len(calibration.left_out)} beams",
                      "no spot will match them: "
                      + _names([str(beam) for beam in calibration.left_out], 12))
    table.add_row("held out", f"{budget['held_out_px']:.3f} px RMS",
                  "error along u of each plane predicted from the others"
                  f" ({budget['held_out_free_px']:.3f} px with every beam on its own)")
    table.add_row("plane offset", f"{result.offset.mm:+.3f} mm", _offset_words(result.offset))
    smallest = windows.smallest_px
    table.add_row("line separation",
                  "no neighbour" if math.isinf(smallest) else f"{smallest:.2f} px",
                  f"smallest where windows overlap; {windows.smallest_whole_px:.2f} px without "
                  "windows")
    table.add_row("depth range", f"{windows.z_min:.0f} to {windows.z_max:.0f} mm",
                  f"tolerance {windows.tolerance.min():.2f} to {windows.tolerance.max():.2f} px")
    table.add_row("depth error", f"{100 * budget['expected_depth_relative']:.3f} %",
                  "expected mean over the depth range, from the noise of the centres")
    table.add_section()
    table.add_row("centre", f"{budget['centre_px']:.4f} px", "largest rounding error")
    within = budget["undistortion_px"] <= _UNDISTORTION_PX
    table.add_row("undistortion", f"{budget['undistortion_px']:.4f} px",
                  "largest rounding error within the image" if within else
                  f"[bold red]largest within the image, above {_UNDISTORTION_PX:g} px: the lens's "
                  "tangential distortion is too strong for the chip[/bold red]")
    table.add_row("line", f"{budget['line_px']:.4f} px",
                  "largest rounding error within the windows")
    table.add_row("1/z", f"{budget['depth_relative']:.1e}",
                  "largest relative rounding error within the windows")
    return table


def beams_table(result):
    """RMS distance of each beam's spots from its line, laid out as the mesh."""
    calibration, lines = result.calibration, result.lines
    index = {number: index for index, number in enumerate(lines.numbers.tolist())}
    table = _table("RMS distance of the spots from their line, 1/1000 px (planes)")
    for column in range(calibration.columns):
        table.add_column(str(column), justify="right", no_wrap=True)
    usual = float(sorted(lines.residual_v)[len(lines.residual_v) // 2])
    for row in range(calibration.rows):
        cells = []
        for column in range(calibration.columns):
            beam = row * calibration.columns + column
            if beam not in index:
                cells.append("[bold red]none[/bold red]")
                continue
            residual = lines.residual_v[index[beam]]
            style = "bold red" if residual > 4 * usual else "yellow" if residual > 2 * usual else ""
            text = f"{1000 * residual:.0f} [dim]({int(lines.planes[index[beam]])})[/dim]"
            cells.append(f"[{style}]{text}[/{style}]" if style else text)
        table.add_row(str(row), *cells)
    return table


def beam_remarks(result):
    """A sentence for each beam that was left out or is unusual."""
    calibration = result.calibration
    return [f"Beam {beam} (row {beam // calibration.columns}, column "
            f"{beam % calibration.columns}): {text}."
            for beam, text in sorted(calibration.remarks.items())]
