"""The whole capsule: camera pins in, serial pin out."""

from amaranth.hdl import C, Cat, Module, Shape, Signal, signed
from amaranth.lib import enum, stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out, connect

from .acquisition.camera import Camera
from .acquisition.frame_gate import FrameGate
from .common.point_fifo import PointFIFO
from .common.table_memory import TableMemory
from .config import Config
from .link.packet import Packet
from .link.uart_tx import UARTTransmitter
from .payloads import COORDINATE_BITS, FrameInfo
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


class TableSelect(enum.Enum, shape=2):
    """Which memory a table write goes to."""

    SHARED = 0  # words 0 to 255 depth, 256 to 511 reciprocals
    RADIAL = 1
    BEAMS = 2  # line in the low 36 bits, window above


class Capsule(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points.

    Takes one pixel a clock, frames back to back, whatever the image. All it cannot keep is
    counted and told to the reader: spots for which the queue has no room, frames that lost
    synchronism, frames that were skipped because four others were still on their way.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        The camera's pins, sampled at each rising edge in the domain ``pixel``.
    tx : :py:`Out(1)`
        The serial pin, 8N1, at ``divisor`` clocks a bit.
    threshold_fixed, threshold_level, alpha, erosion_mode, weighted, area_min, area_max, \
    report_rejected, principal_u, principal_v, tangential_1, tangential_2, divisor
        Registers; they may change only between frames. See ``hdl/README.md``.
    table_enable, table_select, table_address, table_data
        Writes a word of a table in each clock that ``table_enable`` is high, between frames.
    """

    def __init__(self, config):
        if not isinstance(config, Config):
            raise TypeError(f"The configuration must be a Config, not {config!r}")
        self.config = config
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            "tx": Out(1, init=1),
            "threshold_fixed": In(1),
            "threshold_level": In(8),
            "alpha": In(8),
            "erosion_mode": In(2),
            "weighted": In(1),
            "area_min": In(8),
            "area_max": In(8),
            "report_rejected": In(1),
            "principal_u": In(COORDINATE_BITS),
            "principal_v": In(COORDINATE_BITS),
            "tangential_1": In(signed(18)),
            "tangential_2": In(signed(18)),
            "divisor": In(16),
            "table_enable": In(1),
            "table_select": In(TableSelect),
            "table_address": In(10),
            "table_data": In(72),
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}

        # Acquisition.
        m.submodules.camera = camera = Camera(**size)
        m.submodules.frame_gate = gate = FrameGate()
        m.submodules.frame_info = frame_info = SyncFIFO(
            width=Shape.cast(FrameInfo).width, depth=_FRAMES_IN_FLIGHT)
        m.d.comb += [
            camera.frame_valid.eq(self.frame_valid),
            camera.line_valid.eq(self.line_valid),
            camera.data.eq(self.data),
        ]
        connect(m, camera.o, gate.i)
        connect(m, gate.info, frame_info.w_stream)

        # Preprocessing. The histogram only listens.
        m.submodules.histogram = histogram = Histogram(**size)
        m.submodules.threshold = threshold = Threshold(**size)
        m.submodules.binarise = binarise = Binarise(8)
        m.submodules.erosion = erosion = Erosion(config.width)
        m.submodules.labelling = labelling = Labelling(**size)
        m.submodules.spot_queue = spot_queue = SpotQueue(config.spot_depth)
        m.submodules.centre = centre = Centring()
        connect(m, gate.o, binarise.i)
        m.d.comb += [
            histogram.i.valid.eq(gate.o.valid & gate.o.ready),
            histogram.i.payload.eq(gate.o.payload),
        ]
        connect(m, binarise.o, erosion.i)
        connect(m, erosion.o, labelling.i)
        connect(m, labelling.o, spot_queue.i)
        connect(m, spot_queue.o, centre.i)
        m.d.comb += [
            threshold.closed.eq(histogram.closed),
            threshold.done.eq(histogram.done),
            threshold.lost.eq(histogram.lost),
            histogram.address.eq(threshold.address),
            threshold.count.eq(histogram.count),
            threshold.alpha.eq(self.alpha),
            threshold.fixed.eq(self.threshold_fixed),
            threshold.fixed_level.eq(self.threshold_level),
            gate.level.eq(threshold.level),
            gate.learnt.eq(threshold.learnt),
            binarise.level.eq(threshold.level),
            binarise.enable.eq(threshold.learnt),
            erosion.mode.eq(self.erosion_mode),
            labelling.weighted.eq(self.weighted),
            spot_queue.area_min.eq(self.area_min),
            spot_queue.area_max.eq(self.area_max),
            spot_queue.report_rejected.eq(self.report_rejected),
        ]

        # Stereo.
        m.submodules.undistort = undistort = Undistort(**size)
        m.submodules.epipolar = epipolar = Epipolar(config.beams, config.lanes)
        m.submodules.depth = depth = Depth()
        m.submodules.point_fifo = point_fifo = PointFIFO()
        connect(m, centre.o, undistort.i)
        connect(m, undistort.o, epipolar.i)
        connect(m, epipolar.o, depth.i)
        connect(m, depth.o, point_fifo.i)
        m.d.comb += [
            undistort.principal_u.eq(self.principal_u),
            undistort.principal_v.eq(self.principal_v),
            undistort.tangential_1.eq(self.tangential_1),
            undistort.tangential_2.eq(self.tangential_2),
        ]

        # Tables. Depth and reciprocals share a memory, each block with a port of its own.
        m.submodules.shared_table = shared_table = TableMemory()
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
        m.submodules.packet = packet = Packet()
        m.submodules.uart_tx = uart_tx = UARTTransmitter()
        connect(m, point_fifo.o, packet.i)
        connect(m, spot_queue.counts, packet.counts)
        connect(m, frame_info.r_stream, packet.info)
        connect(m, packet.o, uart_tx.i)
        m.d.comb += [
            packet.bad_sync.eq(camera.bad_sync),
            packet.overrun.eq(camera.overrun),
            uart_tx.divisor.eq(self.divisor),
            self.tx.eq(uart_tx.tx),
        ]
        return m
