"""Pattern frames to points in one pass: the levels are learnt on the frame before."""

from amaranth.hdl import DomainRenamer, Module, Mux, Shape, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect, flipped

from .common.activity import Activity
from .config import FRAMES_IN_FLIGHT, check_config
from .payloads import Counts, Detection, FrameInfo, GreyPixel, Point
from .ports import TABLE_PORT, connect_ports, register_ports, sample_registers
from .preprocessing.background import Background
from .preprocessing.hysteresis import Hysteresis
from .preprocessing.labelling import Labelling
from .preprocessing.noise import Noise
from .reconstruction import Reconstruction

__all__ = ["CapsulePoints"]


class CapsulePoints(wiring.Component):
    """Measures pattern frames as they pass, one pixel a clock, without a frame store.

    Each pixel is compared with the mean of the window around it. Pixels that lie above it by a
    multiple of the noise of the frame before are lit, while this frame's own noise is learnt.
    Components of lit pixels are found as they stream; those that have a core are spots, and are
    measured. Points of up to four frames may be on their way; while there are so many, ``info`` is
    not ready.

    Everything behind labelling is in the domain ``spot``. Its clock may stand still when ``active``
    has been low for :data:`hdl.common.activity.IDLE_TIMEOUT` clocks, and must run again in the
    clock in which it rises.

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
    o : :py:`Out(stream.Signature(Point))`
        Points and end markers.
    counts : :py:`Out(stream.Signature(Counts))`
        One for each frame.
    frames : :py:`Out(stream.Signature(FrameInfo))`
        Announcements of frames, for the link.
    detections : :py:`Out(stream.Signature(Detection))`
        How the spots of each frame were detected; there before the frame's end marker is.
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

    _pixel_registers = register_ports(*Noise.registers, *Background.registers, "weighted")
    _spot_registers = Reconstruction.registers
    registers = {**_pixel_registers, **_spot_registers}

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "info": In(stream.Signature(FrameInfo)),
            "o": Out(stream.Signature(Point)),
            "counts": Out(stream.Signature(Counts)),
            "frames": Out(stream.Signature(FrameInfo)),
            "detections": Out(stream.Signature(Detection)),
            "idle": Out(1),
            "active": Out(1),
            **self.registers,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        spot_side = DomainRenamer("spot")
        register = sample_registers(m, self, dict.fromkeys(self._spot_registers, "spot"))

        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=FRAMES_IN_FLIGHT))
        connect(m, flipped(self.info), frame_info.w_stream)
        connect(m, frame_info.r_stream, flipped(self.frames))

        # Pixels to spots, spots to points.
        background, noise = self._find(m, register)
        m.submodules.hysteresis = hysteresis = Hysteresis()
        m.submodules.labelling = labelling = Labelling(config.width, config.height)
        m.submodules.reconstruction = reconstruction = spot_side(Reconstruction(config))
        connect(m, background.o, hysteresis.i)
        connect(m, hysteresis.o, labelling.i)
        connect(m, reconstruction.o, flipped(self.o))
        connect(m, reconstruction.counts, flipped(self.counts))
        connect_ports(m, TABLE_PORT, self, reconstruction)
        # Components without a core are noise, and too many to be counted.
        is_spot = Signal()
        m.d.comb += [
            is_spot.eq(labelling.o.p.core | labelling.o.p.end),
            reconstruction.i.valid.eq(labelling.o.valid & is_spot),
            reconstruction.i.payload.eq(labelling.o.payload),
            labelling.o.ready.eq(reconstruction.i.ready | ~is_spot),
            hysteresis.lit.eq(noise.lit),
            hysteresis.core.eq(noise.core),
            hysteresis.enable.eq(noise.valid),
            labelling.weighted.eq(register["weighted"]),
            *(getattr(reconstruction, name).eq(register[name])
              for name in reconstruction.registers),
        ]
        detected = self._detections(m, background, noise)
        m.d.comb += self.active.eq(
            reconstruction.active | self.table_write | self.table_read | self.info.valid | detected)

        # A frame passes from its first pixel until labelling has sent its end marker; then spots
        # are on their way until nothing was active for so long that none can be left.
        passing = Signal(range(FRAMES_IN_FLIGHT + 1))
        m.d.sync += passing.eq(
            passing + (self.info.valid & self.info.ready)
            - (labelling.o.valid & labelling.o.ready & labelling.o.p.end))
        m.submodules.activity = activity = Activity()
        m.d.comb += [
            activity.active.eq(reconstruction.active | passing.any()),
            self.idle.eq(~activity.busy),
        ]
        return m

    def _find(self, m, register):
        """Contrasts of pixels, and the levels that they are compared with."""
        config = self.config
        m.submodules.background = background = Background(config.width, config.mean_window)
        m.submodules.noise = noise = Noise(config.width, config.height)
        connect(m, flipped(self.i), background.i)
        m.d.comb += [
            noise.i.valid.eq(background.o.valid & background.o.ready),
            noise.i.payload.eq(background.o.payload),
            background.dent.eq(noise.dent),
            *(getattr(block, name).eq(register[name]) for block in (background, noise)
              for name in block.registers),
        ]
        return background, noise

    def _detections(self, m, background, noise):
        """One for each frame, with its last contrast; high when one is stored."""
        m.submodules.detection_fifo = stored = DomainRenamer("spot")(SyncFIFO(
            width=Shape.cast(Detection).width, depth=FRAMES_IN_FLIGHT))
        connect(m, stored.r_stream, flipped(self.detections))
        detection = Signal(Detection)
        pixel = background.o.p
        saturated = Signal(range(self.config.width * self.config.height + 1))
        m.d.comb += [
            stored.w_en.eq(noise.i.valid & pixel.marker.frame_end),
            stored.w_data.eq(detection),
            detection.learning.eq(~noise.valid),
            detection.level.eq(noise.lit),
            detection.noise.eq(noise.grey_noise),
            detection.saturated.eq(saturated + pixel.saturated),
        ]
        with m.If(noise.i.valid):
            m.d.sync += saturated.eq(Mux(pixel.marker.frame_end, 0, detection.saturated))
        return stored.w_en
