"""Camera and link: what stands around measuring in either preset."""

from amaranth.hdl import DomainRenamer, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect, flipped

from .acquisition.addressed_camera import AddressedCamera
from .acquisition.camera import Camera
from .acquisition.frame_gate import FrameGate
from .common.point_fifo import PointFIFO
from .config import FRAMES_IN_FLIGHT, check_config
from .link.point_limiter import PointLimiter
from .link.points import Points
from .link.transmitter import Transmitter
from .payloads import Counts, FrameInfo, FrameTag, GreyPixel, PacketOctet, Point
from .ports import REGISTERS, connect_ports

__all__ = ["LINGER", "PORTS", "Periphery", "camera_pins"]

#: Clocks that the spot side goes on after the last sign of work: no block hides any for longer.
LINGER = 127
#: What goes through to pins, sequencer and host, besides the camera's pins.
PORTS = {
    "tag": In(FrameTag),
    "tripped": In(1),
    "tables_valid": In(1),
    "reply": In(stream.Signature(PacketOctet)),
    "tx": Out(1, init=1),
    "cts": In(1),
    "busy": Out(1),
    "wake": In(1),
    "frame_begun": Out(1),
    "frame_ended": Out(1),
    "frame_broken": Out(1),
    "frame_sending": Out(1),
    "bad_sync": Out(8),
    "overrun": Out(8),
    "skipped": Out(8),
    "packets": Out(16),
    "sending": Out(1),
}


def camera_pins(config):
    """Members for the pins of the camera that ``config`` chooses, as that camera has them."""
    if config.converter_latency is None:
        return {"frame_valid": In(1), "line_valid": In(1), "data": In(8)}
    return {"row": Out(range(config.height)), "column": Out(range(config.width)),
            "convert": Out(1), "data": In(8), "sensor_read": In(1)}


