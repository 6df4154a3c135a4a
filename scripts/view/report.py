"""A recording as one HTML file: figures, pictures and measurements; it needs nothing else."""

import base64
import html

import cv2
import numpy as np

from scripts.measure.surface import Surface
from scripts.results.overlay import SPOT_COLOURS
from scripts.results.points import DOUBTFUL, OK, STATUS

__all__ = ["write_report"]

#: Frames that are shown besides those with measurements, and picture pixels of an image pixel.
_SHOWN, _SCALE = 6, 2
_MARK = (62, 210, 255)
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #16191c; max-width: 1100px; margin: 24px auto;
padding: 0 16px; font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; margin: 12px 0; } h1 { font-size: 24px; } h2 { font-size: 19px; }
td, th { border-bottom: 1px solid #c9ced3; padding: 5px 12px 5px 0; text-align: left; }
figure { display: inline-block; margin: 0 12px 16px 0; } figcaption { color: #59626b; }
img { display: inline-block; margin-right: 4px; max-width: 100%; } p.note { color: #59626b; }
"""


def _png(picture):
    done, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert done
    return "data:image/png;base64," + base64.b64encode(data.tobytes()).decode()


def _places(image):
    """Image coordinates to those of the enlarged picture."""
    return np.rint((np.asarray(image, float) + 0.5) * _SCALE - 0.5).astype(np.int32)


def _picture(history, position, measured):
    """The picture with its spots, and what was marked in it."""
    moment = history.moment(position)
    shown, _ = history.picture(position)
    large = cv2.resize(shown, None, fx=_SCALE, fy=_SCALE, interpolation=cv2.INTER_LINEAR)
    picture = cv2.cvtColor(
        large, cv2.COLOR_GRAY2BGR if large.ndim == 2 else cv2.COLOR_RGB2BGR)
    for point in moment.points:
        if point["status"] < len(STATUS):
            cv2.circle(picture, _places((point["u"], point["v"])), 5,
                       SPOT_COLOURS[point["status"]], 1, cv2.LINE_AA)
    for each in measured:
        cv2.polylines(picture, [_places(each["points_px"])], each["kind"] == "polyp", _MARK, 2,
                      cv2.LINE_AA)
    return picture


def _depth(history, position):
    """Triangles of the surface in the picture, bright where it is near."""
    calibration = history.calibration
    surface = Surface(history.moment(position).points, calibration)
    picture = np.full((calibration.height * _SCALE, calibration.width * _SCALE), 0, np.uint8)
    near, far = 1 / calibration.z_min, 1 / calibration.z_max
    place = _places(np.stack([surface.points["u"], surface.points["v"]], axis=-1))
    for triangle in surface.triangle:
        part = (surface.inverse[triangle].mean() - far) / (near - far)
        cv2.fillConvexPoly(picture, place[triangle], int(np.clip(30 + 225 * part, 1, 255)),
                           cv2.LINE_AA)
    coloured = cv2.applyColorMap(picture, cv2.COLORMAP_VIRIDIS)
    coloured[picture == 0] = 255
    return coloured


def _figures(history):
    """Rows of the table at the top."""
    count, lit, failed, points, doubtful = history.count - history.first, 0, 0, 0, 0
    for position in range(history.first, history.count):
        moment = history.moment(position)
        lit += moment.frame.laser
        failed += moment.frame.verified is False
        points += np.count_nonzero(moment.points["status"] == OK)
        doubtful += np.count_nonzero(moment.points["status"] == DOUBTFUL)
    numbers = history.numbers()
    seconds = moment.seconds - history.seconds(history.first)
    beams = sum(beam is not None for beam in history.calibration.beams)
    yield "frames", f"{count}, numbered {numbers[0]} to {numbers[-1]}"
    yield "duration", f"{seconds:.1f} s" + (
        f", {(count - 1) / seconds:.1f} pairs/s" if seconds else "")
    yield "laser lit", f"in {lit} frames"
    yield "points a frame", f"{points / count:.1f} of {beams} beams"
    yield "doubtful points a frame", f"{doubtful / count:.2f}"
    yield "frames whose check failed", str(failed)
    yield "packets lost", str(moment.lost)


def _number(value, digits):
    return "" if value is None else f"{value:.{digits}f}"


def _measurements(rows):
    if not rows:
        return "<p>Nothing was measured.</p>"
    head = ("frame", "mean of", "what", "length, mm", "&plusmn; (68 %)", "height, mm",
            "&plusmn; (68 %)", "size class")
    lines = ["<table><tr>" + "".join(f"<th>{name}</th>" for name in head) + "</tr>"]
    for each in rows:
        cells = (each["frame"], each["frames"], each["kind"], _number(each["length_mm"], 2),
                 _number(each["uncertainty_mm"], 2), _number(each["height_mm"], 1),
                 _number(each["height_uncertainty_mm"], 1), each["size_class"] or "")
        lines.append("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in cells)
                     + "</tr>")
    return "\n".join([*lines, "</table>"])


def write_report(history, name, measured):
    """The report of a history as the octets of an HTML file; the same history gives the same.

    Parameters
    ----------
    history : :class:`scripts.host.history.History`
        One frame at least.
    name : :class:`str`
        What it is called.
    measured : list of dict
        Measurements, as :meth:`scripts.view.measurements.Measurements.plain` gives them.
    """
    positions = set(np.linspace(history.first, history.count - 1, _SHOWN).astype(int).tolist())
    known = {int(number): history.first + at for at, number in enumerate(history.numbers())}
    positions |= {known[each["frame"]] for each in measured if each["frame"] in known}
    figures = []
    for position in sorted(positions):
        moment = history.moment(position)
        here = [each for each in measured if each["frame"] == moment.frame.index]
        pictures = (_picture(history, position, here), _depth(history, position))
        figures.append("<figure>" + "".join(
            f'<img alt="" width="{picture.shape[1] // 2}" src="{_png(picture)}">'
            for picture in pictures) + f"<figcaption>frame {moment.frame.index}, "
            f"{moment.seconds:.2f} s</figcaption></figure>")
    low, high = history.calibration.z_min, history.calibration.z_max
    rows = "".join(f"<tr><td>{key}</td><td>{html.escape(value)}</td></tr>"
                   for key, value in _figures(history))
    title = html.escape(name)
    return "\n".join([
        "<!DOCTYPE html>", f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        f"<style>{_STYLE}</style></head><body>", f"<h1>{title}</h1>",
        f"<table>{rows}</table>", "<h2>Measurements</h2>", _measurements(measured),
        "<h2>Pictures</h2>", f'<p class="note">The camera\'s picture with the spots, and the '
        f"measured surface: yellow is {low:.0f} mm away, blue {high:.0f} mm.</p>", *figures,
        '<p class="note">For research. Not a medical device.</p>', "</body></html>",
        ""]).encode()
