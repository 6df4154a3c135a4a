"""The whole capsule: camera pins in, serial pin out."""

from amaranth.hdl import ClockDomain, ClockSignal, Module, ResetSignal
from amaranth.lib import wiring
from amaranth.lib.wiring import Out, connect

from .acquisition.front_end import FrontEnd, camera_pins
from .capsule_points import CapsulePoints
from .config import check_config
from .link.point_link import PointLink
from .ports import TABLE_PORT, connect_ports

__all__ = ["Capsule"]


class Capsule(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points.

    Takes one pixel a clock, frames back to back, whatever the image. All that is lost is counted
    and reported to the reader: spots for which the queue was full, frames that lost synchronism,
    frames that were skipped because four others were still on their way.

    Three parts: :class:`.acquisition.front_end.FrontEnd`, :class:`.capsule_points.CapsulePoints`
    and :class:`.link.point_link.PointLink`.

    Pixels come every clock, spots rarely. What works on spots is in a clock
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
        Instead of these if the configuration has a converter, see
        :class:`.acquisition.addressed_camera.AddressedCamera`.
    tag : :py:`In(FrameTag)`
        How the frame at the pins was exposed. Texture frames only go to the link.
    tripped, tables_valid : :py:`In(1)`
        State of the laser guard and of the tables, reported to the reader with each frame.
    reply : :py:`In(stream.Signature(PacketOctet))`
        Answers to the host.
    tx, cts : :py:`Out(1)`, :py:`In(1)`
        The serial pin, 8N1, at ``divisor`` clocks a bit; whether it may send.
    busy : :py:`Out(1)`
        The spot side needs its clock.
    wake : :py:`In(1)`
        Registers may be about to change: keeps the spot side's clock running to sample them.
    idle : :py:`Out(1)`
        No pattern frame passes, and no spot is on its way: tables and registers may change.
    frame_begun, frame_ended, frame_broken : :py:`Out(1)`
        High for a clock with a frame's first pixel, with its last, and with loss of synchronism.
    frame_sending : :py:`Out(1)`
        The camera is sending a frame, whole or not.
    bad_sync, overrun, skipped : :py:`Out(8)`
        Frames that lost synchronism, that lost pixels between the clocks, that were skipped
        because a buffer was full, since reset; they stop at 255.
    packets : :py:`Out(16)`
        Packets sent, modulo 65536.
    sending : :py:`Out(1)`
        A packet is on the line, or waits for it.
    registers
        May change while ``idle``. See ``hdl/protocol.py``.
    bank : :py:`In(1)`
        Bank of the tables that spots are measured with.
    table_write, table_read, table_select, table_address, table_data
        Writes or reads a word of the other bank; the number of the table and the words are those
        of :data:`hdl.protocol.TABLES`.
    table_word : :py:`Out(72)`
        The word, from the second clock after ``table_read`` to the next read.

    Attributes
    ----------
    registers : :class:`dict`
        Members for the registers that are used.
    """

    registers = {**FrontEnd.registers, **CapsulePoints.registers, **PointLink.registers}

    def __init__(self, config, clock_gated=False):
        check_config(config)
        self.config = config
        self.clock_gated = clock_gated
        super().__init__({
            **camera_pins(config),
            **FrontEnd.ports,
            **PointLink.ports,
            "idle": Out(1),
            **self.registers,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        if not self.clock_gated:
            m.domains.spot = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]

        m.submodules.front_end = front_end = FrontEnd(self.config)
        m.submodules.points = points = CapsulePoints(self.config)
        m.submodules.link = link = PointLink(self.config)
        connect_ports(m, camera_pins(self.config) | FrontEnd.ports | FrontEnd.registers, self,
                      front_end)
        connect_ports(m, points.registers | TABLE_PORT | {"idle": Out(1)}, self, points)
        connect_ports(m, link.registers | PointLink.ports, self, link)

        connect(m, front_end.o, points.i)
        connect(m, front_end.info, points.info)
        connect(m, front_end.texture, link.texture)
        connect(m, front_end.texture_info, link.texture_info)
        connect(m, points.o, link.i)
        connect(m, points.counts, link.counts)
        connect(m, points.frames, link.frames)
        connect(m, points.detections, link.detections)
        m.d.comb += [
            link.bad_sync.eq(front_end.bad_sync),
            link.overrun.eq(front_end.overrun),
            link.active.eq(points.active),
        ]
        return m
