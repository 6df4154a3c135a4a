"""How fast the page of ``cyclope view`` is: frames drawn, delay from frame to picture, memory."""

import resource
import time
from dataclasses import dataclass

import numpy as np

from model.optics.scenes import Plane
from scripts.host.history import History
from scripts.host.messages import Frame, TextureFrame, TexturePiece
from scripts.results.drift import DriftMonitor
from scripts.view.session import ThreadSession
from tb.measure.simulated import calibration_of, measured, mesh_rig
from tb.view.bench import NOISE_PX, serving
from tb.view.browser import open_browser, until

__all__ = ["Pace", "measure"]

_PAIRS_HZ, _ROWS, _LIT = 25, 10, 0x48
#: Notes when each frame was drawn, by the clock that this program has too.
_WATCH = """() => {
  window.drawn = [];
  const show = page.show.bind(page);
  page.show = (frame) => {
    show(frame);
    requestAnimationFrame(() => setTimeout(() => drawn.push([frame.position, Date.now()]), 0));
  };
}"""


@dataclass(frozen=True)
class Pace:
    """What came of some seconds of frames.

    Parameters
    ----------
    points : :class:`int`
        Of a frame.
    offered, drawn : :class:`float`
        Frames a second that were there, and that the page drew.
    median_ms, p95_ms : :class:`float`
        From a frame to its picture on the screen.
    server_mb, page_mb : tuple of two :class:`float`
        Memory at the beginning and at the end: the largest of this process, the heap of the page
        after its garbage is collected.
    """

    points: int
    offered: float
    drawn: float
    median_ms: float
    p95_ms: float
    server_mb: tuple
    page_mb: tuple


class _Feed(ThreadSession):
    """A live session of simulated frames."""

    live = True

    def __init__(self, side):
        rig = mesh_rig(side)
        self._calibration = calibration_of(rig, NOISE_PX)
        super().__init__(History(self._calibration), "a bench")
        rng = np.random.default_rng(1)
        self._shown = [measured(rig, self._calibration, Plane(55 + 0.5 * step, 20, 40), rng,
                                NOISE_PX) for step in range(10)]
        self.points = len(self._shown[0])
        self._row = rng.integers(60, 200, self._calibration.width).astype(np.uint8)
        self.times = []

    def _run(self):
        begin, number, monitor = time.time(), 0, DriftMonitor(self._calibration)
        while not self._ended.is_set():
            index, now = 2 * number + 2, round(number * 1e6 / _PAIRS_HZ) + 1
            self.history.take(TextureFrame(index - 1, 0, 9, now, 0, 0, 0xC0, index - 1))
            for row in range(_ROWS):
                row = (number * _ROWS + row) % self._calibration.height
                self.history.take(TexturePiece(index - 1, row, 0, np.roll(self._row, number)))
            points = self._shown[number % 10].copy()
            points["frame"] = index
            self.history.take(Frame(index, flags=_LIT, index=index, timestamp_us=now,
                                    ok=len(points), spots=len(points)), points,
                              drift=monitor.add(points))
            self.times.append(time.time())
            self.changed()
            number += 1
            self._ended.wait(max(0.0, begin + number / _PAIRS_HZ - time.time()))


def measure(side, seconds):
    """The :class:`Pace` of a mesh of side x side beams over some seconds, in headless Chromium."""
    feed = _Feed(side)
    with serving(feed) as server, open_browser() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(server.address)
        until(page, "window.page && page.frame")
        page.evaluate(_WATCH)
        time.sleep(2)

        collector = page.context.new_cdp_session(page)

        def memory():
            collector.send("HeapProfiler.collectGarbage")
            return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                    page.evaluate("performance.memory.usedJSHeapSize") / 2**20)

        before, first = memory(), len(feed.times)
        page.evaluate("drawn.length = 0")
        time.sleep(seconds)
        after, offered, drawn = memory(), len(feed.times) - first, page.evaluate("drawn")
    delay = np.array([drawn_at - 1000 * feed.times[position] for position, drawn_at in drawn])
    return Pace(feed.points, offered / seconds, len(drawn) / seconds, float(np.median(delay)),
                float(np.quantile(delay, 0.95)), (before[0], after[0]), (before[1], after[1]))
