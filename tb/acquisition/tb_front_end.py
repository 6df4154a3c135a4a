"""Bench of the front end: what it reports of frames beside their pixels, whichever way they go."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from model.acquisition.addressed_camera import addressed_camera
from model.acquisition.camera import BROKEN, FRAME_END, camera
from tb.acquisition.pins import FAULTS, show
from tb.harness import Bench, parameters, start_clock

WIDTH, HEIGHT = (parameters()[name] for name in ("width", "height"))
SEED, ADDRESSED = (parameters()[name] for name in ("seed", "addressed"))
EVENTS = ("begun", "ended", "broken")
_PINS = ({"sensor_read": 0, "data": 0} if ADDRESSED
         else {"frame_valid": 0, "line_valid": 0, "data": 0})


class Rig(Bench):
    """``events`` are the clocks of each event; ``sending`` says in which clocks a frame is read."""

    def __init__(self, dut, stall=0.0):
        super().__init__(dut, inputs=(), outputs=("o", "texture"), stall=stall, seed=SEED, plain={
            **_PINS, "tag": 0, "info_ready": 1, "texture_info_ready": 1})
        self.np_rng = np.random.default_rng(SEED)
        self.events, self.sending = {name: [] for name in EVENTS}, []
        if not ADDRESSED:
            dut.pixel_rst.value = 1
            start_clock(dut.pixel_clk, 13_700)

    async def begin(self):
        await self.reset()
        if not ADDRESSED:
            await RisingEdge(self.dut.pixel_clk)
            self.dut.pixel_rst.value = 0
        cocotb.start_soon(self._watch())

    async def _watch(self):
        while True:
            await ReadOnly()
            values = {name: bool(getattr(self.dut, f"frame_{name}").value) for name in EVENTS}
            self.sending.append(bool(self.dut.frame_sending.value))
            await RisingEdge(self.dut.clk)
            for name in EVENTS:
                self.events[name] += [self.cycle] * values[name]

    async def settle(self):
        await ClockCycles(self.dut.clk, 40)
        while self.sending[-1]:
            await RisingEdge(self.dut.clk)
        await ClockCycles(self.dut.clk, 40)

    def image(self):
        return self.np_rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)

    def check(self, markers, passes, texture):
        """The beats of one frame, which passes or not, are reported, and forgotten here."""
        whole = np.flatnonzero(markers & BROKEN == 0)
        assert len(self.events["begun"]) == bool(whole.size)
        assert len(self.events["ended"]) == np.count_nonzero(
            markers & (FRAME_END | BROKEN) == FRAME_END)
        assert len(self.events["broken"]) == np.count_nonzero(markers & BROKEN)
        mine, other = (self.texture, self.o) if texture else (self.o, self.texture)
        assert not other.words
        # Nothing passes of a frame that has no pixel; a broken beat behind a whole frame has none.
        beats = list(markers) if whole.size else []
        if beats and markers[whole[-1]] & FRAME_END:
            beats = beats[:whole[-1] + 1]
        assert [word >> 8 for _, word in mine.words] == (beats if passes else [])
        if mine.words:
            assert self.events["begun"] == [mine.words[0][0]]
            last = "ended" if beats[-1] & BROKEN == 0 else "broken"
            assert self.events[last] == [mine.words[-1][0]]
        for words in (mine.words, other.words, *self.events.values()):
            words.clear()


@cocotb.test(timeout_time=20, timeout_unit="ms", skip=ADDRESSED)
async def frames_of_all_kinds(dut):
    """Whole, torn and skipped frames; each is reported, whether it passes or not."""
    bench = Rig(dut)
    await bench.begin()
    breaks = skipped = 0
    for number, fault in enumerate([None, None, None, None, *FAULTS, None, *FAULTS, None]):
        passes, texture = bool(bench.np_rng.integers(3)), int(bench.np_rng.integers(2))
        dut.tag.value = texture
        dut.info_ready.value = dut.texture_info_ready.value = passes
        pins = show(bench.np_rng, bench.image(), fault)
        for frame_valid, line_valid, grey in pins.tolist():
            dut.frame_valid.value, dut.line_valid.value = frame_valid, line_valid
            dut.data.value = grey
            await RisingEdge(dut.pixel_clk)
        dut.frame_valid.value = dut.line_valid.value = 0
        seen = bench.sending[:]
        await bench.settle()
        _, markers = camera(*np.vstack([pins, [(0, 0, 0)]]).T, WIDTH, HEIGHT)
        breaks += int((markers & BROKEN != 0).sum())
        skipped += int(not passes and (markers & BROKEN == 0).any())
        bench.check(markers, passes, texture)
        assert (dut.bad_sync.value, dut.overrun.value, dut.skipped.value) == (breaks, 0, skipped)
        # As long as the pin is high, two clocks later.
        clocks = np.count_nonzero(pins[:, 0]) * 1.37
        assert abs(sum(bench.sending) - clocks) <= 1 and any(seen), number
        bench.sending.clear()


@cocotb.test(timeout_time=20, timeout_unit="ms", skip=not ADDRESSED)
@cocotb.parametrize(stall=[0.0, 0.6])
async def read_outs(dut, stall):
    """Whole read-outs, and such as the next one cuts short, which count as bad sync."""
    bench = Rig(dut, stall)
    await bench.begin()
    pixels, interval = WIDTH * HEIGHT, 2
    breaks = 0
    for texture in (0, 1, 0):
        for cut in (None, 40, 7):
            dut.tag.value = texture
            dut.sensor_read.value = 1
            await RisingEdge(dut.clk)
            dut.sensor_read.value = 0
            await ClockCycles(dut.clk, cut or pixels * interval + 20)
            if cut is None:
                await bench.settle()
                _, markers = addressed_camera([(bench.image(), pixels)])
                bench.check(markers, True, texture)
                continue
            assert dut.frame_sending.value
            dut.sensor_read.value = 1
            await RisingEdge(dut.clk)
            dut.sensor_read.value = 0
            await ClockCycles(dut.clk, pixels * interval + 20)
            await bench.settle()
            breaks += 1
            assert [len(bench.events[name]) for name in EVENTS] == [2, 1, 1]
            words = (bench.texture if texture else bench.o).words
            assert words[-1][0] == bench.events["ended"][0]
            assert bench.events["begun"][1] == words[-pixels][0] > bench.events["broken"][0]
            for each in (words, *bench.events.values()):
                each.clear()
            assert (dut.bad_sync.value, dut.overrun.value, dut.skipped.value) == (breaks, 0, 0)


@cocotb.test(timeout_time=20, timeout_unit="ms", skip=not ADDRESSED)
async def bad_sync_stops_at_255(dut):
    bench = Rig(dut)
    await bench.begin()
    for _ in range(260):
        dut.sensor_read.value = 1
        await RisingEdge(dut.clk)
        dut.sensor_read.value = 0
        await ClockCycles(dut.clk, 9)
    assert len(bench.events["broken"]) >= 257
    assert dut.bad_sync.value == 255
