# amaranth: UnusedElaboratable=no
"""Preset paper from pin to pin: serial line, screen and memory, in the native engine."""

import ctypes

import numpy as np
import pytest

from hdl.common.point_fifo import PointFIFO
from hdl.config import PRESETS
from hdl.paper import Paper
from model.display.vga import display
from model.paper import Paper as PaperModel
from model.preprocessing.remap import remap
from scripts.simulation.engine import ModelEngine, RTLEngine
from tb.display.monitor import Monitor
from tb.system.stimuli import directed_frames, spot_frame
from tb.system.test_paper import CIF, SMALL, images_of, settings_of

#: Clocks of a pair at 25 pairs a second.
PAIR = CIF.clock_hz // 25
#: Clocks of a screen of 60 Hz in 1024 of 16 MHz, and of one whole screen.
SCREEN_RATE, SCREEN_CLOCKS = 25_175_000 * 1024 // 16_000_000, 800 * 525


class Engine(RTLEngine):
    """With the screen on, which takes its share of the memory."""

    def __init__(self, settings, config, watched=False, **choices):
        super().__init__(settings, config, **choices)
        self._library.capsule_seen.restype = ctypes.c_size_t
        self._library.capsule_screen(self._handle, ctypes.c_uint32(SCREEN_RATE), int(watched))

    def idle(self, clocks):
        self._library.capsule_idle(self._handle, ctypes.c_uint64(clocks))

    def seen(self):
        """What the screen showed since it was asked last, as :class:`Monitor` takes it."""
        pins = np.zeros(8 * SCREEN_CLOCKS, np.uint32)
        count = self._library.capsule_seen(
            self._handle, pins.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(pins)))
        assert count < len(pins)
        pins = pins[:count]
        return [(pins >> shift & 0xFF).astype(np.uint8) for shift in (0, 8, 16)] + [
            (pins >> bit & 1).astype(np.uint8) for bit in (24, 25, 26)]

    def latency(self, image):
        """Clocks from a frame's last pixel until it has been measured."""
        before = self.clocks
        self._discard.append(False)
        octets = self._octets(image)
        frames = [*self._kept(octets), *self._finish()]
        return self.measured - before - image.size - self.blanking[1], frames[-1]

    def _octets(self, image):
        octets = super()._octets(image)
        self.measured = self.clocks
        return octets


def check(name, mine, wanted, full_records=True):
    for field in ("number", "level", "spots", "rejected", "dropped", "learning", "broken",
                  "skipped"):
        assert getattr(mine, field) == getattr(wanted, field), f"{name}: {field}"
    assert mine.verified
    # In the compact form, spots that are not ok follow, and not all of them.
    ours, theirs = (frame.points if full_records else frame.points[frame.points["status"] == 0]
                    for frame in (mine, wanted))
    assert np.array_equal(ours, theirs), name


@pytest.mark.parametrize("full_records", [True, False])
def test_frames_at_the_serial_line(full_records):
    """All that the chip tells, and what the reader makes of the compact form."""
    settings = settings_of(SMALL, report_rejected=False)
    images = images_of(SMALL, range(10))
    engine = Engine(settings, SMALL, full_records=full_records)
    frames = engine.frames([image for _, image in images])
    model = ModelEngine(settings, 64, 64)
    for (name, _), mine, wanted in zip(
            images, frames, model.frames([image for _, image in images]), strict=True):
        check(name, mine, wanted, full_records)


def worst_images(width, height):
    """Images that keep labelling busy, after an erosion or without."""
    row, column = np.mgrid[:height, :width]
    frames = directed_frames(width, height)
    names = ("black", "white", "isolated pixels", "checkerboard", "columns", "rows")
    images = {name: frames[name] for name in names}
    images["3 x 3 blocks"] = np.where((row % 4 < 3) & (column % 4 < 3), 255, 0)
    images["large areas"] = np.where((row % 18 < 17) & (column % 18 < 17), 255, 0)
    images["comb"] = np.where((column % 2 == 0) | (row == height - 1), 255, 0)
    images["steps"] = np.where((row + 3 * column) % 8 < 4, 255, 0)
    return {name: image.astype(np.uint8) for name, image in images.items()}


@pytest.mark.parametrize("erosion", ["erode", "off"])
def test_worst_frames_within_a_pair(erosion):
    """Read out at 8 MHz with 48 clocks of blanking a line, and measured: all of it in 40 ms."""
    settings = settings_of(CIF, erosion=erosion, level_fixed=128, area_min=1)
    engine, model = Engine(settings, CIF), ModelEngine(settings, CIF.width, CIF.height)
    read_out = 2 * (CIF.width + 48) * CIF.height
    for name, image in worst_images(CIF.width, CIF.height).items():
        latency, mine = engine.latency(image)
        wanted, = model.frames([image])
        assert read_out + latency <= PAIR, f"{name}: {read_out} + {latency} clocks"
        assert (mine.spots, mine.skipped) == (wanted.spots, 0)
        # Where the line cannot carry all points, the queues drop some; none of so few.
        assert mine.spots == (
            mine.ok + mine.noise + mine.ambiguous + mine.rejected + mine.dropped), name
        assert not mine.dropped or mine.spots > PointFIFO().depth, name
        if not mine.dropped and not wanted.dropped:
            check(name, mine, wanted)


def test_screen_shows_the_corrected_frame_and_its_spots():
    settings = settings_of(SMALL, report_rejected=False)
    engine = Engine(settings, SMALL, watched=True)
    model = PaperModel(settings, 64, 64)
    wanted = [display(None)]
    for seed in range(3):
        image = spot_frame(64, 64, seed, spots=12)
        list(engine.frames([image]))
        engine.idle(2 * SCREEN_CLOCKS * 1024 // SCREEN_RATE)
        points = model.frame(image).points
        wanted.append(display(remap(image, settings.remap), [
            (int(point["u"]), int(point["v"]), point["status"] == 0) for point in points]))
    shown = Monitor(*engine.seen()).pictures
    kinds = [next((index for index, picture in enumerate(wanted)
                   if np.array_equal(picture, mine)), None) for mine in shown]
    assert None not in kinds, f"a screen that is no frame's: {kinds}"
    assert kinds == sorted(kinds) and {1, 2, 3} <= set(kinds)


def test_wants_a_config():
    with pytest.raises(TypeError, match="The configuration must be a Config, not 'paper'"):
        Paper("paper")


def test_members_are_those_of_the_capsule_and_more():
    """So that one instrument can hold either."""
    from hdl.capsule import Capsule
    from hdl.capsule_points import CapsulePoints
    from hdl.paper import BOARD
    from hdl.paper_points import PaperPoints
    from hdl.reconstruction import Reconstruction
    paper, capsule = (top(PRESETS[name]).signature.members for top, name in (
        (Paper, "paper"), (Capsule, "capsule")))
    board = {*BOARD, "memory", "memory_word", "display_faults"}
    common = capsule.keys() - (CapsulePoints.registers.keys() - Reconstruction.registers.keys())
    own = PaperPoints.registers.keys() - Reconstruction.registers.keys()
    assert paper.keys() - board - own == common
    assert all(paper[name] == capsule[name] for name in common)
