"""What is to be said at the end of a reception, and whether its result is to be used."""

from scripts.host.recorder import MISMATCH
from scripts.host.status import causes
from scripts.results.summary import plural

__all__ = ["find_losses", "find_unusable", "summarise"]

_LOAD = "`cyclope load PORT calibration.json --start` loads them."


def summarise(recorder):
    """What came, in one line."""
    *counts, last = [
        plural(recorder.frames, "frame"), plural(recorder.points, "point"),
        *(plural(number, f"complete {kind}") for kind, number in recorder.complete.items()
          if kind == "texture" or kind in recorder.seen)]
    return f"{', '.join(counts)} and {last} in {recorder.folder}"


def find_losses(decoder, recorder):
    """What was lost or could not be used, in a list of sentences; the rest is as good as ever."""
    sentences = (
        (decoder.lost, "packet lost", "packets lost"),
        (decoder.damaged, "packet damaged", "packets damaged"),
        (decoder.garbage, "octet of garbage", "octets of garbage"),
        (decoder.unknown, "unknown packet", "unknown packets"),
        (decoder.unbalanced, "frame whose counts do not add up",
         "frames whose counts do not add up"),
        (sum(image.outside for image in recorder.images.values()),
         "image fragment dropped: it lies outside of the sensor",
         "image fragments dropped: they lie outside of the sensor"),
        (recorder.orphans, "image fragment dropped: its frame was never announced",
         "image fragments dropped: their frames were never announced"))
    lost = [f"{number} {one if number == 1 else more}." for number, one, more in sentences
            if number]
    if recorder.unverified and recorder.verified:
        lost.append(f"{plural(recorder.unverified, 'frame')} whose check failed: {MISMATCH}.")
    return lost


def find_unusable(recorder, images=None):
    """Why the result is not to be used, in a list of sentences.

    Parameters
    ----------
    recorder : :class:`scripts.host.recorder.Recorder`
        What came.
    images : :class:`int` or None
        So many complete images were wanted, and nothing else.
    """
    if images is not None and sum(recorder.complete.values()) >= images:
        return []
    reasons = []
    if images is not None:
        reasons += [f"{kind}.png is not complete: only {recorder.images[kind].part:.0%} of it came."
                    for kind in sorted(recorder.seen)
                    if (kind == "pattern" or recorder.seen == {"texture"})
                    and not recorder.complete[kind]]
    if not recorder.frames and not recorder.seen:
        return [*reasons, "no frame came: `cyclope load PORT --start` starts the chip."]
    if recorder.tripped:
        reasons.append(_trip(recorder))
    if not recorder.frames:
        if recorder.seen == {"texture"}:
            reasons.append("no pattern came, only images without the laser: `cyclope load PORT "
                           "--pattern-images --capture-ms MS` lights it for so long.")
        return reasons
    if images is not None:
        return reasons or ["no complete image came."]
    if not recorder.lit:
        reasons.append("the laser was off in all frames" + (
            "." if recorder.tabled else f": the chip has no valid tables; {_LOAD}"))
    elif not recorder.tabled:
        reasons.append(f"the chip had no valid tables in any frame that was lit; {_LOAD}")
    if recorder.unverified and not recorder.verified:
        reasons.append(f"{plural(recorder.unverified, 'frame')} whose check failed, and none whose "
                       f"check is right: {MISMATCH}.")
    elif recorder.drift and recorder.drift.causes:
        sentence = recorder.drift.sentence
        reasons.append(sentence[0].lower() + sentence[1:])
    elif not recorder.points and not reasons:
        reasons.append(
            "no frame with points arrived complete, so none could be checked: is the line too "
            "long or too noisy?" if recorder.reported else
            "no point in any frame: is anything in the range of the laser, and does its driver "
            "light it?")
    return reasons


def _trip(recorder):
    held = causes(recorder.status) if recorder.status else []
    return (f"the laser guard had tripped in {plural(recorder.tripped, 'frame')}"
            + (f": it saw {', '.join(held)}" if held else "")
            + "; `cyclope status PORT` shows its causes, `cyclope load PORT --clear` clears them.")
