"""What the page is sent: frames, textures and the strip of states, as JSON and octets."""

import json

import numpy as np

from scripts.measure.surface import Surface
from scripts.results.colour import spread
from scripts.results.overlay import beam_segments
from scripts.results.points import DOUBTFUL, OK, STATUS

__all__ = ["describe_frame", "describe_rig", "describe_strip", "pack_texture"]

#: Frames over which the rate is taken.
_RATE_FRAMES = 12
#: Seconds of a step of the texture's age, and the octet of pixels that never came.
AGE_STEP, NEVER = 0.25, 255


def _rounded(array, digits):
    """Plain numbers; NaN is None."""
    return [[None if value != value else value for value in row]
            for row in np.round(np.asarray(array, float), digits).tolist()]


def describe_rig(calibration):
    """What stays: sensor, mesh, range, the projector's place, and where spots can be."""
    lens = calibration.lens
    return {
        "width": calibration.width, "height": calibration.height, "rows": calibration.rows,
        "columns": calibration.columns, "beams": len(calibration.beams),
        "depth": [calibration.z_min, calibration.z_max],
        "focal": lens.focal, "principal": [lens.principal_u, lens.principal_v],
        "projector": list(calibration.projector.base_mm),
        "lines": [_rounded(segment, 1) for segment in beam_segments(calibration, 9)
                  if np.isfinite(segment).all()],
        "status": list(STATUS), "age_step": AGE_STEP}


def describe_frame(history, position):
    """A frame with its points and the triangles between them.

    ``points`` are rows of beam, u, v, x, y, z, status; ``triangles`` has numbers of these rows.
    """
    moment = history.moment(position)
    points, frame = moment.points, moment.frame
    surface = Surface(points, history.calibration)
    row_of = {int(beam): row for row, beam in enumerate(points["beam"])
              if points["status"][row] == OK}
    rows = np.array([row_of[int(beam)] for beam in surface.points["beam"]], int)
    table = [[int(point["beam"]), *numbers, int(point["status"])] for point, numbers in zip(
        points, _rounded(np.stack([points[name] for name in "uvxyz"], axis=-1), 3)
        if len(points) else [], strict=True)]
    return {
        "type": "frame", "position": int(np.clip(position, history.first, history.count - 1)),
        "first": history.first, "count": history.count, "frame": frame.index,
        "seconds": round(moment.seconds, 4), "points": table,
        "triangles": rows[surface.triangle].ravel().tolist() if len(rows) else [],
        "strip": describe_strip(history, position)}


def _rate(history, position):
    """Pairs a second by the chip's clock."""
    begin = max(history.first, position - _RATE_FRAMES)
    end = max(position, min(begin + 1, history.count - 1))  # of the first frame, with the next one
    span = history.seconds(end) - history.seconds(begin)
    return (end - begin) / span if span > 0 else 0.0


def describe_strip(history, position):
    """The states of a frame, for the strip at the top."""
    moment = history.moment(position)
    position = min(max(position, history.first), history.count - 1)
    frame, status = moment.frame, moment.points["status"]
    beams = sum(beam is not None for beam in history.calibration.beams)
    return {
        "lit": frame.laser, "tripped": frame.tripped, "capture": frame.capture,
        "tables": frame.tables_valid, "summarised": frame.summarised,
        "verified": frame.verified, "rate": round(_rate(history, position), 1),
        "ok": int(np.count_nonzero(status == OK)), "beams": beams,
        "doubtful": int(np.count_nonzero(status == DOUBTFUL)),
        "noise": round(frame.grey_noise / 8, 2), "saturated": frame.saturated,
        "lost": moment.lost, "dropped": frame.dropped, "exposure": frame.exposure_us,
        **_fit(moment.drift)}


def _fit(drift):
    """How far the spots are beside their own lines, what is normal, and what has moved."""
    if drift is None:
        return {"fit": None, "fit_normal": None, "moved": None}
    return {"fit": round(drift.distance_px, 3), "fit_normal": round(drift.normal_px, 3),
            "moved": drift.sentence or None}


def pack_texture(history, position):
    """The texture of a frame: length of a head, the head, pixels, and the age of each.

    Rows that have not come yet are shown as the nearest one that has, within a few rows: so the
    first pass, which has every eighth row, is a whole picture.

    The head is JSON. A pixel is a grey value, or red, green, blue: ``channels`` octets. Ages are in
    steps of :data:`AGE_STEP`, 255 where nothing came.
    """
    moment = history.moment(position)
    picture, when = history.picture(position)
    came = np.isfinite(when)
    shown, known = spread(came, when)
    age = np.where(known, np.clip((moment.seconds - shown) / AGE_STEP, 0, NEVER - 1), NEVER)
    ages = moment.seconds - when[came]
    head = json.dumps({
        "type": "texture", "frame": moment.frame.index, "width": when.shape[1],
        "height": when.shape[0], "channels": picture.size // when.size,
        "part": round(float(came.mean()), 4),
        "age": round(float(np.median(ages)), 2) if len(ages) else None}).encode()
    return (len(head).to_bytes(4, "little") + head + picture.tobytes()
            + age.astype(np.uint8).tobytes())
