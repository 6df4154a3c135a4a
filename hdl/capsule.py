"""The whole capsule: camera pins in, serial pin out."""

from amaranth.hdl import (
    C,
    Cat,
    ClockDomain,
    ClockSignal,
    DomainRenamer,
    Module,
    ResetSignal,
    Shape,
    Signal,
    signed,
)
from amaranth.lib import enum, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect

from .acquisition.camera import Camera
from .acquisition.frame_gate import FrameGate
from .common.point_fifo import PointFIFO
from .common.stage import Stage
from .common.table_memory import TableMemory
from .config import Config
from .link.packet import Packet
from .link.uart_tx import UARTTransmitter
from .payloads import COORDINATE_BITS, FrameInfo, Spot, Undistorted
from .preprocessing.binarise import Binarise
from .preprocessing.centre import Centring
from .preprocessing.erosion import Erosion
from .preprocessing.histogram import Histogram
from .preprocessing.labelling import Labelling
from .preprocessing.spot_queue import SpotQueue
from .preprocessing.threshold import Threshold
from .stereo.depth import Depth
from .stereo.epipolar import Epipolar
from .stereo.undistort import Undistort

__all__ = ["Capsule", "TableSelect"]

#: Frames whose points may still be on their way when the next one starts.
_FRAMES_IN_FLIGHT = 4
#: Clocks that the spot side goes on after the last sign of work: no block hides any for longer.
_LINGER = 63


class TableSelect(enum.Enum, shape=2):
    """Which memory a table write goes to."""

    SHARED = 0  # words 0 to 255 depth, 256 to 511 reciprocals
    RADIAL = 1
    BEAMS = 2  # line in the low 36 bits, window above


_REGISTERS = {
    "threshold_fixed": 1,
    "threshold_level": 8,
    "alpha": 8,
    "erosion_mode": 2,
    "weighted": 1,
    "area_min": 8,
    "area_max": 8,
    "report_rejected": 1,
    "principal_u": COORDINATE_BITS,
    "principal_v": COORDINATE_BITS,
    "tangential_1": signed(18),
    "tangential_2": signed(18),
    "divisor": 16,
}
_PIXEL_SIDE = ("erosion_mode", "weighted")


