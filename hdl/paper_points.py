"""Pattern frames to points in two passes, as the paper does it: stored, then read again."""

from amaranth.hdl import DomainRenamer, Module, Mux, Shape, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect, flipped

from .acquisition.image_bank import ImageBank
from .config import FRAMES_IN_FLIGHT, check_config
from .payloads import (
    CONTRAST_FRACTION_BITS,
    Counts,
    Detection,
    FrameInfo,
    GreyPixel,
    MemoryCommand,
    Point,
    StoredFrame,
)
from .ports import TABLE_PORT, connect_ports, register_ports, sample_registers
from .preprocessing.binarise import Binarise
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.remap import Remap
from .preprocessing.threshold import Threshold
from .preprocessing.two_pass_labelling import TwoPassLabelling
from .reconstruction import Reconstruction

__all__ = ["FREE_BASE", "LABEL_BASE", "REMAP_BASE", "PaperPoints"]

#: First words in the external memory of the remap table and of the image of labels, both with
#: two pixels to a word, and of what is free.
REMAP_BASE, LABEL_BASE, FREE_BASE = 0, 1 << 17, 1 << 18
#: Clocks from spot to spot: as many as the slowest takes to become a point, so that the burst in
#: which labelling reports a frame does not flood the queue.
_SPOT_CLOCKS = 22


