"""From points to the serial pin, with texture and replies beside them."""

from amaranth.hdl import DomainRenamer, Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from ..common.activity import Activity
from ..common.point_fifo import PointFIFO
from ..config import FRAMES_IN_FLIGHT, check_config
from ..payloads import Counts, Detection, FrameInfo, GreyPixel, PacketOctet, Point
from ..ports import register_ports, sample_registers
from .point_limiter import PointLimiter
from .points import Points
from .transmitter import Transmitter

__all__ = ["PointLink"]


class PointLink(wiring.Component):
    """Sends points and counts of pattern frames, texture frames, and replies.

    Blocks up to :class:`.points.Points` are in the domain ``spot``, like those that measure spots.
    Its clock may stand still in every clock in which ``busy`` is low: when nothing on the spot side
    was active for :data:`hdl.common.activity.IDLE_TIMEOUT` clocks. Registers may change only
    between frames, and pass a flip-flop here.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    ports, registers
        See :class:`hdl.capsule.Capsule`.
    i, counts : :py:`In(stream.Signature(Point))`, :py:`In(stream.Signature(Counts))`
        Points of pattern frames, and counts of each frame.
    frames, detections : :py:`In(stream.Signature(FrameInfo))`, \
    :py:`In(stream.Signature(Detection))`
        Announcement of each frame, and how its spots were detected.
    texture, texture_info : :py:`In(stream.Signature(GreyPixel))`, \
    :py:`In(stream.Signature(FrameInfo))`
        Texture frames as they pass, and their announcements.
    bad_sync, overrun : :py:`In(8)`, :py:`In(8)`
        The camera's counters, reported with each texture frame.
    sent : :py:`Out(stream.Signature(Point, always_ready=True))`
        Points and end markers that the point limiter lets through, as they pass.
    active : :py:`In(1)`
        What measures spots is active in this clock.

    Attributes
    ----------
    ports : :class:`dict`
        Members that go through to the pins and to the host.
    registers : :class:`dict`
        Members for the registers that are used.
    """

    ports = {
        "reply": In(stream.Signature(PacketOctet)),
        "tx": Out(1, init=1),
        "cts": In(1),
        "busy": Out(1),
        "wake": In(1),
        "packets": Out(16),
        "sending": Out(1),
    }
    registers = {
        **register_ports("points_max"), **Points.registers, **Transmitter.registers}

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            **self.ports,
            **self.registers,
            "i": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "frames": In(stream.Signature(FrameInfo)),
            "detections": In(stream.Signature(Detection)),
            "texture": In(stream.Signature(GreyPixel)),
            "texture_info": In(stream.Signature(FrameInfo)),
            "bad_sync": In(8),
            "overrun": In(8),
            "sent": Out(stream.Signature(Point, always_ready=True)),
            "active": In(1),
        })

    def elaborate(self, platform):
        m = Module()
        spot_side = DomainRenamer("spot")
        register = sample_registers(m, self)

        # Points to packets.
        m.submodules.point_limiter = point_limiter = spot_side(PointLimiter(FRAMES_IN_FLIGHT))
        m.submodules.point_fifo = point_fifo = spot_side(
            PointFIFO(1 if self.config.beams <= 64 else 2))
        m.submodules.points = points = spot_side(Points())
        connect(m, flipped(self.i), point_limiter.i)
        connect(m, flipped(self.counts), point_limiter.counts_i)
        connect(m, point_limiter.o, point_fifo.i)
        connect(m, point_limiter.counts_o, points.counts)
        connect(m, point_fifo.o, points.i)
        connect(m, flipped(self.frames), points.info)
        connect(m, flipped(self.detections), points.detection)
        m.d.comb += [
            point_limiter.limit.eq(register["points_max"]),
            self.sent.valid.eq(point_limiter.o.valid & point_limiter.o.ready),
            self.sent.payload.eq(point_limiter.o.payload),
        ]

        # Packets to the line. Octets cross to the side whose clock never stops.
        m.submodules.transmitter = transmitter = Transmitter(self.config.width, self.config.height)
        connect(m, points.o, transmitter.points)
        connect(m, flipped(self.reply), transmitter.reply)
        connect(m, flipped(self.texture), transmitter.texture)
        connect(m, flipped(self.texture_info), transmitter.texture_info)
        m.d.comb += [
            *(getattr(block, name).eq(register[name]) for block in (points, transmitter)
              for name in block.registers),
            transmitter.more.eq(point_fifo.o.valid),
            transmitter.bad_sync.eq(self.bad_sync),
            transmitter.overrun.eq(self.overrun),
            transmitter.cts.eq(self.cts),
            self.tx.eq(transmitter.tx),
            self.packets.eq(transmitter.packets),
            self.sending.eq(transmitter.busy),
        ]

        # Packing a point takes about as long as the timeout: so a point counts as activity until it
        # is taken, unless a packet waits for the line.
        m.submodules.activity = activity = Activity(busy_after_reset=True)
        m.d.comb += [
            activity.active.eq(
                self.active | self.wake | point_fifo.i.valid
                | (point_fifo.o.valid & ~points.o.valid) | (points.o.valid & points.o.ready)),
            self.busy.eq(activity.busy),
        ]
        return m
