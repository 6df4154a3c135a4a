"""The line that ``cyclope receive`` shows while it runs."""

import time
from collections import deque

__all__ = ["LiveLine"]


class LiveLine:
    """Frame rate, points, lost packets, laser.

    Parameters
    ----------
    name : :class:`str`
        Where the octets come from.
    """

    def __init__(self, name):
        self.name = name
        self._samples = deque(maxlen=10)  # frames, and when they were exposed
        self._changed = time.monotonic()

    def text(self, decoder, recorder, done=None):
        """The line, as it stands; ``done`` is the part of a recording that was read."""
        from rich.text import Text

        from scripts.host.recorder import MISMATCH
        last = recorder.last
        name = self.name if done is None else f"{self.name}  {done:.0%}"
        if last is None and recorder.seen:
            return Text(f"{name}  " + "  ".join(
                f"{kind}: {recorder.complete[kind]} complete images, {image.fresh:.0%} of the next"
                for kind, image in recorder.images.items() if kind in recorder.seen))
        if last is None:
            words = ("nothing but garbage" if decoder.octets and not decoder.packets else
                     "no frame yet: `cyclope load PORT --start` starts the chip" if decoder.packets
                     else "nothing arrives")
            return Text(f"{name}  {words}")
        ok = int((last.points["status"] == 0).sum())
        text = Text(f"{name}  frame {last.index}  {self._rate(recorder):4.1f} frames/s  "
                    f"{ok:2} of {last.spots} spots ok  {recorder.complete['texture']} textures  "
                    "lost packets ")
        text.append(str(decoder.lost), style="yellow" if decoder.lost else "")
        if last.every > 1:
            text.append(f"  one pattern in {last.every}")
        text.append(f"  laser {'on' if last.laser else 'off'}")
        if last.summarised and not last.tables_valid:
            text.append(", no valid tables", style="yellow")
        if last.capture:
            text.append(", calibration capture", style="yellow")
        if last.tripped:
            text.append(", tripped: see `cyclope status`", style="bold red")
        drift = recorder.drift
        if drift:
            text.append(f"  across lines {drift.distance_px:.2f} px",
                        style="yellow" if drift.distance_px > drift.normal_px else "")
            if drift.causes:
                text.append(f", moved: {' or '.join(drift.causes)}", style="bold red")
        if last.verified is False:
            text.append(f"  {MISMATCH}", style="bold red")
        return text

    def _rate(self, recorder):
        """Pattern frames a second by the chip's clock, 0 if none come any more."""
        now = time.monotonic()
        if not self._samples or recorder.frames != self._samples[-1][0]:
            self._changed = now
            if recorder.last.timestamp_us:
                self._samples.append((recorder.frames, recorder.last.timestamp_us))
        if len(self._samples) < 2 or now - self._changed > 2:
            return 0.0
        (first, begin), (last, end) = self._samples[0], self._samples[-1]
        return (last - first) * 1e6 / (end - begin) if end > begin else 0.0
