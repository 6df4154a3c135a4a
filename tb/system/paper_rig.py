"""Preset ``paper`` from the frame gate to the points, with its memory, in the native engine."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from amaranth.hdl import ClockDomain, ClockSignal, Module, ResetSignal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.frame_gate import FrameGate
from hdl.common.sram import SRAMPins, SRAMPort
from hdl.common.stage import Stage
from hdl.paper_points import REMAP_BASE, PaperPoints
from hdl.payloads import Counts, Detection, FrameInfo, GreyPixel, MemoryCommand, Point
from hdl.protocol import TABLES
from model.link.points import POINT
from model.preprocessing.area import coded_area
from model.preprocessing.remap import pack_remap
from scripts.paths import ROOT
from tb.native_block import Beats, NativeBlock, compile_block, pack, unpack
from tb.preprocessing.frames import BROKEN_GREY, grey_words

__all__ = ["Measured", "PaperBench", "frames_of"]


#: What a word at the rig's input is, and at its output.
_PIXEL, _MEMORY, _TABLE = range(3)
_POINT, _COUNTS, _FRAME = range(3)


class Table(data.Struct):
    """As the table port has it."""

    select: 2
    address: 10
    word: 72


class Inward(data.Struct):
    """A pixel, an access to the memory, or a word of a table."""

    kind: 2
    pixel: GreyPixel
    memory: MemoryCommand
    table: Table


class Outward(data.Struct):
    """A point, a frame's counts, or its announcement and how its spots were detected."""

    kind: 2
    point: Point
    counts: Counts
    frame: FrameInfo
    detection: Detection


class PaperRig(wiring.Component):
    """Pixels, memory words and table words in; points, counts and announcements out."""

    def __init__(self, config):
        self.config = config
        super().__init__({
            "i": In(stream.Signature(Inward)),
            "o": Out(stream.Signature(Outward)),
            "bank": In(1),
            "idle": Out(1),
            "free": Out(1),
            "lost": Out(8),
            "pins": Out(SRAMPins()),
            **PaperPoints.registers,
        })

    def elaborate(self, platform):
        m = Module()
        m.domains.spot = ClockDomain(local=True)
        m.d.comb += [
            ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]
        m.submodules.gate = gate = FrameGate()
        m.submodules.points = points = PaperPoints(self.config)
        m.submodules.port = port = SRAMPort(clients=3)
        m.submodules.out = out = Stage(Outward)
        connect(m, port.pins, flipped(self.pins))
        for client in range(2):
            connect(m, points.command[client], port.command[client])
            connect(m, port.answer[client], points.answer[client])
        pixel, memory, table = (self.i.p.kind == kind for kind in (_PIXEL, _MEMORY, _TABLE))
        m.d.comb += [
            gate.i.valid.eq(self.i.valid & pixel),
            gate.i.payload.eq(self.i.p.pixel),
            port.command[2].valid.eq(self.i.valid & memory),
            port.command[2].payload.eq(self.i.p.memory),
            points.table_write.eq(self.i.valid & table),
            points.table_select.eq(self.i.p.table.select),
            points.table_address.eq(self.i.p.table.address),
            points.table_data.eq(self.i.p.table.word),
            self.i.ready.eq(table | (pixel & gate.i.ready)
                            | (memory & port.command[2].ready)),
            points.i.valid.eq(gate.o.valid),
            points.i.payload.eq(gate.o.payload),
            gate.o.ready.eq(1),
            points.bank.eq(self.bank),
            self.idle.eq(points.idle), self.free.eq(points.info.ready), self.lost.eq(gate.lost),
            *(getattr(points, name).eq(getattr(self, name)) for name in points.registers),
        ]
        connect(m, gate.info, points.info)
        connect(m, out.o, flipped(self.o))
        with m.If(points.frames.valid & points.detections.valid):
            m.d.comb += [out.i.valid.eq(1), out.i.p.kind.eq(_FRAME),
                         out.i.p.frame.eq(points.frames.p),
                         out.i.p.detection.eq(points.detections.p),
                         points.frames.ready.eq(out.i.ready),
                         points.detections.ready.eq(out.i.ready)]
        with m.Elif(points.o.valid):
            m.d.comb += [out.i.valid.eq(1), out.i.p.kind.eq(_POINT), out.i.p.point.eq(points.o.p),
                         points.o.ready.eq(out.i.ready)]
        with m.Elif(points.counts.valid):
            m.d.comb += [out.i.valid.eq(1), out.i.p.kind.eq(_COUNTS),
                         out.i.p.counts.eq(points.counts.p),
                         points.counts.ready.eq(out.i.ready)]
        return m


@dataclass(frozen=True)
class Measured:
    """What was measured of a frame, and when.

    ``clocks`` are from the frame's first pixel to the last word about it, ``latency`` from its last
    pixel to the last point.
    """

    points: np.ndarray = field(repr=False)
    number: int
    level: int
    skipped: int
    spots: int
    rejected: int
    dropped: int
    broken: bool
    clocks: int
    latency: int