class Capsule(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points.

    Takes one pixel a clock, frames back to back, whatever the image. All it cannot keep is
    counted and told to the reader: spots for which the queue has no room, frames that lost
    synchronism, frames that were skipped because four others were still on their way.

    Pixels come every clock, spots rarely. What works on spots and on the threshold is in a clock
    domain of its own, ``spot``, which is ``sync`` unless ``gated``: then its clock is a port, and
    may stand still in every clock in which ``busy`` is low, without any difference to what comes
    out. On a device with clock gates that saves power; in a simulation, time.

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
    tx : :py:`Out(1)`
        The serial pin, 8N1, at ``divisor`` clocks a bit.
    busy : :py:`Out(1)`
        The spot side needs its clock.
    threshold_fixed, threshold_level, alpha, erosion_mode, weighted, area_min, area_max, \
    report_rejected, principal_u, principal_v, tangential_1, tangential_2, divisor
        Registers; they may change only between frames, and are heard with the next frame's first
        pixel. See ``hdl/README.md``.
    table_enable, table_select, table_address, table_data
        Writes a word of a table in each clock that ``table_enable`` is high, between frames.
    """

    def __init__(self, config, gated=False):
        if not isinstance(config, Config):
            raise TypeError(f"The configuration must be a Config, not {config!r}")
        self.config = config
        self.gated = gated
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            "tx": Out(1, init=1),
            "busy": Out(1),
            **{name: In(shape) for name, shape in _REGISTERS.items()},
            "table_enable": In(1),
            "table_select": In(TableSelect),
            "table_address": In(10),
            "table_data": In(72),
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
        for name, shape in _REGISTERS.items():
            register[name] = Signal(shape, name=name)
            domain = "sync" if name in _PIXEL_SIDE else "spot"
            m.d[domain] += register[name].eq(getattr(self, name))

        # Acquisition.
        m.submodules.camera = camera = Camera(**size)
        m.submodules.frame_gate = gate = FrameGate()
        m.submodules.frame_info = frame_info = spot_side(SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=_FRAMES_IN_FLIGHT))
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
        m.submodules.spot_stage = spot_stage = spot_side(Stage(Spot))
        m.submodules.spot_queue = spot_queue = spot_side(SpotQueue(config.spot_depth))
        m.submodules.centre = centre = spot_side(Centring())
        connect(m, gate.o, binarise.i)
        m.d.comb += [
            histogram.i.valid.eq(gate.o.valid & gate.o.ready),
            histogram.i.payload.eq(gate.o.payload),
        ]
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        connect(m, labelling.o, spot_stage.i)
        connect(m, spot_stage.o, spot_queue.i)
        connect(m, spot_queue.o, centre.i)
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
            binarise.level.eq(threshold.level),
            binarise.enable.eq(threshold.learnt),
            erosion.mode.eq(register["erosion_mode"]),
            labelling.weighted.eq(register["weighted"]),
            spot_queue.area_min.eq(register["area_min"]),
            spot_queue.area_max.eq(register["area_max"]),
            spot_queue.report_rejected.eq(register["report_rejected"]),
        ]

        # Stereo.
        m.submodules.undistort = undistort = spot_side(Undistort(**size))
        m.submodules.match_stage = match_stage = spot_side(Stage(Undistorted))
        m.submodules.epipolar = epipolar = spot_side(Epipolar(config.beams, config.lanes))
        m.submodules.depth = depth = spot_side(Depth())
        m.submodules.point_fifo = point_fifo = spot_side(PointFIFO())
        connect(m, centre.o, undistort.i)
        connect(m, undistort.o, match_stage.i)
        connect(m, match_stage.o, epipolar.i)
        connect(m, epipolar.o, depth.i)
        connect(m, depth.o, point_fifo.i)
        m.d.comb += [
            undistort.principal_u.eq(register["principal_u"]),
            undistort.principal_v.eq(register["principal_v"]),
            undistort.tangential_1.eq(register["tangential_1"]),
            undistort.tangential_2.eq(register["tangential_2"]),
        ]

        # Tables. Depth and reciprocals share a memory, each block with a port of its own.
        m.submodules.shared_table = shared_table = spot_side(TableMemory(config.beams))
        write = {memory: Signal(name=f"write_{memory.name.lower()}") for memory in TableSelect}
        m.d.comb += [
            *(write[memory].eq(self.table_enable & (self.table_select == memory))
              for memory in TableSelect),
            shared_table.a_address.eq(depth.table_address),
            depth.table_data.eq(shared_table.a_data),
            shared_table.b_address.eq(Cat(centre.table_address, C(1, 1))),
            centre.table_data.eq(shared_table.b_data),
            shared_table.write_enable.eq(write[TableSelect.SHARED]),
            shared_table.write_address.eq(self.table_address),
            shared_table.write_data.eq(self.table_data),
            undistort.radial_write_enable.eq(write[TableSelect.RADIAL]),
            undistort.radial_write_address.eq(self.table_address),
            undistort.radial_write_data.eq(self.table_data),
            epipolar.write_enable.eq(write[TableSelect.BEAMS]),
            epipolar.write_address.eq(self.table_address),
            epipolar.write_line.eq(self.table_data[:36]),
            epipolar.write_window.eq(self.table_data[36:]),
        ]

        # Link.
        m.submodules.packet = packet = spot_side(Packet())
        m.submodules.uart_tx = uart_tx = spot_side(UARTTransmitter())
        connect(m, point_fifo.o, packet.i)
        connect(m, spot_queue.counts, packet.counts)
        connect(m, frame_info.r_stream, packet.info)
        connect(m, packet.o, uart_tx.i)
        m.d.spot += [packet.bad_sync.eq(camera.bad_sync), packet.overrun.eq(camera.overrun)]
        m.d.comb += [
            uart_tx.divisor.eq(register["divisor"]),
            self.tx.eq(uart_tx.tx),
        ]

        # The spot side works while anything moves between its blocks, and a little longer.
        learning, moves = Signal(), Signal()
        linger = Signal(range(_LINGER + 1), init=_LINGER)
        with m.If(histogram.closed | histogram.done | histogram.lost):
            m.d.sync += learning.eq(histogram.closed)
        m.d.comb += [
            moves.eq(Cat(
                self.table_enable, gate.info.valid, histogram.closed, learning, histogram.done,
                histogram.lost, labelling.o.valid, spot_stage.o.valid, spot_queue.o.valid,
                centre.o.valid, undistort.o.valid, match_stage.o.valid, epipolar.o.valid,
                depth.o.valid, point_fifo.o.valid, packet.o.valid, ~uart_tx.i.ready).any()),
            self.busy.eq(moves | linger.any()),
        ]
        with m.If(moves):
            m.d.sync += linger.eq(_LINGER)
        with m.Elif(linger.any()):
            m.d.sync += linger.eq(linger - 1)
        return m
