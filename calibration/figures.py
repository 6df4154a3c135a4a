"""The figures of a calibration, each with the range where it is good, and the health line."""

import math
from dataclasses import dataclass

from calibration.chessboards import FLAGGED_FOCAL
from calibration.files import list_names
from hdl.protocol import SMALL_SENSOR
from model.preprocessing.centre import lsb_px

__all__ = ["Figure", "figures", "health"]

#: Photographs, and beams, that a row names at the most.
_NAMED, _NAMED_BEAMS = 6, 12
#: Largest good values: lens and lines in px, error of the depth a share.
_LENS_PX, _LINES_PX, _HELD_OUT_PX, _DEPTH = 0.5, 0.1, 0.15, 0.005
#: Least good values: share of the spots, px between lines.
_SPOTS, _SEPARATION_PX = 0.95, 1.5
#: The largest errors that the chip's arithmetic is meant to have; those in px twice as large where
#: coordinates have a fraction bit less.
_CENTRE_PX, _UNDISTORTION_PX, _LINE_PX, _INVERSE_Z = 0.005, 0.01, 0.003, 1e-4


@dataclass(frozen=True)
class Figure:
    """A row of the report.

    Parameters
    ----------
    name, value, meaning : :class:`str`
        What it is, as text.
    good : :class:`bool`
        Whether it is within its range; True where there is none.
    range : :class:`str`
        The range in words, empty where there is none.
    section : :class:`bool`
        Whether a section of the report ends here.
    """

    name: str
    value: str
    meaning: str
    good: bool = True
    range: str = ""
    section: bool = False


def _lens(calibration, report):
    """Rows of the lens."""
    left = [f"{len(report.used)} chessboards used"]
    if report.without_board:
        left.append(f"no complete board in {list_names(report.without_board, _NAMED)}")
    if report.outliers:
        left.append(f"left out as outliers: {list_names(report.outliers, _NAMED)}")
    lens = calibration.lens
    words = {"brown": "polynomial of the radius", "equidistant": "fisheye: polynomial of the angle"}
    region = "the whole picture"
    if lens.usable_px is not None:
        region = (f"up to that distance from {lens.principal_u:.0f}, {lens.principal_v:.0f}; spots "
                  f"beyond are not used (the farthest corner is {lens.corner_px:.0f} px away)")
    focal_good = report.focal_sigma <= FLAGGED_FOCAL
    return [
        Figure("lens", f"{report.rms_px:.3f} px RMS", "; ".join(left),
               report.rms_px <= _LENS_PX, f"below {_LENS_PX} px"),
        Figure("focal length", f"{lens.focal:.2f} px",
               f"+-{report.focal_sigma:.2%}; principal point {lens.principal_u:.2f}, "
               f"{lens.principal_v:.2f} +-{report.principal_sigma_px:.2f} px", focal_good,
               f"known to {FLAGGED_FOCAL:.0%}"),
        Figure("distortion", f"{lens.k1:+.4f} {lens.k2:+.4f}",
               f"k1 k2 ({words[lens.model]}); " + (
                   f"p1 p2 {lens.p1:+.5f} {lens.p2:+.5f}" if lens.model == "brown"
                   else f"k3 {lens.k3:+.4f}")),
        Figure("usable region", "all" if lens.usable_px is None else f"{lens.usable_px:.0f} px",
               region, section=True)]


def _offset(offset):
    """The row of the planes' constant error."""
    done = ("added to every z_mm of planes.csv: z counts from the pinhole" if offset.correction_mm
            else "no constant error of z_mm is visible")
    return Figure("plane offset", f"{offset.mm:+.3f} mm",
                  f"+-{offset.sigma_mm:.3f} mm; {done}. A wrong scale of z_mm cannot be seen")