class Periphery(wiring.Component):
    """Takes frames from the camera's pins for what measures them, and sends what it finds.

    Pattern frames leave by ``o``; their points, counts and announcements come back and go to the
    link. Texture frames go to the link as they pass.

    What works on points is in the domain ``spot``, as is what measures spots. Its clock may stand
    still in every clock in which ``busy`` is low: when nothing has moved on the spot side for
    :data:`LINGER` clocks. Registers may change only between frames.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    camera_pins, PORTS
        See :class:`hdl.capsule.Capsule`.
    REGISTERS
        Those of ``registers``, see ``hdl/protocol.py``.
    o, info : :py:`Out(stream.Signature(GreyPixel))`, :py:`Out(stream.Signature(FrameInfo))`
        Pattern frames, see :class:`.acquisition.frame_gate.FrameGate`.
    level, threshold_valid : :py:`In(8)`, :py:`In(1)`
        The threshold, for ``info``; whether there is one.
    i, counts, frames : :py:`In(stream.Signature(Point))`, :py:`In(stream.Signature(Counts))`, \
    :py:`In(stream.Signature(FrameInfo))`
        What is told of pattern frames: points, and counts and announcement of each frame.
    sent : :py:`Out(stream.Signature(Point, always_ready=True))`
        Points and end markers that the point limiter lets through, as they pass to the link.
    moves : :py:`In(1)`
        Something moves on the spot side.

    Attributes
    ----------
    registers : :class:`dict`
        Members for the registers that are heard.
    """

    registers = {name: REGISTERS[name] for name in (
        "divisor", "full_records", "texture_enable", "points_max")}

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            **camera_pins(config),
            **PORTS,
            **self.registers,
            "o": Out(stream.Signature(GreyPixel)),
            "info": Out(stream.Signature(FrameInfo)),
            "level": In(8),
            "threshold_valid": In(1),
            "i": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "frames": In(stream.Signature(FrameInfo)),
            "sent": Out(stream.Signature(Point, always_ready=True)),
            "moves": In(1),
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        size = {"width": config.width, "height": config.height}
        spot_side = DomainRenamer("spot")
        register = {}
        for name, member in self.registers.items():
            register[name] = Signal(member.shape, name=name)
            m.d.sync += register[name].eq(getattr(self, name))

        # Acquisition.
        bad_sync, overrun = Signal(8), Signal(8)
        if config.converter_latency is None:
            m.submodules.camera = camera = Camera(**size)
            m.submodules.sending_synchronizer = FFSynchronizer(self.frame_valid, self.frame_sending)
            m.d.comb += [bad_sync.eq(camera.bad_sync), overrun.eq(camera.overrun)]
        else:
            # Nothing can be lost there; only a new read-out ends a frame before its time.
            m.submodules.camera = camera = AddressedCamera(
                **size, latency=config.converter_latency, interval=config.converter_interval)
            m.d.comb += self.frame_sending.eq(camera.sending)
            with m.If(camera.o.valid & camera.o.ready & camera.o.p.marker.broken & ~bad_sync.all()):
                m.d.sync += bad_sync.eq(bad_sync + 1)
        connect_ports(m, camera_pins(config), self, camera)
        m.submodules.frame_gate = gate = FrameGate()
        connect(m, camera.o, gate.i)
        connect(m, gate.o, flipped(self.o))
        connect(m, gate.info, flipped(self.info))
        m.d.comb += [
            *(getattr(gate, name).eq(getattr(self, name))
              for name in ("tag", "tripped", "tables_valid", "level", "threshold_valid")),
        ]

        # Points to packets.
        m.submodules.point_limiter = point_limiter = spot_side(PointLimiter(FRAMES_IN_FLIGHT))
        m.submodules.point_fifo = point_fifo = spot_side(PointFIFO())
        m.submodules.points = points = spot_side(Points())
        connect(m, flipped(self.i), point_limiter.i)
        connect(m, flipped(self.counts), point_limiter.counts_i)
        connect(m, point_limiter.o, point_fifo.i)
        connect(m, point_limiter.counts_o, points.counts)
        connect(m, point_fifo.o, points.i)
        connect(m, flipped(self.frames), points.info)
        m.d.comb += [
            point_limiter.limit.eq(register["points_max"]),
            points.full_records.eq(register["full_records"]),
            self.sent.valid.eq(point_limiter.o.valid & point_limiter.o.ready),
            self.sent.payload.eq(point_limiter.o.payload),
        ]

        # Link. Octets cross to the side whose clock never stops.
        m.submodules.transmitter = transmitter = Transmitter(**size)
        connect(m, points.o, transmitter.points)
        connect(m, flipped(self.reply), transmitter.reply)
        connect(m, gate.texture, transmitter.texture)
        connect(m, gate.texture_info, transmitter.texture_info)
        m.d.comb += [
            transmitter.more.eq(point_fifo.o.valid),
            transmitter.divisor.eq(register["divisor"]),
            transmitter.texture_enable.eq(register["texture_enable"]),
            transmitter.bad_sync.eq(bad_sync),
            transmitter.overrun.eq(overrun),
            transmitter.cts.eq(self.cts),
            self.tx.eq(transmitter.tx),
            self.packets.eq(transmitter.packets),
            self.sending.eq(transmitter.busy),
        ]

        # The spot side works while anything moves between its blocks, and a little longer. Packing
        # a point takes about as long as that: so a point is work until it is taken, unless a packet
        # waits for the line.
        moves = Signal()
        linger = Signal(range(LINGER + 1), init=LINGER)
        m.d.comb += [
            moves.eq(self.moves | self.wake | point_fifo.i.valid
                     | (point_fifo.o.valid & ~points.o.valid)
                     | (points.o.valid & points.o.ready)),
            self.busy.eq(moves | linger.any()),
        ]
        with m.If(moves):
            m.d.sync += linger.eq(LINGER)
        with m.Elif(linger.any()):
            m.d.sync += linger.eq(linger - 1)

        # For the sequencer and for the host.
        inside = Signal()
        beat = camera.o.valid & camera.o.ready
        marker = camera.o.p.marker
        with m.If(beat):
            m.d.sync += inside.eq(~marker.frame_end)
        m.d.comb += [
            self.frame_begun.eq(beat & ~inside & ~marker.broken),
            self.frame_ended.eq(beat & marker.frame_end & ~marker.broken),
            self.frame_broken.eq(beat & marker.broken),
            self.bad_sync.eq(bad_sync),
            self.overrun.eq(overrun),
            self.skipped.eq(gate.lost),
        ]
        return m
