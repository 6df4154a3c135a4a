"""From the camera's pins to whole frames: pattern frames one way, texture frames the other."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect, flipped

from ..config import check_config
from ..payloads import FrameInfo, FrameTag, GreyPixel
from ..ports import connect_ports, sample_registers
from .addressed_camera import AddressedCamera
from .camera import Camera
from .frame_gate import FrameGate

__all__ = ["FrontEnd", "camera_pins"]


def camera_pins(config):
    """Members for the pins of the camera that ``config`` chooses, as that camera has them."""
    if config.converter_latency is None:
        return {"frame_valid": In(1), "line_valid": In(1), "data": In(8)}
    return {"row": Out(range(config.height)), "column": Out(range(config.width)),
            "convert": Out(1), "data": In(8), "sensor_read": In(1)}


class FrontEnd(wiring.Component):
    """Takes frames from the camera's pins, numbers them, and separates patterns from texture.

    Which camera it is depends on the configuration. Pixels cannot wait at the pins: what is not
    taken at once is lost and counted, see :class:`.camera.Camera` and
    :class:`.frame_gate.FrameGate`.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.

    Members
    -------
    camera_pins, ports, registers
        See :class:`hdl.capsule.Capsule`.
    o, info : :py:`Out(stream.Signature(GreyPixel))`, :py:`Out(stream.Signature(FrameInfo))`
        Pattern frames and their announcements, see :class:`.frame_gate.FrameGate`.
    texture, texture_info
        The same two for texture frames.

    Attributes
    ----------
    ports : :class:`dict`
        Members that go through to the sequencer and to the host.
    registers : :class:`dict`
        Members for the registers that are used.
    """

    ports = {
        "tag": In(FrameTag),
        "tripped": In(1),
        "tables_valid": In(1),
        "frame_begun": Out(1),
        "frame_ended": Out(1),
        "frame_broken": Out(1),
        "frame_sending": Out(1),
        "bad_sync": Out(8),
        "overrun": Out(8),
        "skipped": Out(8),
    }
    registers = FrameGate.registers

    def __init__(self, config):
        check_config(config)
        self.config = config
        super().__init__({
            **camera_pins(config),
            **self.ports,
            **self.registers,
            "o": Out(stream.Signature(GreyPixel)),
            "info": Out(stream.Signature(FrameInfo)),
            "texture": Out(stream.Signature(GreyPixel)),
            "texture_info": Out(stream.Signature(FrameInfo)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.camera = camera = self._camera(m)
        connect_ports(m, camera_pins(self.config), self, camera)

        m.submodules.frame_gate = gate = FrameGate()
        connect(m, camera.o, gate.i)
        for name in ("o", "info", "texture", "texture_info"):
            connect(m, getattr(gate, name), flipped(getattr(self, name)))
        register = sample_registers(m, self)
        m.d.comb += [
            *(getattr(gate, name).eq(getattr(self, name))
              for name in ("tag", "tripped", "tables_valid")),
            *(getattr(gate, name).eq(register[name]) for name in gate.registers),
            self.skipped.eq(gate.lost),
        ]

        # Events for the sequencer.
        inside = Signal()
        beat = camera.o.valid & camera.o.ready
        marker = camera.o.p.marker
        with m.If(beat):
            m.d.sync += inside.eq(~marker.frame_end)
        m.d.comb += [
            self.frame_begun.eq(beat & ~inside & ~marker.broken),
            self.frame_ended.eq(beat & marker.frame_end & ~marker.broken),
            self.frame_broken.eq(beat & marker.broken),
        ]
        return m

    def _camera(self, m):
        """The camera, and what its pins report about its frames."""
        config = self.config
        size = {"width": config.width, "height": config.height}
        if config.converter_latency is None:
            camera = Camera(**size)
            m.submodules.sending_synchronizer = FFSynchronizer(
                self.frame_valid, self.frame_sending)
            m.d.comb += [self.bad_sync.eq(camera.bad_sync), self.overrun.eq(camera.overrun)]
            return camera
        # Nothing can be lost there; only a new read-out ends a frame before its time.
        camera = AddressedCamera(
            **size, converter_latency=config.converter_latency, interval=config.converter_interval)
        m.d.comb += self.frame_sending.eq(camera.sending)
        broken = camera.o.valid & camera.o.ready & camera.o.p.marker.broken
        with m.If(broken & ~self.bad_sync.all()):
            m.d.sync += self.bad_sync.eq(self.bad_sync + 1)
        return camera