class PaperPoints(wiring.Component):
    """Measures pattern frames in the paper's order.

    A frame is stored as it arrives, while its histogram grows. Its threshold is learnt from all of
    its pixels; then it is read again, through the remap table that corrects the whole image,
    compared with the threshold, eroded, labelled in two passes over an image of labels, and its
    spots are measured as in the preset ``capsule``, with all epipolar lines at once if lanes =
    beams. Pixels weigh 1.

    Both of the paper's corrections are there: with a lens in the remap table, the registers and
    the radial table are those of a lens without distortion; with a remap table that maps every
    pixel to itself, they are the lens's.

    A frame may begin while ``info`` is ready: the image bank is free, the histogram is clear, and
    fewer than four frames are still on their way to the reader. After a frame's last pixel it takes
    at most 900 clocks to learn the threshold and two clocks a pixel to read the image again, which
    frees the bank. The second pass takes one more clock a pixel, three a label and 22 a spot, while
    the next frame may be stored already.

    Two clients of the external memory: 0 the image of labels, 1 the remap table, whose word n
    is at :data:`REMAP_BASE` + n, see :class:`.preprocessing.remap.Remap`.

    Blocks that work on spots are in the domain ``spot``. Its clock may stand still when ``active``
    has been low for :data:`hdl.common.activity.IDLE_TIMEOUT` clocks, and must run again in the
    clock in which it rises.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel, always_ready=True))`
        Pattern frames.
    info : :py:`In(stream.Signature(FrameInfo))`
        Announcement of a frame, with its first pixel. Ready indicates that it may begin.
    o : :py:`Out(stream.Signature(Point))`
        Points; u and v are in the corrected image.
    counts : :py:`Out(stream.Signature(Counts))`
        One for each frame. Those that labelling had to drop are among ``spots`` and ``dropped``.
    number : :py:`Out(16)`
        Number of the frame whose points are coming, end marker included.
    frames : :py:`Out(stream.Signature(FrameInfo))`
        Announcement of a frame.
    detections : :py:`Out(stream.Signature(Detection))`
        One for each frame, with its own threshold as the level.
    corrected, corrected_info : :py:`Out(stream.Signature(GreyPixel, always_ready=True))`, \
    :py:`Out(StoredFrame)`
        The corrected image as it passes, for a display, and its number with its first pixel.
    idle : :py:`Out(1)`
        No frame is stored, and no spot is on its way.
    active : :py:`Out(1)`
        Something passes between the blocks of the domain ``spot`` in this clock.
    command, answer
        To the external memory, see :class:`hdl.common.sram.SRAMPort`.
    bank, table_write, table_read, table_select, table_address, table_data, table_word
        As those of :class:`hdl.capsule.Capsule`.
    registers
        May change while ``idle``; each passes a flip-flop here. See ``hdl/protocol.py``.

    Attributes
    ----------
    registers : :class:`dict`
        Members for the registers that are used.
    """

    registers = {
        **register_ports("threshold_fixed", "threshold_level", "threshold_alpha", "erosion_mode"),
        **Reconstruction.registers,
    }

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            "i": In(stream.Signature(GreyPixel, always_ready=True)),
            "info": In(stream.Signature(FrameInfo)),
            "o": Out(stream.Signature(Point)),
            "counts": Out(stream.Signature(Counts)),
            "number": Out(16),
            "frames": Out(stream.Signature(FrameInfo)),
            "detections": Out(stream.Signature(Detection)),
            "corrected": Out(stream.Signature(GreyPixel, always_ready=True)),
            "corrected_info": Out(StoredFrame),
            "idle": Out(1),
            "active": Out(1),
            "command": Out(stream.Signature(MemoryCommand)).array(2),
            "answer": In(stream.Signature(32, always_ready=True)).array(2),
            **self.registers,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        register = sample_registers(m, self)
        stored_info, announce, announce_pending = Signal(FrameInfo), Signal(), Signal()
        level = Signal(8)
        frames = Signal(range(FRAMES_IN_FLIGHT + 1))  # in progress
        bank = self._store(m, register, frames, stored_info, announce, announce_pending, level)
        remap = self._read_again(m, bank, stored_info, announce_pending)
        labelling, reconstruction = self._measure(m, remap, register, level)
        self._sum_counts(m, labelling, reconstruction)

        # A frame is in progress from its first pixel until its end marker has left as a point.
        m.submodules.numbers = numbers = DomainRenamer("spot")(
            SyncFIFO(width=16, depth=FRAMES_IN_FLIGHT))
        begin, end = Signal(), Signal()
        m.d.comb += [
            begin.eq(self.info.valid & self.info.ready),
            end.eq(self.o.valid & self.o.ready & self.o.p.end),
            self.idle.eq(frames == 0),
            self.active.eq(reconstruction.active | announce | self.table_write | self.table_read),
            numbers.w_en.eq(announce),
            numbers.w_data.eq(stored_info.number),
            numbers.r_en.eq(end),
            self.number.eq(numbers.r_data),
        ]
        with m.If(begin & ~end):
            m.d.sync += frames.eq(frames + 1)
        with m.Elif(end & ~begin):
            m.d.sync += frames.eq(frames - 1)
        return m

    def _store(self, m, register, frames, stored_info, announce, announce_pending, level):
        """First pass: the frame is stored, counted by the histogram, and announced.

        It is announced when its threshold is known, or when it is broken. Then it is read again.
        """
        size = {"width": self.config.width, "height": self.config.height}
        m.submodules.image_bank = bank = ImageBank(**size)
        m.submodules.histogram = histogram = Histogram(**size, whole=True)
        m.submodules.threshold = threshold = Threshold(**size, whole=True)
        m.submodules.frame_info = frame_info = DomainRenamer("spot")(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=FRAMES_IN_FLIGHT))
        connect(m, flipped(self.i), bank.i)
        connect(m, frame_info.r_stream, flipped(self.frames))
        m.submodules.levels = levels = DomainRenamer("spot")(SyncFIFO(
            width=8, depth=FRAMES_IN_FLIGHT))
        threshold_valid = Signal()
        m.d.comb += [
            histogram.i.valid.eq(self.i.valid),
            histogram.i.payload.eq(self.i.payload),
            histogram.address.eq(threshold.address),
            histogram.clear.eq(threshold.known),
            threshold.closed.eq(histogram.closed),
            threshold.done.eq(threshold.known),
            threshold.lost.eq(histogram.lost),
            threshold.count.eq(histogram.count),
            threshold.threshold_alpha.eq(register["threshold_alpha"]),
            threshold.fixed.eq(register["threshold_fixed"]),
            threshold.fixed_level.eq(register["threshold_level"]),
            self.info.ready.eq(bank.free & histogram.clean & frame_info.w_rdy
                               & (frames < FRAMES_IN_FLIGHT)),
            announce.eq(announce_pending & bank.stored.valid & (bank.stored.p | threshold_valid)),
            frame_info.w_en.eq(announce),
            frame_info.w_data.eq(stored_info),
            levels.w_en.eq(announce),
            levels.w_data.eq(threshold.level),
            self.detections.valid.eq(levels.r_rdy),
            self.detections.p.level.eq(levels.r_data << CONTRAST_FRACTION_BITS),
            levels.r_en.eq(self.detections.ready),
        ]
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += [
                announce_pending.eq(1), threshold_valid.eq(0), stored_info.eq(self.info.p)]
        with m.If(announce):
            m.d.sync += [announce_pending.eq(0), level.eq(threshold.level)]
        with m.If(threshold.known):
            m.d.sync += threshold_valid.eq(1)
        return bank

    def _read_again(self, m, bank, stored_info, announce_pending):
        """Second pass, through the remap table."""
        m.submodules.remap = remap = Remap(self.config.width, self.config.height)
        m.d.comb += [
            remap.start.valid.eq(bank.stored.valid & ~announce_pending),
            remap.start.payload.eq(bank.stored.payload),
            bank.stored.ready.eq(remap.start.ready & ~announce_pending),
            bank.address.eq(remap.address),
            bank.read.eq(remap.read),
            remap.grey.eq(bank.grey),
            self.command[1].valid.eq(remap.ask.valid),
            self.command[1].p.address.eq(REMAP_BASE + remap.ask.p),
            remap.ask.ready.eq(self.command[1].ready),
            remap.answer.valid.eq(self.answer[1].valid),
            remap.answer.payload.eq(self.answer[1].p),
            self.corrected.valid.eq(remap.o.valid & remap.o.ready),
            self.corrected.payload.eq(remap.o.payload),
            self.corrected_info.number.eq(stored_info.number),
        ]
        return remap

    def _measure(self, m, remap, register, level):
        """Pixels to spots, spots to points."""
        config = self.config
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = TwoPassLabelling(
            config.width, config.height, labels=config.labels, base=LABEL_BASE,
            interval=_SPOT_CLOCKS)
        m.submodules.reconstruction = reconstruction = DomainRenamer("spot")(
            Reconstruction(config))
        connect(m, remap.o, binarise.i)
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        connect(m, labelling.o, reconstruction.i)
        connect(m, reconstruction.o, flipped(self.o))
        connect(m, labelling.command, flipped(self.command[0]))
        connect(m, flipped(self.answer[0]), labelling.answer)
        connect_ports(m, TABLE_PORT, self, reconstruction)
        # While the last pixels of a frame wait for labelling, the threshold of the next one may
        # already be known: each frame keeps the one of its first pixel.
        inside, kept_level = Signal(), Signal(8)
        with m.If(remap.o.valid & remap.o.ready):
            m.d.sync += inside.eq(~remap.o.p.marker.frame_end)
        with m.If(~inside):
            m.d.sync += kept_level.eq(level)
        m.d.comb += [
            binarise.level.eq(Mux(inside, kept_level, level)),
            binarise.enable.eq(1),
            erosion.mode.eq(register["erosion_mode"]),
            *(getattr(reconstruction, name).eq(register[name])
              for name in reconstruction.registers),
        ]
        return labelling, reconstruction

    def _sum_counts(self, m, labelling, reconstruction):
        """Components for which there were no labels are counted with the others."""
        m.submodules.unlabelled = unlabelled = DomainRenamer("spot")(SyncFIFO(
            width=16, depth=FRAMES_IN_FLIGHT))
        m.d.comb += [
            unlabelled.w_en.eq(labelling.o.valid & labelling.o.ready & labelling.o.p.end),
            unlabelled.w_data.eq(labelling.dropped),
            unlabelled.r_en.eq(self.counts.valid & self.counts.ready),
            self.counts.valid.eq(reconstruction.counts.valid),
            self.counts.payload.eq(reconstruction.counts.payload),
            reconstruction.counts.ready.eq(self.counts.ready),
        ]
        for name in ("spots", "dropped"):
            total = Signal(17, name=f"total_{name}")
            m.d.comb += [
                total.eq(reconstruction.counts.p[name] + unlabelled.r_data),
                self.counts.p[name].eq(total[:16] | total[16].replicate(16)),
            ]
