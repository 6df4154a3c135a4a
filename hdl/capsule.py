"""The whole capsule: camera pins in, serial pin out."""

from amaranth.hdl import ClockDomain, ClockSignal, DomainRenamer, Module, ResetSignal, Shape, Signal
from amaranth.lib import wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import Out, connect

from .config import FRAMES_IN_FLIGHT, check_config
from .payloads import FrameInfo
from .periphery import LINGER, PORTS, Periphery, camera_pins
from .ports import REGISTERS, TABLE_PORT, connect_ports
from .preprocessing.binarise import Binarise
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.labelling import Labelling
from .preprocessing.threshold import Threshold
from .reconstruction import Reconstruction

__all__ = ["Capsule"]

_SPOT_SIDE = ("threshold_alpha", "threshold_fixed", "threshold_level", *Reconstruction.registers)
_PIXEL_SIDE = ("erosion_mode", "weighted")


class Capsule(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points.

    Takes one pixel a clock, frames back to back, whatever the image. All it cannot keep is
    counted and told to the reader: spots for which the queue has no room, frames that lost
    synchronism, frames that were skipped because four others were still on their way.

    Pixels come every clock, spots rarely. What works on spots and on the threshold is in a clock
    domain of its own, ``spot``, which is ``sync`` unless ``clock_gated``: then its clock is a port,
    and may stand still in every clock in which ``busy`` is low, without any difference to what
    comes out. On a device with clock gates that saves power; in a simulation, time.

    Tables have two banks, the reciprocals excepted. Spots are measured with bank ``bank``, the
    host writes and reads back the other one. It may do so while ``idle`` is high; its accesses
    may borrow a block's memory port, so at other times they would spoil points.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.
    clock_gated : :class:`bool`
        Make the clock of the spot side a port, ``spot_clk``, with ``spot_rst``.

    Members
    -------
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        The camera's pins, sampled at each rising edge in the domain ``pixel``.
    row, column, convert, data, sensor_read
        In their place if the configuration has a converter, see
        :class:`.acquisition.addressed_camera.AddressedCamera`.
    tag : :py:`In(FrameTag)`
        How the frame at the pins was exposed. Texture frames only go to the link.
    tripped, tables_valid : :py:`In(1)`
        State of the laser guard and of the tables, told to the reader with each frame.
    reply : :py:`In(stream.Signature(PacketOctet))`
        Answers to the host.
    tx, cts : :py:`Out(1)`, :py:`In(1)`
        The serial pin, 8N1, at ``divisor`` clocks a bit; may it send.
    busy : :py:`Out(1)`
        The spot side needs its clock.
    wake : :py:`In(1)`
        Registers may be about to change: lets the spot side's clock go on to hear of it.
    idle : :py:`Out(1)`
        No pattern frame passes, and no spot is under way: tables and registers may change.
    frame_begun, frame_ended, frame_broken : :py:`Out(1)`
        High for a clock with a frame's first pixel, with its last, and with loss of synchronism.
    frame_sending : :py:`Out(1)`
        The camera is sending a frame, whole or not.
    bad_sync, overrun, skipped : :py:`Out(8)`
        Frames that lost synchronism, that lost pixels between the clocks, that were left out for
        want of room, since reset; they stop at 255.
    packets : :py:`Out(16)`
        Packets sent, modulo 65536.
    sending : :py:`Out(1)`
        A packet is on the line, or waits for it.
    REGISTERS
        May change while ``idle``. See ``hdl/protocol.py``.
    bank : :py:`In(1)`
        Bank of the tables that spots are measured with.
    table_write, table_read, table_select, table_address, table_data
        Writes or reads a word of the other bank; the number of the table and the words are those
        of :data:`hdl.protocol.TABLES`.
    table_word : :py:`Out(72)`
        The word, from the second clock after ``table_read`` to the next read.
    """

    def __init__(self, config, clock_gated=False):
        check_config(config)
        self.config = config
        self.clock_gated = clock_gated
        super().__init__({
            **camera_pins(config),
            **PORTS,
            "idle": Out(1),
            **REGISTERS,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}

        spot_side = DomainRenamer("spot")
        if not self.clock_gated:
            m.domains.spot = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]
        register = {}
        for domain, names in (("spot", _SPOT_SIDE), ("sync", _PIXEL_SIDE)):
            for name in names:
                register[name] = Signal(REGISTERS[name].shape, name=name)
                m.d[domain] += register[name].eq(getattr(self, name))

        # From the camera, and to the link.
        m.submodules.periphery = periphery = Periphery(config)
        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=FRAMES_IN_FLIGHT))
        connect_ports(m, {**camera_pins(config), **PORTS, **periphery.registers}, self, periphery)
        connect(m, periphery.info, frame_info.w_stream)
        connect(m, frame_info.r_stream, periphery.frames)

        # Preprocessing. The histogram only listens.
        m.submodules.histogram = histogram = Histogram(**size)
        m.submodules.threshold = threshold = spot_side(Threshold(**size))
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = Labelling(**size)
        connect(m, periphery.o, binarise.i)
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        m.d.comb += [
            histogram.i.valid.eq(periphery.o.valid & periphery.o.ready),
            histogram.i.payload.eq(periphery.o.payload),
            threshold.closed.eq(histogram.closed),
            threshold.done.eq(histogram.done),
            threshold.lost.eq(histogram.lost),
            histogram.address.eq(threshold.address),
            threshold.count.eq(histogram.count),
            threshold.threshold_alpha.eq(register["threshold_alpha"]),
            threshold.fixed.eq(register["threshold_fixed"]),
            threshold.fixed_level.eq(register["threshold_level"]),
            periphery.level.eq(threshold.level),
            periphery.threshold_valid.eq(threshold.threshold_valid),
            binarise.level.eq(threshold.level),
            binarise.enable.eq(threshold.threshold_valid),
            erosion.mode.eq(register["erosion_mode"]),
            labelling.weighted.eq(register["weighted"]),
        ]

        # Spots to points.
        m.submodules.reconstruction = reconstruction = spot_side(Reconstruction(config))
        connect(m, labelling.o, reconstruction.i)
        connect(m, reconstruction.o, periphery.i)
        connect(m, reconstruction.counts, periphery.counts)
        connect_ports(m, TABLE_PORT, self, reconstruction)
        for name in reconstruction.registers:
            m.d.comb += getattr(reconstruction, name).eq(register[name])

        # Spots are under way from a pattern frame's first pixel until none has moved for so long
        # that none can be left.
        learning, pattern = Signal(), Signal()
        quiet = Signal(range(LINGER + 1))
        with m.If(histogram.closed | histogram.done | histogram.lost):
            m.d.sync += learning.eq(histogram.closed)
        m.d.comb += [
            periphery.moves.eq(
                reconstruction.moves | self.table_write | self.table_read | periphery.info.valid
                | histogram.closed | learning | histogram.done | histogram.lost),
            self.idle.eq(~pattern & ~reconstruction.moves & (quiet == 0)),
        ]
        with m.If(reconstruction.moves | pattern):
            m.d.sync += quiet.eq(LINGER)
        with m.Elif(quiet.any()):
            m.d.sync += quiet.eq(quiet - 1)
        with m.If(periphery.info.valid & periphery.info.ready):
            m.d.sync += pattern.eq(1)
        with m.Elif(histogram.done | histogram.lost):
            m.d.sync += pattern.eq(0)
        return m
