"""Frames through an engine, to rows of points and notes in words."""

from collections import deque

import numpy as np

from calibration.files import list_names
from calibration.image import read_image
from scripts.results.locator import Locator
from scripts.results.points import STATUS, FrameResult
from scripts.results.summary import plural

__all__ = ["CLIPPED", "frame_notes", "measure"]

#: A frame with a larger share of white pixels is reported as overexposed.
CLIPPED = 0.001
#: Beams that a note names.
_NAMED_BEAMS = 8


def frame_notes(image, frame, points):
    """All that makes a frame worse than it could be, in words.

    Parameters
    ----------
    image : 2-D ``uint8`` array
        The pattern image.
    frame : :class:`scripts.host.messages.Frame`
        What the engine reported.
    points : array of :data:`scripts.results.points.POINT`
        Its spots.

    Returns
    -------
    tuple of :class:`str`
    """
    notes = []
    if frame.broken:
        notes.append("broken: synchronism lost")
    if frame.learning:
        notes.append("learning: no level yet")
    if frame.skipped:
        notes.append(f"{plural(frame.skipped, 'frame')} lost before it")
    if frame.dropped:
        notes.append(f"{plural(frame.dropped, 'spot')} dropped: buffer full")
    if frame.lost or not frame.summarised:
        notes.append(f"{plural(frame.lost, 'packet')} lost on the link")
    elif not frame.balanced:
        notes.append("its counts do not add up")
    if frame.verified is False:
        notes.append("its check fails: other tables in the chip, or a fault in its depth unit")
    if frame.bad_sync or frame.overrun:
        notes.append(f"camera: {plural(frame.bad_sync, 'bad sync')}, "
                     f"{plural(frame.overrun, 'overrun')} so far")
    unlisted = frame.rejected - int((points["status"] == STATUS.index("rejected")).sum())
    if unlisted > 0:
        notes.append(f"{plural(unlisted, 'rejected spot')} without a row")
    beams = points["beam"][points["beam"] >= 0].tolist()
    twice = sorted({beam for beam in beams if beams.count(beam) > 1})
    if twice:
        notes.append("more than one spot for "
                     f"{'beam' if len(twice) == 1 else 'beams'} "
                     + list_names([str(beam) for beam in twice], _NAMED_BEAMS))
    clipped = np.mean(image == 255)
    if not image.any():
        notes.append("all black")
    elif clipped == 1:
        notes.append("all white")
    elif clipped > CLIPPED:
        notes.append(f"overexposed: {100 * clipped:.1f} % of its pixels are 255")
    if not frame.spots:
        notes.append("no spot")
    elif not (points["status"] == STATUS.index("ok")).any():
        notes.append("no ok point")
    return tuple(notes)


def measure(entries, calibration, engine, independent=False):
    """Yield every frame's image and result, as the engine measures it.

    The engine takes some frames twice, to learn the levels; each is yielded once.

    Parameters
    ----------
    entries : list of :class:`scripts.results.frames.Entry`
        Frames, in order.
    calibration : calibration
        What the engine was opened with.
    engine : engine
        From :func:`scripts.simulation.engine.open_engine`.
    independent : :class:`bool`
        Learn every frame's levels on itself, and doubt no point for what its beam showed before.

    Yields
    ------
    (2-D ``uint8`` array, :class:`scripts.results.points.FrameResult`)
    """
    size = (calibration.width, calibration.height)
    waiting = deque()
    locate = Locator(calibration, related=not independent)

    def images():
        for entry in entries:
            waiting.append((entry, read_image(entry.path, *size)))
            yield waiting[-1][1]

    for frame in engine.frames(images(), independent):
        entry, image = waiting.popleft()
        grey = image if entry.texture is None else read_image(entry.texture, *size)
        points = locate(frame.points, entry.index, grey)
        yield image, FrameResult(
            index=entry.index, path=entry.path, texture=entry.texture, level=frame.level / 16,
            grey_noise=frame.grey_noise / 8, saturated=frame.saturated, spots=frame.spots,
            rejected=frame.rejected, dropped=frame.dropped, points=points,
            notes=frame_notes(image, frame, points))
    if waiting:
        raise RuntimeError(f"the engine gave no answer to {len(waiting)} frames")
