"""Pattern frames to points, as the paper has it: stored, learnt from, and read again."""

from amaranth.hdl import C, Cat, DomainRenamer, Module, Mux, Shape, Signal, signed
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect, flipped

from .acquisition.image_bank import ImageBank
from .common.stage import Stage
from .common.table_memory import TableMemory
from .config import Config
from .payloads import (
    COORDINATE_BITS,
    Counts,
    FrameInfo,
    GreyPixel,
    MemoryCommand,
    Point,
    Spot,
    StoredFrame,
    Undistorted,
)
from .preprocessing.binarise import Binarise
from .preprocessing.centre import Centring
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.remap import Remap
from .preprocessing.spot_queue import SpotQueue
from .preprocessing.threshold import Threshold
from .preprocessing.two_pass_labelling import TwoPassLabelling
from .protocol import TABLES
from .stereo.depth import Depth
from .stereo.epipolar import Epipolar
from .stereo.undistort import Undistort

__all__ = ["FREE_BASE", "LABEL_BASE", "REGISTERS", "REMAP_BASE", "PaperPoints"]

#: First words in the external memory of the table of places and of the image of labels, both with
#: two pixels to a word, and of what is free.
REMAP_BASE, LABEL_BASE, FREE_BASE = 0, 1 << 17, 1 << 18
#: Clocks from spot to spot: as many as the slowest takes to become a point, so that the burst in
#: which labelling reports a frame does not flood the queue.
_SPOT_CLOCKS = 22
#: Frames whose points may still be on their way when the next one starts.
_FRAMES_IN_FLIGHT = 4
#: Registers that are heard, by their names in :mod:`hdl.protocol`.
REGISTERS = {
    "threshold_fixed": 1,
    "threshold_level": 8,
    "alpha": 8,
    "erosion_mode": 2,
    "area_min": 8,
    "area_max": 8,
    "report_rejected": 1,
    "principal_u": COORDINATE_BITS,
    "principal_v": COORDINATE_BITS,
    "tangential_1": signed(18),
    "tangential_2": signed(18),
}