def _beams(result):
    """Rows of the mesh and its lines."""
    calibration, lines = result.calibration, result.lines
    fitted, windows, budget = result.identity.projector, result.windows, calibration.budget
    margin, matched = result.identity.margin, result.identity.matched
    worst = int(lines.residual_v.argmax())
    rows = [
        Figure("spots", f"{100 * matched:.1f} %",
               f"of those expected in {len(result.planes)} plane frames were found; "
               + ("no other numbering is possible" if math.isinf(margin) else
                  f"any other numbering leaves {margin:.0f} more unexplained"),
               matched >= _SPOTS, f"above {_SPOTS:.0%}"),
        Figure("base", f"{', '.join(f'{part:.3f}' for part in fitted.base_mm)} mm",
               f"fitted; pitch {fitted.pitch_deg:.3f}, rotation {fitted.rotation_deg:.2f}, "
               f"toe-in {fitted.toe_in_deg:.2f} degrees"),
        Figure("lines", f"{lines.rms_px:.3f} px RMS",
               f"distance of the spots from their lines; {lines.outliers} outliers left out",
               lines.rms_px <= _LINES_PX, f"below {_LINES_PX} px"),
        Figure("worst beam", f"{lines.residual_v[worst]:.3f} px RMS",
               f"beam {lines.numbers[worst]}; every beam that is used was found in "
               f"{int(lines.planes.min())} planes or more",
               lines.residual_v[worst] <= 2 * _LINES_PX, f"below {2 * _LINES_PX} px")]
    if calibration.left_out:
        rows.append(Figure(
            "left out", f"{len(calibration.left_out)} of {len(calibration.beams)} beams",
            "no spot will match them: "
            + list_names([str(beam) for beam in calibration.left_out], _NAMED_BEAMS),
            set(calibration.left_out) <= result.dead,
            "none but dead ones" if result.dead else "none"))
    smallest, depth = windows.smallest_px, budget["expected_depth_relative"]
    return [
        *rows,
        Figure("held out", f"{budget['held_out_px']:.3f} px RMS",
               "error along u of each plane predicted from the others"
               f" ({budget['held_out_free_px']:.3f} px with every beam on its own)",
               budget["held_out_px"] <= _HELD_OUT_PX, f"below {_HELD_OUT_PX} px"),
        _offset(result.offset),
        Figure("line separation", "no neighbour" if math.isinf(smallest) else f"{smallest:.2f} px",
               f"smallest where windows overlap; {windows.smallest_whole_px:.2f} px without "
               "windows", smallest >= _SEPARATION_PX, f"above {_SEPARATION_PX:g} px"),
        Figure("depth range", f"{windows.z_min:.0f} to {windows.z_max:.0f} mm",
               f"tolerance {windows.tolerance.min():.2f} to {windows.tolerance.max():.2f} px"),
        Figure("depth error", f"{100 * depth:.3f} %",
               "expected mean over the depth range, from the noise of the centres",
               depth <= _DEPTH, f"below {100 * _DEPTH:g} %", section=True)]


def _chip(calibration):
    """Rows of the chip's rounding errors; in pixels, they grow with the LSB of a coordinate."""
    budget = calibration.budget
    larger = lsb_px(calibration.width, calibration.height) / lsb_px(SMALL_SENSOR, SMALL_SENSOR)
    centre, undistortion, line = (larger * limit for limit in (
        _CENTRE_PX, _UNDISTORTION_PX, _LINE_PX))
    return [
        Figure("centre", f"{budget['centre_px']:.4f} px", "largest rounding error",
               budget["centre_px"] <= centre, f"below {centre:g} px"),
        Figure("undistortion", f"{budget['undistortion_px']:.4f} px",
               "largest rounding error within the usable region; strong tangential distortion and "
               "strong magnification make it large",
               budget["undistortion_px"] <= undistortion, f"below {undistortion:g} px"),
        Figure("line", f"{budget['line_px']:.4f} px", "largest rounding error within the windows",
               budget["line_px"] <= line, f"below {line:g} px"),
        Figure("1/z", f"{budget['depth_relative']:.1e}",
               "largest relative rounding error within the windows",
               budget["depth_relative"] <= _INVERSE_Z, f"below {_INVERSE_Z:.0e}")]


def figures(result):
    """All figures of a :class:`calibration.calibrate.Result`, a list of :class:`Figure`."""
    return [*_lens(result.calibration, result.lens_report), *_beams(result),
            *_chip(result.calibration)]


def health(result):
    """One line: whether all is good, or what to look at."""
    bad = [figure.name for figure in figures(result) if not figure.good]
    if result.lens_report.flags and "lens" not in bad:
        bad.insert(0, "lens")
    if not bad:
        return "Health: good; every figure is in its range."
    return (f"Health: look at {', '.join(bad)}: outside the range where "
            f"{'it is' if len(bad) == 1 else 'they are'} good, or doubtful.")
