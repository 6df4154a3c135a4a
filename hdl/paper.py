"""The paper's demonstrator: camera pins in, serial pin and display out, external memory."""

from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, ResetSignal, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect, flipped

from .acquisition.front_end import FrontEnd, camera_pins
from .acquisition.sram_frames import SRAMFrames
from .common.sram import SRAMPins, SRAMPort
from .config import check_config
from .display.vga import VGA
from .link.point_link import PointLink
from .paper_points import FREE_BASE, PaperPoints
from .payloads import MemoryCommand, Status
from .ports import TABLE_PORT, connect_ports
from .protocol import DISPLAY_FAULTS

__all__ = ["BOARD", "Paper"]

_DISPLAY = ("hsync", "vsync", "visible", "red", "green", "blue")
#: Pins that only this preset has.
BOARD = {
    "pins": Out(SRAMPins()),
    "hsync": Out(1, init=1),
    "vsync": Out(1, init=1),
    "visible": Out(1),
    "red": Out(8),
    "green": Out(8),
    "blue": Out(8),
}


class Paper(wiring.Component):
    """Turns frames of laser spots into packets of 3-D points, as the paper does.

    A pattern frame is stored, its threshold is learnt, and it is read again, see
    :class:`.paper_points.PaperPoints`; texture frames go to the link as they pass. The members are
    those of :class:`hdl.capsule.Capsule`, and more. A pattern frame that begins while the one
    before is still in the image bank, or while four are on their way to the reader, is skipped
    whole and counted; at 25 pairs a second none is.

    The register ``weighted`` has no effect: all pixels weigh 1.

    **External memory**, 512K words of 32 bits, clients in the order in which they are served:

    ================ ===================================== =====================================
    client           words                                 accesses
    ================ ===================================== =====================================
    0 display        three banks of frames from 262,144    a write for 4 pixels of each pattern;
                     on, a word for 4 pixels               60 times a second a read for 4 pixels
    1 labelling      the image of labels from 131,072 on,  a write and a read for 2 pixels of
                     a word for 2 pixels                   each pattern
    2 remap          the remap table from 0 on, a      a read for 2 pixels of each pattern
                     word for 2 pixels
    3 ``memory``     any                                   the remap table, as it is loaded
    ================ ===================================== =====================================

    The remap table, see :class:`.preprocessing.remap.Remap`, must be written through ``memory``
    before frames are measured.

    The display shows the corrected pattern frames with their spots, in the domain ``display``, see
    :class:`.display.vga.VGA`.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices; the height is at most 480, which is that of the display.
    clock_gated : :class:`bool`
        Make the clock of the spot side a port, ``spot_clk``, with ``spot_rst``.

    Members
    -------
    pins : :py:`Out(SRAMPins())`
        The external memory.
    memory, memory_word : :py:`In(stream.Signature(MemoryCommand))`, \
    :py:`Out(stream.Signature(32, always_ready=True))`
        Access to it for the host; words that are read arrive in the order of the commands.
    display_faults : :py:`Out(3)`
        Faults of the display since reset, bits in the order of
        :data:`hdl.protocol.DISPLAY_FAULTS`.
    hsync, vsync, visible, red, green, blue
        The display.

    Attributes
    ----------
    registers : :class:`dict`
        Members for the registers that are used.
    """

    registers = {**FrontEnd.registers, **PaperPoints.registers, **PointLink.registers}

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
            "memory": In(stream.Signature(MemoryCommand)),
            "memory_word": Out(stream.Signature(32, always_ready=True)),
            "display_faults": Out(len(DISPLAY_FAULTS)),
            **BOARD,
        })

    def elaborate(self, platform):
        m = Module()
        size = {"width": self.config.width, "height": self.config.height}
        if not self.clock_gated:
            m.domains.spot = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]

        m.submodules.front_end = front_end = FrontEnd(self.config)
        m.submodules.points = points = PaperPoints(self.config)
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

        # Display of the corrected frames.
        m.submodules.frames = frames = SRAMFrames(**size, banks=3, base=FREE_BASE)
        m.submodules.vga = vga = VGA(**size)
        connect(m, points.corrected, frames.i)
        m.d.comb += [
            frames.info.eq(points.corrected_info),
            *(getattr(frames, name).eq(getattr(vga, name))
              for name in ("acquire", "fetch", "fetch_row", "turn", "row", "column")),
            *(getattr(vga, name).eq(getattr(frames, name)) for name in ("held", "frame", "data")),
            vga.overlay.valid.eq(link.sent.valid),
            vga.overlay.p.end.eq(link.sent.p.end),
            vga.overlay.p.ok.eq(link.sent.p.status == Status.OK),
            vga.overlay.p.u.eq(link.sent.p.u),
            vga.overlay.p.v.eq(link.sent.p.v),
            vga.overlay_number.eq(points.number),
            *(getattr(self, name).eq(getattr(vga, name)) for name in _DISPLAY),
        ]

        # Faults of the display.
        row_late = Signal()
        row_was_late = Signal()
        m.submodules.late_synchronizer = FFSynchronizer(row_late, row_was_late)
        m.d.display += row_late.eq(row_late | frames.late.any())
        m.d.sync += self.display_faults.eq(
            self.display_faults | Cat(frames.overrun, row_was_late, vga.undrawn.any()))

        # The external memory.
        m.submodules.port = port = SRAMPort(clients=4)
        connect(m, port.pins, flipped(self.pins))
        for client, (command, answer) in enumerate([
                (frames.command, frames.answer), (points.command[0], points.answer[0]),
                (points.command[1], points.answer[1]),
                (flipped(self.memory), flipped(self.memory_word))]):
            connect(m, command, port.command[client])
            connect(m, port.answer[client], answer)
        return m
