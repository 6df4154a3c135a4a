"""The whole capsule: camera pins in, serial pin out."""

from amaranth.hdl import (
    Cat,
    ClockDomain,
    ClockSignal,
    DomainRenamer,
    Module,
    ResetSignal,
    Shape,
    Signal,
)
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect

from .acquisition.camera import Camera
from .acquisition.frame_gate import FrameGate
from .common.point_fifo import PointFIFO
from .config import FRAMES_IN_FLIGHT, check_config
from .link.points import Points
from .link.quota import Quota
from .link.transmitter import Transmitter
from .payloads import FrameInfo, FrameTag, PacketOctet
from .ports import REGISTERS, TABLE_PORT, hand_on
from .preprocessing.binarise import Binarise
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.labelling import Labelling
from .preprocessing.threshold import Threshold
from .reconstruction import Reconstruction

__all__ = ["Capsule"]

#: Clocks that the spot side goes on after the last sign of work: no block hides any for longer.
_LINGER = 127
_PIXEL_SIDE = ("erosion_mode", "weighted")
_LINK_SIDE = ("divisor", "texture_enable")


class Capsule(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points.

    Takes one pixel a clock, frames back to back, whatever the image. All it cannot keep is
    counted and told to the reader: spots for which the queue has no room, frames that lost
    synchronism, frames that were skipped because four others were still on their way.

    Pixels come every clock, spots rarely. What works on spots and on the threshold is in a clock
    domain of its own, ``spot``, which is ``sync`` unless ``gated``: then its clock is a port, and
    may stand still in every clock in which ``busy`` is low, without any difference to what comes
    out. On a device with clock gates that saves power; in a simulation, time.

    Tables have two banks, the reciprocals excepted. Spots are measured with bank ``bank``, the
    host writes and reads back the other one. It may do so while ``idle`` is high; its accesses
    may borrow a block's memory port, so at other times they would spoil points.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.
    gated : :class:`bool`
        Make the clock of the spot side a port, ``spot_clk``, with ``spot_rst``.

    Members
    -------
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        The camera's pins, sampled at each rising edge in the domain ``pixel``.
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

    def __init__(self, config, gated=False):
        check_config(config)
        self.config = config
        self.gated = gated
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            "tag": In(FrameTag),
            "tripped": In(1),
            "tables_valid": In(1),
            "reply": In(stream.Signature(PacketOctet)),
            "tx": Out(1, init=1),
            "cts": In(1),
            "busy": Out(1),
            "wake": In(1),
            "idle": Out(1),
            "frame_begun": Out(1),
            "frame_ended": Out(1),
            "frame_broken": Out(1),
            "bad_sync": Out(8),
            "overrun": Out(8),
            "skipped": Out(8),
            "packets": Out(16),
            "sending": Out(1),
            **REGISTERS,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}

        spot_side = DomainRenamer("spot")
        if not self.gated:
            m.domains.spot = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]
        register = {}
        for name, member in REGISTERS.items():
            register[name] = Signal(member.shape, name=name)
            domain = "sync" if name in _PIXEL_SIDE + _LINK_SIDE else "spot"
            m.d[domain] += register[name].eq(getattr(self, name))

        # Acquisition.
        m.submodules.camera = camera = Camera(**size)
        m.submodules.frame_gate = gate = FrameGate()
        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=FRAMES_IN_FLIGHT))
        m.d.comb += [
            camera.frame_valid.eq(self.frame_valid),
            camera.line_valid.eq(self.line_valid),
            camera.data.eq(self.data),
        ]
        connect(m, camera.o, gate.i)
        connect(m, gate.info, frame_info.w_stream)

        # Preprocessing. The histogram only listens.
        m.submodules.histogram = histogram = Histogram(**size)
        m.submodules.threshold = threshold = spot_side(Threshold(**size))
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = Labelling(**size)
        connect(m, gate.o, binarise.i)
        m.d.comb += [
            histogram.i.valid.eq(gate.o.valid & gate.o.ready),
            histogram.i.payload.eq(gate.o.payload),
        ]
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        m.d.comb += [
            threshold.closed.eq(histogram.closed),
            threshold.done.eq(histogram.done),
            threshold.lost.eq(histogram.lost),
            histogram.address.eq(threshold.address),
            threshold.count.eq(histogram.count),
            threshold.alpha.eq(register["alpha"]),
            threshold.fixed.eq(register["threshold_fixed"]),
            threshold.fixed_level.eq(register["threshold_level"]),
            gate.level.eq(threshold.level),
            gate.learnt.eq(threshold.learnt),
            gate.tag.eq(self.tag),
            gate.tripped.eq(self.tripped),
            gate.tables_valid.eq(self.tables_valid),
            binarise.level.eq(threshold.level),
            binarise.enable.eq(threshold.learnt),
            erosion.mode.eq(register["erosion_mode"]),
            labelling.weighted.eq(register["weighted"]),
        ]

        # Spots to points.
        m.submodules.reconstruction = reconstruction = spot_side(Reconstruction(config))
        m.submodules.quota = quota = spot_side(Quota(FRAMES_IN_FLIGHT))
        m.submodules.point_fifo = point_fifo = spot_side(PointFIFO())
        connect(m, labelling.o, reconstruction.i)
        connect(m, reconstruction.o, quota.i)
        connect(m, reconstruction.counts, quota.counts_i)
        connect(m, quota.o, point_fifo.i)
        hand_on(m, TABLE_PORT, self, reconstruction)
        m.d.comb += [
            *(getattr(reconstruction, name).eq(register[name])
              for name in reconstruction.registers),
            quota.limit.eq(register["points_max"]),
        ]

        # Link. Octets cross to the side whose clock never stops.
        m.submodules.points = points = spot_side(Points())
        m.submodules.transmitter = transmitter = Transmitter(**size)
        connect(m, point_fifo.o, points.i)
        connect(m, quota.counts_o, points.counts)
        connect(m, frame_info.r_stream, points.info)
        connect(m, points.o, transmitter.points)
        connect(m, wiring.flipped(self.reply), transmitter.reply)
        connect(m, gate.texture, transmitter.texture)
        connect(m, gate.texture_info, transmitter.texture_info)
        m.d.comb += [
            points.full_records.eq(register["full_records"]),
            transmitter.more.eq(point_fifo.o.valid),
            transmitter.divisor.eq(register["divisor"]),
            transmitter.texture_enable.eq(register["texture_enable"]),
            transmitter.bad_sync.eq(camera.bad_sync),
            transmitter.overrun.eq(camera.overrun),
            transmitter.cts.eq(self.cts),
            self.tx.eq(transmitter.tx),
            self.packets.eq(transmitter.packets),
            self.sending.eq(transmitter.busy),
        ]

        # The spot side works while anything moves between its blocks, and a little longer. Spots
        # are under way from a pattern frame's first pixel until none has moved for as long.
        learning, moves = Signal(), Signal()
        linger = Signal(range(_LINGER + 1), init=_LINGER)
        quiet = Signal(range(_LINGER + 1))
        pattern = Signal()
        with m.If(histogram.closed | histogram.done | histogram.lost):
            m.d.sync += learning.eq(histogram.closed)
        m.d.comb += [
            moves.eq(Cat(
                reconstruction.moves, self.wake, self.table_write, self.table_read, gate.info.valid,
                histogram.closed, learning, histogram.done, histogram.lost, point_fifo.i.valid,
                point_fifo.o.valid & ~points.o.valid, points.o.valid & points.o.ready).any()),
            self.busy.eq(moves | linger.any()),
            self.idle.eq(~pattern & ~reconstruction.moves & (quiet == 0)),
        ]
        for left, restart in ((linger, moves), (quiet, reconstruction.moves | pattern)):
            with m.If(restart):
                m.d.sync += left.eq(_LINGER)
            with m.Elif(left.any()):
                m.d.sync += left.eq(left - 1)
        with m.If(gate.info.valid & gate.info.ready):
            m.d.sync += pattern.eq(1)
        with m.Elif(histogram.done | histogram.lost):
            m.d.sync += pattern.eq(0)

        # For the sequencer and for the host.
        inside = Signal()
        beat = camera.o.valid & camera.o.ready
        mark = camera.o.p.mark
        with m.If(beat):
            m.d.sync += inside.eq(~mark.frame_end)
        m.d.comb += [
            self.frame_begun.eq(beat & ~inside & ~mark.broken),
            self.frame_ended.eq(beat & mark.frame_end & ~mark.broken),
            self.frame_broken.eq(beat & mark.broken),
            self.bad_sync.eq(camera.bad_sync),
            self.overrun.eq(camera.overrun),
            self.skipped.eq(gate.lost),
        ]
        return m
