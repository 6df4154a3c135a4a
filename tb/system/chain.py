"""The chip from the frame gate to the points, for measuring it clock by clock."""

import numpy as np
from amaranth.hdl import ClockDomain, ClockSignal, Module, ResetSignal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.capsule_points import CapsulePoints
from hdl.payloads import GreyPixel, Point
from tb.native_block import NativeBlock
from tb.preprocessing.frames import grey_words

__all__ = ["Chain", "dense_frame", "last_point_latency", "spots_at_the_bottom",
           "spots_on_the_last_row"]


class Chain(wiring.Component):
    """Grey pixels to points at fixed levels, weighted centres; tables all zero."""

    def __init__(self, config):
        self.config = config
        super().__init__({"i": In(stream.Signature(GreyPixel)),
                          "o": Out(stream.Signature(Point))})

    def elaborate(self, platform):
        m = Module()
        m.domains.spot = ClockDomain(local=True)
        m.submodules.points = points = CapsulePoints(self.config)
        connect(m, flipped(self.i), points.i)
        connect(m, points.o, flipped(self.o))
        m.d.comb += [
            ClockSignal("spot").eq(ClockSignal()),
            ResetSignal("spot").eq(ResetSignal()),
            points.counts.ready.eq(1),
            points.frames.ready.eq(1),
            points.detections.ready.eq(1),
            *(getattr(points, name).eq(value) for name, value in {
                "fixed_noise": 80, "lit_gain": 18, "core_gain": 24, "weighted": 1, "area_min": 1,
                "area_max": 1023, "saturation": 255}.items()),
        ]
        return m


def spots_on_the_last_row(config, spots=64):
    """A frame whose spots all end on its last row."""
    image = np.zeros((config.height, config.width), np.uint8)
    pitch = config.width / spots
    for spot in range(spots):
        left = int(spot * pitch)
        # Each of its own weight.
        image[-5:, left:left + 3] = 120 + spot
    return image


def spots_at_the_bottom(config, spots):
    """A frame with so many spots, as low as they can be told apart: 64 in twelve rows."""
    image = np.zeros((config.height, config.width), np.uint8)
    for low in range(0, spots, 64):
        band = spots_on_the_last_row(config)[-12:]
        band[:, int(min(spots - low, 64) * config.width / 64):] = 0
        top = config.height - 12 * (low // 64 + 1)
        image[top:top + 12] = band
    return image


def dense_frame(seed=1):
    """A simulated frame of 19 x 19 beams on a plane."""
    from model.optics import render, scenes
    from model.optics.rigs import RIGS
    rng = np.random.default_rng(seed)
    scene, = scenes.sequence("plane", RIGS["dense"], 1, rng)
    return render.pattern_frame(RIGS["dense"], scene, rng)[0]


def last_point_latency(config, image):
    """Clocks from the last pixel of ``image`` to its last point, a pixel in every clock.

    Returns
    -------
    (clocks, points that came out)
    """
    block = NativeBlock(Chain(config))
    block.reset()
    beats = block.stream(grey_words(image), idle=80_000)
    fields = beats.fields(Point)
    last = np.flatnonzero(fields["end"] == 0)[-1]
    return int(beats.clocks[last] - beats.taken[-1]), int(np.count_nonzero(fields["end"] == 0))
