"""Sequencer, laser guard and camera with an imager that does what its pins tell it."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, FallingEdge, ReadOnly, RisingEdge, Timer

from hdl.payloads import FrameTag, GreyPixel
from hdl.protocol import Mode
from model.optics import scenes
from model.optics.imager import Imager
from model.optics.rigs import RIGS
from tb.acquisition.addressed_pins import AddressedImagerPins
from tb.acquisition.imager_pins import ImagerPins
from tb.harness import parameters, start_clock
from tb.native_block import unpack


class RigBench:
    """Sequencer, laser guard and camera with the imager; frames as they come, with their tags."""

    def __init__(self, dut, imager):
        start_clock(dut.clk, 62_500)
        self.dut, self.frames = dut, []
        self.addressed = "latency" in parameters()
        if self.addressed:
            self.pins = AddressedImagerPins(
                dut, imager, parameters()["latency"], parameters()["interval"])
        else:
            self.pins = ImagerPins(dut, imager, blanking=parameters()["blanking"])
            dut.pixel_rst.value = 1
        dut.rst.value, dut.o_ready.value = 1, 1
        for name, value in {
                "mode": Mode.CONTINUOUS, "pattern_reset_us": 100, "pattern_us": 500,
                "texture_reset_us": 100, "texture_us": 10_000,
                "period_us": parameters()["period_us"]}.items():
            getattr(dut, name).value = value

    async def begin(self):
        await ClockCycles(self.dut.clk, 10)
        self.dut.rst.value = 0
        if not self.addressed:
            await RisingEdge(self.dut.pixel_clk)
            self.dut.pixel_rst.value = 0
        cocotb.start_soon(self._pixels())

    async def _pixels(self):
        """Frames of the camera's stream, by the clocks in which it is valid."""
        dut, words, tag = self.dut, [], 0
        while True:
            await RisingEdge(dut.o_valid)
            while True:
                await ReadOnly()
                if not dut.o_valid.value:
                    break
                tag = tag if words else dut.tag.value.to_unsigned()
                words.append(dut.o_payload.value.to_unsigned())
                if words[-1] >> 9 & 1:
                    self._frame(words, tag)
                    words = []
                await RisingEdge(dut.clk)

    def _frame(self, words, tag):
        pixels = unpack(GreyPixel, np.array(words, np.uint32).reshape(-1, 1))
        tag = unpack(FrameTag, np.array([[tag & 0xFFFFFFFF, tag >> 32]], np.uint32))
        shape = self.pins.imager.height, self.pins.imager.width
        whole = not pixels["marker_broken"].any() and len(words) == shape[0] * shape[1]
        self.frames.append((
            pixels["grey"].astype(int).reshape(shape) if whole else None,
            {name: int(tag[name][0]) for name in ("texture", "laser", "exposure_us")}))


@cocotb.test(timeout_time=400, timeout_unit="ms")
async def pairs(dut):
    """The pictures that the camera gives are those of the nominal exposures, and say what lit."""
    rig = RIGS[parameters()["rig"]]
    scene = scenes.sequence("polyp", rig, 1, np.random.default_rng(1))[0]
    imager = Imager.of_scene(rig, scene, 1, noise=None)
    nominal = {(0, 0): imager.expose(500, 0), (0, 1): imager.expose(500, 500),
               (1, 0): imager.expose(10_000, 0)}
    bench = RigBench(dut, imager)
    await bench.begin()
    while len(bench.frames) < 2 or not all(
            any(tag["laser"] == laser and tag["texture"] == texture for _, tag in bench.frames)
            for texture, laser in nominal):
        await FallingEdge(dut.sending if bench.addressed else dut.frame_valid)
    await Timer(10, unit="us")
    assert len(bench.frames) == len(bench.pins.taken)
    for (picture, tag), (integrated, lit, sent) in zip(bench.frames, bench.pins.taken,
                                                       strict=True):
        assert np.array_equal(picture, sent)
        assert integrated == tag["exposure_us"] == (10_000 if tag["texture"] else 500)
        assert (lit > 499.8) == tag["laser"] and (lit == 0) == (not tag["laser"])
        wanted = nominal[tag["texture"], tag["laser"]].astype(int)
        assert np.abs(picture - wanted).max() <= 1
    assert not any(getattr(dut, name).value for name in ("late", "timeouts", "causes"))


@cocotb.test(timeout_time=400, timeout_unit="ms")
async def imager_stops_and_comes_back(dut):
    """It stops inside a frame and is silent for a while; the first picture afterwards is right."""
    rig = RIGS[parameters()["rig"]]
    scene = scenes.sequence("polyp", rig, 1, np.random.default_rng(1))[0]
    imager = Imager.of_scene(rig, scene, 1, noise=None)
    bench = RigBench(dut, imager)
    await bench.begin()
    for _ in range(2):  # the first frame is whole
        await RisingEdge(dut.frame_valid)
    bench.pins.stop_at = imager.height // 2
    await RisingEdge(dut.silent)
    assert [picture is not None for picture, _ in bench.frames] == [True]
    bench.pins.silent = True
    bench.pins.stop_at = None
    beats = dut.heartbeat.value.to_unsigned()
    await Timer(20, unit="ms")
    assert dut.heartbeat.value.to_unsigned() == beats and dut.timeouts.value.to_unsigned() >= 3
    assert [picture is not None for picture, _ in bench.frames] == [True, False], "flagged broken"
    bench.pins.silent = False
    await FallingEdge(dut.silent)
    picture, tag = bench.frames[-1]
    exposure = tag["exposure_us"]
    assert np.array_equal(picture, imager.expose(exposure, 0)) and not tag["laser"]