@cache
def _design(config):
    """The rig with its memory; elaborating it takes longer than most tests."""
    return compile_block(PaperRig(config), device=(
        (ROOT / "scripts" / "simulation" / "sram.hpp").read_text(), "StaticRAM ram;",
        "ram.look(top);"))


def _pixels(words):
    fields = unpack(GreyPixel, words)
    return pack(Inward, **{f"pixel_{name}": fields[name] for name in fields.dtype.names})


class PaperBench:
    """A rig with its tables loaded, which takes frames and gives what is measured."""

    def __init__(self, config, settings):
        self.block = block = NativeBlock(_design(config))
        self.config = config
        block.reset()
        block.set(bank=1, **{name: value for name, value in settings.registers().items()
                             if name in PaperPoints.registers})
        remap = pack_remap(settings.remap)
        self._load(kind=_MEMORY, memory_write=1, memory_lanes=0b1111,
                   memory_address=REMAP_BASE + np.arange(len(remap)), memory_data=remap)
        tables = settings.tables()
        for table in TABLES:
            words = tables[table.name]
            self._load(kind=_TABLE, table_select=table.number, table_address=np.arange(len(words)),
                       table_word=np.array(words, object))
        block.set(bank=0)

    def _load(self, table_word=None, **fields):
        length = max(np.size(value) for value in fields.values())
        words = pack(Inward, **{name: np.broadcast_to(value, length)
                                for name, value in fields.items()})
        if table_word is not None:
            start = Inward.as_shape()["table"].offset + Table.as_shape()["word"].offset
            for row, word in zip(words, table_word, strict=True):
                for part in range(len(row)):
                    row[part] |= (int(word) << start >> 32 * part) & 0xFFFFFFFF
        self.block.stream(words)

    def show(self, image, cut=None, gap=0.0, seed=1, idle=0, pixel_clocks=1):
        """Stream a frame, broken off after ``cut`` pixels, and wait for ``idle`` clocks.

        Gives what comes meanwhile, see :class:`tb.native_block.Beats`.
        """
        words = grey_words(image)
        if cut is not None:
            words = np.concatenate([words[:cut], BROKEN_GREY])
        pauses = np.full(len(words), pixel_clocks - 1)
        return self.block.stream(_pixels(words), gap=gap, seed=seed, idle=idle, pauses=pauses)

    def until_free(self, image):
        """Clocks from a frame's first pixel, one a clock, until another frame may begin."""
        start = int(self.show(image).taken[0])
        nothing = np.zeros((0, 1), np.uint32)
        while not self.block.get("free"):
            self.block.stream(nothing, idle=8)
        clocks = self.block.clocks - start
        while not self.block.get("idle"):
            self.block.stream(nothing, idle=1000)
        return clocks

    def measure(self, image, **stream):
        """Stream a frame and give what comes of it, see :class:`Measured`."""
        nothing = np.zeros((0, 1), np.uint32)
        limit = self.block.clocks + 4 * image.size + 60_000
        beats, ended = [self.show(image, **stream)], False
        while self.block.clocks < limit and not (ended and self.block.get("idle")):
            beats.append(self.block.stream(nothing, idle=4000))
            fields = beats[-1].fields(Outward)
            ended |= ((fields["kind"] == _POINT) & (fields["point_end"] == 1)).any()
        beats.append(self.block.stream(nothing, idle=100))  # whatever is still on its way
        measured, = frames_of(Beats(*(np.concatenate([getattr(some, name) for some in beats])
                                      for name in ("words", "clocks", "taken"))))
        return measured


def frames_of(beats):
    """:class:`Measured` of every frame whose points have come; times are from the first word."""
    fields = beats.fields(Outward)
    ends = np.flatnonzero((fields["kind"] == _POINT) & (fields["point_end"] == 1))
    counts = np.flatnonzero(fields["kind"] == _COUNTS)
    announced = np.flatnonzero(fields["kind"] == _FRAME)
    assert len(ends) == len(counts) == len(announced), "a frame without its counts"
    is_point = (fields["kind"] == _POINT) & (fields["point_end"] == 0)
    frames, start = [], 0
    for end, count, frame in zip(ends, counts, announced, strict=True):
        mine = start + np.flatnonzero(is_point[start:end])
        points = np.zeros(len(mine), POINT)
        for name in POINT.names:
            points[name] = fields[f"point_{name}"][mine]
        points["area"] = coded_area(points["area"])
        of_count, of_frame = fields[count], fields[frame]
        frames.append(Measured(
            points=points, number=int(of_frame["frame_number"]),
            level=int(of_frame["detection_level"]), skipped=int(of_frame["frame_skipped"]),
            **{name: int(of_count[f"counts_{name}"]) for name in ("spots", "rejected", "dropped")},
            broken=bool(of_count["counts_broken"]),
            clocks=int(max(beats.clocks[end], beats.clocks[count]) - beats.taken[0]),
            latency=int(beats.clocks[mine[-1] if len(mine) else end] - beats.taken[-1])))
        start = end + 1
    return frames
