"""Everything between the schedule and the stream of pixels: sequencer, laser guard, camera."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.acquisition.camera import Camera
from hdl.acquisition.laser_guard import LaserGuard
from hdl.acquisition.sequencer import Sequencer
from hdl.payloads import FrameTag, GreyPixel

__all__ = ["AcquisitionRig"]

_INPUTS = ("mode", "period_us", "pattern_reset_us", "pattern_us", "texture_reset_us", "texture_us")
_OUTPUTS = ("sensor_reset", "sensor_integrate", "sensor_read", "timeouts", "late", "silent",
            "heartbeat")


class AcquisitionRig(wiring.Component):
    """``guard``: other arguments for the laser guard, which may so be ready sooner."""

    def __init__(self, width, height, guard=None):
        self.sequencer, self.camera = Sequencer(), Camera(width, height)
        self.guard = LaserGuard(**(guard or {}))
        members = self.sequencer.signature.members
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            **{name: members[name] for name in (*_INPUTS, *_OUTPUTS)},
            "laser": Out(1),
            "causes": Out(5),
            "o": Out(stream.Signature(GreyPixel)),
            "tag": Out(FrameTag),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.sequencer = sequencer = self.sequencer
        m.submodules.guard = guard = self.guard
        m.submodules.camera = camera = self.camera
        m.submodules += FFSynchronizer(self.frame_valid, sequencer.sending)
        connect(m, camera.o, flipped(self.o))
        inside, taken = Signal(), Signal()
        mark = camera.o.p.mark
        with m.If(taken):
            m.d.sync += inside.eq(~mark.frame_end)
        m.d.comb += [
            taken.eq(camera.o.valid & camera.o.ready),
            *(getattr(sequencer, name).eq(getattr(self, name)) for name in _INPUTS),
            *(getattr(self, name).eq(getattr(sequencer, name)) for name in (*_OUTPUTS, "tag")),
            *(getattr(camera, name).eq(getattr(self, name))
              for name in ("frame_valid", "line_valid", "data")),
            sequencer.frame_begun.eq(taken & ~inside & ~mark.broken),
            sequencer.frame_ended.eq(taken & mark.frame_end & ~mark.broken),
            sequencer.frame_broken.eq(taken & mark.broken),
            sequencer.laser_armed.eq(guard.armed),
            sequencer.lit.eq(guard.lit),
            guard.request.eq(sequencer.laser_request),
            guard.heartbeat.eq(sequencer.heartbeat),
            guard.tables_valid.eq(1),
            self.laser.eq(guard.laser),
            self.causes.eq(guard.causes),
        ]
        return m
