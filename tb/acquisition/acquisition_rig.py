"""Everything between the schedule and the stream of pixels: sequencer, laser guard, camera."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.addressed_camera import AddressedCamera
from hdl.acquisition.camera import Camera
from hdl.acquisition.laser_guard import LaserGuard
from hdl.acquisition.sequencer import Sequencer
from hdl.payloads import FrameTag, GreyPixel
from hdl.protocol import GUARD_CAUSES

__all__ = ["AcquisitionRig"]

_INPUTS = ("mode", "period_us", "pattern_reset_us", "pattern_us", "texture_reset_us", "texture_us")
_OUTPUTS = ("sensor_reset", "sensor_integrate", "sensor_read", "timeouts", "late", "silent",
            "heartbeat")


class AcquisitionRig(wiring.Component):
    """``guard``: other arguments for the laser guard, which may so be ready sooner.

    ``converter``: the converter's latency and the clocks of a pixel, for a camera of addressed
    pixels instead of the other.
    """

    def __init__(self, width, height, guard=None, converter=None):
        self.sequencer = Sequencer()
        self.addressed = converter is not None
        self.camera = (AddressedCamera(width, height, *converter) if self.addressed
                       else Camera(width, height))
        self.guard = LaserGuard(**(guard or {}))
        members = self.sequencer.signature.members
        camera = self.camera.signature.members
        self.pins = ("row", "column", "convert", "sending") if self.addressed else ()
        super().__init__({
            "data": In(8),
            **({} if self.addressed else {"frame_valid": In(1), "line_valid": In(1)}),
            **{name: camera[name] for name in self.pins},
            **{name: members[name] for name in (*_INPUTS, *_OUTPUTS)},
            "laser": Out(1),
            "causes": Out(len(GUARD_CAUSES)),
            "o": Out(stream.Signature(GreyPixel)),
            "tag": Out(FrameTag),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.sequencer = sequencer = self.sequencer
        m.submodules.guard = guard = self.guard
        m.submodules.camera = camera = self.camera
        m.d.comb += camera.data.eq(self.data)
        if self.addressed:
            m.d.comb += [camera.sensor_read.eq(sequencer.sensor_read),
                         sequencer.sending.eq(camera.sending)]
            m.d.comb += [getattr(self, name).eq(getattr(camera, name)) for name in self.pins]
        else:
            m.submodules += FFSynchronizer(self.frame_valid, sequencer.sending)
            m.d.comb += [camera.frame_valid.eq(self.frame_valid),
                         camera.line_valid.eq(self.line_valid)]
        connect(m, camera.o, flipped(self.o))
        inside, taken = Signal(), Signal()
        marker = camera.o.p.marker
        with m.If(taken):
            m.d.sync += inside.eq(~marker.frame_end)
        m.d.comb += [
            taken.eq(camera.o.valid & camera.o.ready),
            *(getattr(sequencer, name).eq(getattr(self, name)) for name in _INPUTS),
            *(getattr(self, name).eq(getattr(sequencer, name)) for name in (*_OUTPUTS, "tag")),
            sequencer.frame_begun.eq(taken & ~inside & ~marker.broken),
            sequencer.frame_ended.eq(taken & marker.frame_end & ~marker.broken),
            sequencer.frame_broken.eq(taken & marker.broken),
            sequencer.laser_armed.eq(guard.armed),
            sequencer.lit.eq(guard.lit),
            guard.request.eq(sequencer.laser_request),
            guard.heartbeat.eq(sequencer.heartbeat),
            guard.tables_valid.eq(1),
            self.laser.eq(guard.laser),
            self.causes.eq(guard.causes),
        ]
        return m