class PaperPoints(wiring.Component):
    """Measures pattern frames in the paper's order.

    A frame is stored as it arrives, while its histogram grows. Its level is learnt from all of its
    pixels; then it is read again, through the table that corrects the whole image, made into a
    mask, eroded, labelled in two passes over an image of labels, and its spots are measured as in
    the preset ``capsule``, with all epipolar lines at once where lanes = beams. Pixels weigh 1.

    Both of the paper's corrections are there: with a lens in the table of places, the registers and
    the radial table are those of a lens without distortion; with a table in which every pixel
    shows itself, they are the lens's.

    A frame may begin while ``info`` is ready: while the one image bank is free, the bins are
    clean, and fewer than four frames are still on their way to the reader. After a frame's last
    pixel it takes at most 900 clocks to learn the level and two clocks a pixel to read the image
    again, which frees the bank; one more clock a pixel, three a label and 22 a spot are spent on
    the second pass, while the next frame may be stored already.

    Two clients of the external memory: 0 the image of labels, 1 the table of places, whose word n
    is at :data:`REMAP_BASE` + n, see :class:`.preprocessing.remap.Remap`.

    Spots are worked on in the domain ``spot``. It may stand still when ``moves`` has been low for
    some time, and must go on in the clock in which it rises.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel, always_ready=True))`
        Pattern frames.
    info : :py:`In(stream.Signature(FrameInfo))`
        What is known of a frame, with its first pixel. Ready tells whether it may begin.
    o : :py:`Out(stream.Signature(Point))`
        Points; u and v are places in the corrected image.
    counts : :py:`Out(stream.Signature(Counts))`
        One for each frame. Those that labelling had to drop are among ``spots`` and ``dropped``.
    number : :py:`Out(16)`
        Number of the frame whose points are coming, end mark included.
    frames : :py:`Out(stream.Signature(FrameInfo))`
        What is known of a frame, with its own level.
    corrected, corrected_info : :py:`Out(stream.Signature(GreyPixel, always_ready=True))`, \
    :py:`Out(StoredFrame)`
        The corrected image as it passes, for a display, and what is known of it with its first
        pixel.
    idle : :py:`Out(1)`
        No frame is stored, and no spot is under way.
    moves : :py:`Out(1)`
        Something moves between the blocks that work on spots.
    command, answer
        To the external memory, see :class:`hdl.common.sram.SRAMPort`.
    bank, table_write, table_read, table_select, table_address, table_data, table_word
        As those of :class:`hdl.capsule.Capsule`.
    REGISTERS
        May change while ``idle``. See ``hdl/protocol.py``.
    """

    def __init__(self, config):
        if not isinstance(config, Config):
            raise TypeError(f"The configuration must be a Config, not {config!r}")
        self.config = config
        super().__init__({
            "i": In(stream.Signature(GreyPixel, always_ready=True)),
            "info": In(stream.Signature(FrameInfo)),
            "o": Out(stream.Signature(Point)),
            "counts": Out(stream.Signature(Counts)),
            "number": Out(16),
            "frames": Out(stream.Signature(FrameInfo)),
            "corrected": Out(stream.Signature(GreyPixel, always_ready=True)),
            "corrected_info": Out(StoredFrame),
            "idle": Out(1),
            "moves": Out(1),
            "command": Out(stream.Signature(MemoryCommand)).array(2),
            "answer": In(stream.Signature(32, always_ready=True)).array(2),
            **{name: In(shape) for name, shape in REGISTERS.items()},
            "bank": In(1),
            "table_write": In(1),
            "table_read": In(1),
            "table_select": In(2),
            "table_address": In(10),
            "table_data": In(72),
            "table_word": Out(72),
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}
        spot_side = DomainRenamer("spot")

        # First reading: the frame is stored, the histogram listens.
        m.submodules.image_bank = bank = ImageBank(**size)
        m.submodules.histogram = histogram = Histogram(**size, whole=True)
        m.submodules.threshold = threshold = Threshold(**size, whole=True)
        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=_FRAMES_IN_FLIGHT))
        connect(m, flipped(self.i), bank.i)
        m.d.comb += [
            histogram.i.valid.eq(self.i.valid),
            histogram.i.payload.eq(self.i.payload),
            histogram.address.eq(threshold.address),
            histogram.clear.eq(threshold.known),
            threshold.closed.eq(histogram.closed),
            threshold.done.eq(threshold.known),
            threshold.lost.eq(histogram.lost),
            threshold.count.eq(histogram.count),
            threshold.alpha.eq(self.alpha),
            threshold.fixed.eq(self.threshold_fixed),
            threshold.fixed_level.eq(self.threshold_level),
        ]

        # A frame is announced when its level is known, or when it has turned out to be broken.
        # Only then it is read again.
        under_way = Signal(range(_FRAMES_IN_FLIGHT + 1))
        waiting, learnt = Signal(), Signal()
        known_of_it = Signal(FrameInfo)
        announced = Signal(FrameInfo)
        level = Signal(8)
        announces = Signal()
        m.d.comb += [
            self.info.ready.eq(bank.free & histogram.clean & frame_info.w_rdy
                               & (under_way < _FRAMES_IN_FLIGHT)),
            announces.eq(waiting & bank.stored.valid & (bank.stored.p | learnt)),
            announced.eq(known_of_it),
            announced.level.eq(threshold.level),
            announced.learning.eq(0),
            frame_info.w_en.eq(announces),
            frame_info.w_data.eq(announced),
        ]
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += [waiting.eq(1), learnt.eq(0), known_of_it.eq(self.info.p)]
        with m.If(announces):
            m.d.sync += [waiting.eq(0), level.eq(threshold.level)]
        with m.If(threshold.known):
            m.d.sync += learnt.eq(1)
        connect(m, frame_info.r_stream, flipped(self.frames))

        # Second reading, through the table of places.
        m.submodules.remap = remap = Remap(**size)
        m.d.comb += [
            remap.start.valid.eq(bank.stored.valid & ~waiting),
            remap.start.payload.eq(bank.stored.payload),
            bank.stored.ready.eq(remap.start.ready & ~waiting),
            bank.address.eq(remap.address),
            bank.read.eq(remap.read),
            remap.grey.eq(bank.grey),
            self.command[1].valid.eq(remap.ask.valid),
            self.command[1].p.address.eq(REMAP_BASE + remap.ask.p),
            remap.ask.ready.eq(self.command[1].ready),
            remap.answer.valid.eq(self.answer[1].valid),
            remap.answer.payload.eq(self.answer[1].p),
        ]

        m.d.comb += [
            self.corrected.valid.eq(remap.o.valid & remap.o.ready),
            self.corrected.payload.eq(remap.o.payload),
            self.corrected_info.number.eq(known_of_it.number),
        ]

        # Spots. While the last pixels of a frame wait for labelling, the next frame's level may
        # already be known: each keeps the one that its first pixel met.
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = TwoPassLabelling(
            **size, labels=config.labels, base=LABEL_BASE, interval=_SPOT_CLOCKS)
        m.submodules.spot_stage = spot_stage = spot_side(Stage(Spot))
        m.submodules.spot_queue = spot_queue = spot_side(SpotQueue(config.spot_depth))
        m.submodules.centre = centre = spot_side(Centring())
        inside, kept_level = Signal(), Signal(8)
        with m.If(remap.o.valid & remap.o.ready):
            m.d.sync += inside.eq(~remap.o.p.mark.frame_end)
        with m.If(~inside):
            m.d.sync += kept_level.eq(level)
        connect(m, remap.o, binarise.i)
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        connect(m, labelling.o, spot_stage.i)
        connect(m, spot_stage.o, spot_queue.i)
        connect(m, spot_queue.o, centre.i)
        connect(m, labelling.command, flipped(self.command[0]))
        connect(m, flipped(self.answer[0]), labelling.answer)
        m.d.comb += [
            binarise.level.eq(Mux(inside, kept_level, level)),
            binarise.enable.eq(1),
            erosion.mode.eq(self.erosion_mode),
            spot_queue.area_min.eq(self.area_min),
            spot_queue.area_max.eq(self.area_max),
            spot_queue.report_rejected.eq(self.report_rejected),
        ]

        # Components that labelling had no labels for are counted with the others.
        m.submodules.unlabelled = unlabelled = spot_side(SyncFIFO(
            width=16, depth=_FRAMES_IN_FLIGHT))
        m.d.comb += [
            unlabelled.w_en.eq(spot_stage.o.valid & spot_stage.o.p.end),
            unlabelled.w_data.eq(labelling.dropped),
            unlabelled.r_en.eq(self.counts.valid & self.counts.ready),
            self.counts.valid.eq(spot_queue.counts.valid),
            self.counts.payload.eq(spot_queue.counts.payload),
            spot_queue.counts.ready.eq(self.counts.ready),
        ]
        for name in ("spots", "dropped"):
            total = Signal(17, name=f"total_{name}")
            m.d.comb += [
                total.eq(spot_queue.counts.p[name] + unlabelled.r_data),
                self.counts.p[name].eq(total[:16] | total[16].replicate(16)),
            ]

        # Stereo.
        m.submodules.undistort = undistort = spot_side(Undistort(**size))
        m.submodules.match_stage = match_stage = spot_side(Stage(Undistorted))
        m.submodules.epipolar = epipolar = spot_side(Epipolar(config.beams, config.lanes))
        m.submodules.depth = depth = spot_side(Depth())
        connect(m, centre.o, undistort.i)
        connect(m, undistort.o, match_stage.i)
        connect(m, match_stage.o, epipolar.i)
        connect(m, epipolar.o, depth.i)
        connect(m, depth.o, flipped(self.o))
        m.d.comb += [
            undistort.principal_u.eq(self.principal_u),
            undistort.principal_v.eq(self.principal_v),
            undistort.tangential_1.eq(self.tangential_1),
            undistort.tangential_2.eq(self.tangential_2),
        ]

        # Tables. Depth and reciprocals share a memory, each block with a port of its own.
        m.submodules.shared_table = shared_table = spot_side(TableMemory(config.beams))
        chosen = {table.name: Signal(name=f"is_{table.name}") for table in TABLES}
        shared = chosen["depth"] | chosen["reciprocal"]
        m.d.comb += [
            *(chosen[table.name].eq(self.table_select == table.number) for table in TABLES),
            *(block.bank.eq(self.bank) for block in (shared_table, undistort, epipolar)),
            *(block.write_bank.eq(~self.bank) for block in (shared_table, undistort, epipolar)),
            shared_table.a_address.eq(depth.table_address),
            depth.table_data.eq(shared_table.a_data),
            shared_table.b_address.eq(Cat(centre.table_address, C(1, 1))),
            centre.table_data.eq(shared_table.b_data),
            shared_table.write_enable.eq(self.table_write & shared),
            shared_table.read_enable.eq(self.table_read & shared),
            shared_table.write_address.eq(Cat(self.table_address[:8], chosen["reciprocal"])),
            shared_table.write_data.eq(self.table_data),
            undistort.radial_write_enable.eq(self.table_write & chosen["radial"]),
            undistort.radial_write_address.eq(self.table_address),
            undistort.radial_write_data.eq(self.table_data),
            epipolar.write_enable.eq(self.table_write & chosen["beams"]),
            epipolar.read_enable.eq(self.table_read & chosen["beams"]),
            epipolar.write_address.eq(self.table_address),
            epipolar.write_line.eq(self.table_data[:36]),
            epipolar.write_window.eq(self.table_data[36:]),
        ]
        read = Signal()
        m.d.spot += read.eq(self.table_read)
        with m.If(read):
            with m.If(chosen["radial"]):
                m.d.spot += self.table_word.eq(undistort.radial_read_data)
            with m.Elif(chosen["beams"]):
                m.d.spot += self.table_word.eq(Cat(epipolar.read_line, epipolar.read_window))
            with m.Else():
                m.d.spot += self.table_word.eq(shared_table.a_data)

        # A frame is under way from its first pixel until its end mark has left the depth block.
        m.submodules.numbers = numbers = spot_side(SyncFIFO(width=16, depth=_FRAMES_IN_FLIGHT))
        begins, ends = Signal(), Signal()
        m.d.comb += [
            begins.eq(self.info.valid & self.info.ready),
            ends.eq(depth.o.valid & depth.o.ready & depth.o.p.end),
            self.idle.eq(under_way == 0),
            self.moves.eq(Cat(
                self.table_write, self.table_read, read, announces, labelling.o.valid,
                spot_stage.o.valid, spot_queue.o.valid, spot_queue.counts.valid, centre.o.valid,
                undistort.o.valid, match_stage.o.valid, epipolar.o.valid, depth.o.valid).any()),
            numbers.w_en.eq(announces),
            numbers.w_data.eq(known_of_it.number),
            numbers.r_en.eq(ends),
            self.number.eq(numbers.r_data),
        ]
        with m.If(begins & ~ends):
            m.d.sync += under_way.eq(under_way + 1)
        with m.Elif(ends & ~begins):
            m.d.sync += under_way.eq(under_way - 1)
        return m
