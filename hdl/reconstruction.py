"""Spots to points in space."""

from amaranth.hdl import C, Cat, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from .common.stage import Stage
from .common.table_memory import TableMemory
from .config import check_config
from .payloads import Counts, Point, Spot, Undistorted
from .ports import TABLE_PORT, connect_ports
from .preprocessing.centre import Centring
from .preprocessing.spot_queue import SpotQueue
from .protocol import TABLES, fraction_bits
from .stereo.depth import Depth
from .stereo.epipolar import Epipolar
from .stereo.undistort import Undistort

__all__ = ["Reconstruction"]



class Reconstruction(wiring.Component):
    """Turns what labelling found into points: filter, centre, lens, beam, depth.

    Takes a spot a clock; when the queue is full, spots are dropped whole and counted. A
    spot's point comes after the sum of the latencies in ``hdl/README.md``, and spots follow each
    other as fast as the slowest stage lets them.

    Tables have two banks, the reciprocals excepted. Spots are measured with bank ``bank``, the
    host writes and reads back the other one. Its accesses may borrow a block's memory port, so
    they would spoil a point that is under way. Reset forgets all spots.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    i : :py:`In(stream.Signature(Spot))`
        Spots and end markers; always ready.
    o : :py:`Out(stream.Signature(Point))`
        Points and end markers.
    counts : :py:`Out(stream.Signature(Counts))`
        One for each frame, there before the frame's end marker is.
    active : :py:`Out(1)`
        A spot passes from one stage to the next in this clock, or waits to. No stage keeps one to
        itself for longer than :data:`hdl.common.activity.IDLE_TIMEOUT` clocks.
    registers
        See ``hdl/protocol.py``. May change while no spot is under way.
    bank : :py:`In(1)`
        Bank of the tables that spots are measured with. May change while no spot is under way.
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

    registers = {
        name: member for block in (SpotQueue, Centring, Undistort, Epipolar, Depth)
        for name, member in getattr(block, "registers", {}).items()}

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            "i": In(stream.Signature(Spot)),
            "o": Out(stream.Signature(Point)),
            "counts": Out(stream.Signature(Counts)),
            "active": Out(1),
            **self.registers,
            **TABLE_PORT,
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}
        m.submodules.spot_stage = spot_stage = Stage(Spot)
        m.submodules.spot_queue = spot_queue = SpotQueue(config.spot_depth)
        m.submodules.centre = centre = Centring(fraction_bits(**size))
        m.submodules.undistort = undistort = Undistort(**size)
        m.submodules.match_stage = match_stage = Stage(Undistorted)
        m.submodules.epipolar = epipolar = Epipolar(config.beams, config.lanes)
        m.submodules.depth = depth = Depth()
        connect(m, flipped(self.i), spot_stage.i)
        connect(m, spot_stage.o, spot_queue.i)
        connect(m, spot_queue.o, centre.i)
        connect(m, centre.o, undistort.i)
        connect(m, undistort.o, match_stage.i)
        connect(m, match_stage.o, epipolar.i)
        connect(m, epipolar.o, depth.i)
        connect(m, depth.o, flipped(self.o))
        connect(m, spot_queue.counts, flipped(self.counts))
        m.d.comb += [
            self.active.eq(Cat(
                self.i.valid, spot_stage.o.valid, spot_queue.o.valid, spot_queue.counts.valid,
                centre.o.valid, undistort.o.valid, match_stage.o.valid, epipolar.o.valid,
                depth.o.valid).any()),
        ]
        for block in (spot_queue, centre, undistort, epipolar, depth):
            connect_ports(m, getattr(block, "registers", {}), self, block)

        # Tables. Depth and reciprocals share a memory, each block with a port of its own.
        m.submodules.shared_table = shared_table = TableMemory(config.beams)
        chosen = {table.name: Signal(name=f"is_{table.name}") for table in TABLES}
        shared = chosen["depth"] | chosen["reciprocal"]
        m.d.comb += [
            *(chosen[table.name].eq(self.table_select == table.number) for table in TABLES),
            *(block.bank.eq(self.bank) for block in (shared_table, undistort, epipolar)),
            *(block.write_bank.eq(~self.bank) for block in (shared_table, undistort, epipolar)),
            shared_table.a_address.eq(depth.table_address),
            depth.table_data.eq(shared_table.a_data),
            shared_table.b_address.eq(Cat(centre.table_address, C(1 << 2, 3))),
            centre.table_data.eq(shared_table.b_data),
            shared_table.write_enable.eq(self.table_write & shared),
            shared_table.read_enable.eq(self.table_read & shared),
            shared_table.write_address.eq(Cat(self.table_address, chosen["reciprocal"])),
            shared_table.write_data.eq(self.table_data),
            undistort.radial_write_enable.eq(self.table_write & chosen["radial"]),
            undistort.radial_write_address.eq(self.table_address),
            undistort.radial_write_data.eq(self.table_data),
            epipolar.write_enable.eq(self.table_write & chosen["beams"]),
            epipolar.read_enable.eq(self.table_read & chosen["beams"]),
            epipolar.write_address.eq(self.table_address),
            Cat(epipolar.write_line, epipolar.write_window).eq(self.table_data),
        ]
        read = Signal()
        m.d.sync += read.eq(self.table_read)
        with m.If(read):
            with m.If(chosen["radial"]):
                m.d.sync += self.table_word.eq(undistort.radial_read_data)
            with m.Elif(chosen["beams"]):
                m.d.sync += self.table_word.eq(Cat(epipolar.read_line, epipolar.read_window))
            with m.Else():
                m.d.sync += self.table_word.eq(shared_table.a_data)
        return m
