"""Pattern frames to points in one pass: the threshold is learnt on the frame before."""

from amaranth.hdl import DomainRenamer, Module, Shape, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect, flipped

from .common.activity import Activity
from .config import FRAMES_IN_FLIGHT, check_config
from .payloads import Counts, FrameInfo, GreyPixel, Point
from .ports import TABLE_PORT, connect_ports, register_ports, sample_registers
from .preprocessing.binarise import Binarise
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.labelling import Labelling
from .preprocessing.threshold import Threshold
from .reconstruction import Reconstruction

__all__ = ["CapsulePoints"]


class CapsulePoints(wiring.Component):
    """Measures pattern frames as they pass, one pixel a clock, without a frame store.

    A frame is compared with the level learnt on the frame before, while its own histogram grows.
    The mask is eroded, labelled as it streams, and the spots are measured. Points of up to four
    frames may be on their way; while there are so many, ``info`` is not ready.

    The threshold and everything behind labelling are in the domain ``spot``. Its clock may stand
    still when ``active`` has been low for :data:`hdl.common.activity.IDLE_TIMEOUT` clocks, and must
    run again in the clock in which it rises.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Pattern frames.
    info : :py:`In(stream.Signature(FrameInfo))`
        Announcement of a frame, with its first pixel. Ready indicates that it may begin.
    level, threshold_valid : :py:`Out(8)`, :py:`Out(1)`
        Threshold for the next frame; whether one is known.
    o : :py:`Out(stream.Signature(Point))`
        Points and end markers.
    counts : :py:`Out(stream.Signature(Counts))`
        One for each frame.
    frames : :py:`Out(stream.Signature(FrameInfo))`
        Announcements of frames, for the link.
    idle : :py:`Out(1)`
        No frame passes, and no spot is on its way.
    active : :py:`Out(1)`
        Something passes between the blocks of the domain ``spot`` in this clock.
    bank, table_write, table_read, table_select, table_address, table_data, table_word
        As those of :class:`hdl.capsule.Capsule`.
    registers
        May change while ``idle``; each passes a flip-flop here. See ``hdl/protocol.py``.

    Attributes
    ----------
    registers : :class:`dict`
        Members for the registers that are used.
    """

    _pixel_registers = register_ports("erosion_mode", "weighted")
    _spot_registers = {
        **register_ports("threshold_alpha", "threshold_fixed", "threshold_level"),
        **Reconstruction.registers,
    }
    registers = {**_pixel_registers, **_spot_registers}

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "info": In(stream.Signature(FrameInfo)),
            "level": Out(8),
            "threshold_valid": Out(1),
            "o": Out(stream.Signature(Point)),
            "counts": Out(stream.Signature(Counts)),
            "frames": Out(stream.Signature(FrameInfo)),
            "idle": Out(1),
            "active": Out(1),
            **self.registers,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}
        spot_side = DomainRenamer("spot")
        register = sample_registers(m, self, dict.fromkeys(self._spot_registers, "spot"))

        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=FRAMES_IN_FLIGHT))
        connect(m, flipped(self.info), frame_info.w_stream)
        connect(m, frame_info.r_stream, flipped(self.frames))

        # The threshold. The histogram only watches the pixels pass.
        m.submodules.histogram = histogram = Histogram(**size)
        m.submodules.threshold = threshold = spot_side(Threshold(**size))
        m.d.comb += [
            histogram.i.valid.eq(self.i.valid & self.i.ready),
            histogram.i.payload.eq(self.i.payload),
            histogram.address.eq(threshold.address),
            *(getattr(threshold, name).eq(getattr(histogram, name))
              for name in ("closed", "done", "lost", "count")),
            threshold.threshold_alpha.eq(register["threshold_alpha"]),
            threshold.fixed.eq(register["threshold_fixed"]),
            threshold.fixed_level.eq(register["threshold_level"]),
            self.level.eq(threshold.level),
            self.threshold_valid.eq(threshold.threshold_valid),
        ]

        # Pixels to spots, spots to points.
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = Labelling(**size)
        m.submodules.reconstruction = reconstruction = spot_side(Reconstruction(config))
        connect(m, flipped(self.i), binarise.i)
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        connect(m, labelling.o, reconstruction.i)
        connect(m, reconstruction.o, flipped(self.o))
        connect(m, reconstruction.counts, flipped(self.counts))
        connect_ports(m, TABLE_PORT, self, reconstruction)
        m.d.comb += [
            binarise.level.eq(threshold.level),
            binarise.enable.eq(threshold.threshold_valid),
            erosion.mode.eq(register["erosion_mode"]),
            labelling.weighted.eq(register["weighted"]),
            *(getattr(reconstruction, name).eq(register[name])
              for name in reconstruction.registers),
        ]

        # A level is being computed from the histogram's closing until it is done or lost.
        level_pending = Signal()
        with m.If(histogram.closed | histogram.done | histogram.lost):
            m.d.sync += level_pending.eq(histogram.closed)
        m.d.comb += self.active.eq(
            reconstruction.active | self.table_write | self.table_read | self.info.valid
            | histogram.closed | level_pending | histogram.done | histogram.lost)

        # Spots are on their way from a frame's first pixel until nothing was active for so long
        # that none can be left.
        frame_passing = Signal()
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += frame_passing.eq(1)
        with m.Elif(histogram.done | histogram.lost):
            m.d.sync += frame_passing.eq(0)
        m.submodules.activity = activity = Activity()
        m.d.comb += [
            activity.active.eq(reconstruction.active | frame_passing),
            self.idle.eq(~activity.busy),
        ]
        return m
