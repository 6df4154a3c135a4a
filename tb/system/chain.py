"""The chip between the frame gate and the Point FIFO, for measuring it clock by clock."""

import numpy as np
from amaranth.hdl import C, Cat, Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.common.stage import Stage
from hdl.common.table_memory import TableMemory
from hdl.payloads import GreyPixel, Point, Spot
from hdl.preprocessing.binarise import Binarise
from hdl.preprocessing.centre import Centring
from hdl.preprocessing.erosion import Erosion
from hdl.preprocessing.labelling import Labelling
from hdl.preprocessing.spot_queue import SpotQueue
from hdl.stereo.depth import Depth
from hdl.stereo.epipolar import Epipolar
from hdl.stereo.undistort import Undistort
from tb.native_block import NativeBlock
from tb.preprocessing.frames import grey_words

__all__ = ["Chain", "last_point_latency", "spots_on_the_last_row"]


class Chain(wiring.Component):
    """Grey pixels to points at a fixed level, weighted centres, mode gate; tables all zero."""

    def __init__(self, config):
        self.config = config
        super().__init__({"i": In(stream.Signature(GreyPixel)),
                          "o": Out(stream.Signature(Point))})

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}
        blocks = {
            "binarise": Binarise(8), "erosion": Erosion(config.width),
            "labelling": Labelling(**size), "spot_stage": Stage(Spot),
            "spot_queue": SpotQueue(config.spot_depth),
            "centre": Centring(), "undistort": Undistort(**size), "match_stage": Stage(),
            "epipolar": Epipolar(config.beams, config.lanes), "depth": Depth()}
        source = flipped(self.i)
        for name, block in blocks.items():
            m.submodules[name] = block
            connect(m, source, block.i)
            source = block.o
        connect(m, source, flipped(self.o))
        m.submodules.table = table = TableMemory()
        m.d.comb += [
            blocks["binarise"].level.eq(100),
            blocks["binarise"].enable.eq(1),
            blocks["erosion"].mode.eq(2),
            blocks["labelling"].weighted.eq(1),
            blocks["spot_queue"].area_min.eq(1),
            blocks["spot_queue"].area_max.eq(255),
            blocks["spot_queue"].counts.ready.eq(1),
            table.a_address.eq(blocks["depth"].table_address),
            blocks["depth"].table_data.eq(table.a_data),
            table.b_address.eq(Cat(blocks["centre"].table_address, C(1, 1))),
            blocks["centre"].table_data.eq(table.b_data),
        ]
        return m


def spots_on_the_last_row(config, spots=64):
    """A frame whose spots all end on its last row."""
    image = np.zeros((config.height, config.width), np.uint8)
    pitch = config.width / spots
    for spot in range(spots):
        left = int(spot * pitch)
        # Upright, so that every spot has a core, and of its own weight.
        image[-5:, left:left + 3] = 120 + spot
    return image


def last_point_latency(config, spots=64):
    """Clocks from a frame's last pixel to its last point, all spots ending on the last row.

    Returns
    -------
    (clocks, points that came out)
    """
    image = spots_on_the_last_row(config, spots)
    block = NativeBlock(Chain(config))
    block.reset()
    beats = block.stream(grey_words(image), idle=40_000)
    fields = beats.fields(Point)
    last = np.flatnonzero(fields["end"] == 0)[-1]
    return int(beats.clocks[last] - beats.taken[-1]), int(np.count_nonzero(fields["end"] == 0))
