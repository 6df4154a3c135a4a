"""The paper's demonstrator: camera pins in, serial pin and a screen out, a memory beside it."""

from amaranth.hdl import ClockDomain, ClockSignal, DomainRenamer, Module, ResetSignal, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from .acquisition.camera import Camera
from .acquisition.frame_gate import FrameGate
from .acquisition.sram_frames import SRAMFrames
from .common.point_fifo import PointFIFO
from .common.sram import SRAMPins, SRAMPort
from .config import FRAMES_IN_FLIGHT, check_config
from .display.vga import VGA
from .link.points import Points
from .link.quota import Quota
from .link.transmitter import Transmitter
from .paper_points import FREE_BASE, PaperPoints
from .payloads import FrameTag, MemoryCommand, PacketOctet, Status
from .ports import REGISTERS, TABLE_PORT, hand_on

__all__ = ["BOARD", "Paper"]

#: Clocks that the spot side goes on after the last sign of work: no block hides any for longer.
_LINGER = 127
_SCREEN = ("hsync", "vsync", "visible", "red", "green", "blue")
#: What the board has beside that of the preset ``capsule``.
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

    A pattern frame is stored, learnt from and read again, see :class:`.paper_points.PaperPoints`;
    texture frames go to the link as they pass. The members are those of
    :class:`hdl.capsule.Capsule`, and more. A pattern frame that begins while the one before still
    fills the image bank, or while four are on their way to the reader, is skipped whole and
    counted; at 25 pairs a second none is.

    The register ``weighted`` is not heard: all pixels weigh 1.

    **External memory**, 512K words of 32 bits, clients in the order in which they are served:

    ================ ===================================== =====================================
    client           words                                 accesses
    ================ ===================================== =====================================
    0 display        three banks of frames from 262,144    a write for 4 pixels of each pattern;
                     on, a word for 4 pixels               60 times a second a read for 4 pixels
    1 labelling      the image of labels from 131,072 on,  a write and a read for 2 pixels of
                     a word for 2 pixels                   each pattern
    2 places         the table of places from 0 on, a      a read for 2 pixels of each pattern
                     word for 2 pixels
    3 ``memory``     any                                   the table of places, as it is loaded
    ================ ===================================== =====================================

    The table of places, see :class:`.preprocessing.remap.Remap`, must be written through ``memory``
    before frames are measured.

    The screen shows the corrected pattern frames with their spots, in the domain ``display``, see
    :class:`.display.vga.VGA`.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices; the height is at most 480, which is that of the screen.
    gated : :class:`bool`
        Make the clock of the spot side a port, ``spot_clk``, with ``spot_rst``.

    Members
    -------
    pins : :py:`Out(SRAMPins())`
        The external memory.
    memory, memory_word : :py:`In(stream.Signature(MemoryCommand))`, \
    :py:`Out(stream.Signature(32, always_ready=True))`
        Access to it for the host; words that are read come in the order of the commands.
    hsync, vsync, visible, red, green, blue
        The screen.
    """

    def __init__(self, config, gated=False):
        check_config(config)
        self.config = config
        self.gated = gated
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            "tag": In(FrameTag),
            "tripped": In(1),
            "tables_valid": In(1),
            "reply": In(stream.Signature(PacketOctet)),
            "tx": Out(1, init=1),
            "cts": In(1),
            "busy": Out(1),
            "wake": In(1),
            "idle": Out(1),
            "frame_begun": Out(1),
            "frame_ended": Out(1),
            "frame_broken": Out(1),
            "bad_sync": Out(8),
            "overrun": Out(8),
            "skipped": Out(8),
            "packets": Out(16),
            "sending": Out(1),
            **REGISTERS,
            **TABLE_PORT,
            "memory": In(stream.Signature(MemoryCommand)),
            "memory_word": Out(stream.Signature(32, always_ready=True)),
            **BOARD,
        })

    def elaborate(self, platform):
        m = Module()
        size = {"width": self.config.width, "height": self.config.height}
        spot_side = DomainRenamer("spot")
        if not self.gated:
            m.domains.spot = ClockDomain(local=True)
            m.d.comb += [
                ClockSignal("spot").eq(ClockSignal()), ResetSignal("spot").eq(ResetSignal())]

        # Acquisition.
        m.submodules.camera = camera = Camera(**size)
        m.submodules.frame_gate = gate = FrameGate()
        m.submodules.measure = measure = PaperPoints(self.config)
        connect(m, camera.o, gate.i)
        connect(m, gate.info, measure.info)
        m.d.comb += [
            camera.frame_valid.eq(self.frame_valid),
            camera.line_valid.eq(self.line_valid),
            camera.data.eq(self.data),
            gate.tag.eq(self.tag),
            gate.tripped.eq(self.tripped),
            gate.tables_valid.eq(self.tables_valid),
            gate.learnt.eq(1),
            measure.i.valid.eq(gate.o.valid),
            measure.i.payload.eq(gate.o.payload),
            gate.o.ready.eq(1),
        ]

        # Spots to points; registers and tables.
        m.submodules.quota = quota = spot_side(Quota(FRAMES_IN_FLIGHT))
        m.submodules.point_fifo = point_fifo = spot_side(PointFIFO())
        m.submodules.points = points = spot_side(Points())
        register = {}
        for name in (*measure.registers, "points_max", "full_records"):
            register[name] = Signal(REGISTERS[name].shape, name=name)
            m.d.sync += register[name].eq(getattr(self, name))
        for name in measure.registers:
            m.d.comb += getattr(measure, name).eq(register[name])
        hand_on(m, TABLE_PORT, self, measure)
        connect(m, measure.o, quota.i)
        connect(m, measure.counts, quota.counts_i)
        connect(m, quota.o, point_fifo.i)
        connect(m, quota.counts_o, points.counts)
        connect(m, measure.frames, points.info)
        connect(m, point_fifo.o, points.i)
        m.d.comb += [
            quota.limit.eq(register["points_max"]),
            points.full_records.eq(register["full_records"]),
        ]

        # Link. Octets cross to the side whose clock never stops.
        m.submodules.transmitter = transmitter = Transmitter(**size)
        connect(m, points.o, transmitter.points)
        connect(m, flipped(self.reply), transmitter.reply)
        connect(m, gate.texture, transmitter.texture)
        connect(m, gate.texture_info, transmitter.texture_info)
        m.d.sync += [
            transmitter.more.eq(point_fifo.o.valid),
            transmitter.divisor.eq(self.divisor),
            transmitter.texture_enable.eq(self.texture_enable),
        ]
        m.d.comb += [
            transmitter.bad_sync.eq(camera.bad_sync),
            transmitter.overrun.eq(camera.overrun),
            transmitter.cts.eq(self.cts),
            self.tx.eq(transmitter.tx),
            self.packets.eq(transmitter.packets),
            self.sending.eq(transmitter.busy),
        ]

        # Display of the corrected frames.
        m.submodules.frames = frames = SRAMFrames(**size, banks=3, base=FREE_BASE)
        m.submodules.vga = vga = VGA(**size)
        connect(m, measure.corrected, frames.i)
        spot = quota.o.valid & quota.o.ready
        m.d.comb += [
            frames.info.eq(measure.corrected_info),
            *(getattr(frames, name).eq(getattr(vga, name))
              for name in ("acquire", "fetch", "fetch_row", "turn", "row", "column")),
            *(getattr(vga, name).eq(getattr(frames, name)) for name in ("held", "frame", "data")),
            vga.marks.valid.eq(spot),
            vga.marks.p.end.eq(quota.o.p.end),
            vga.marks.p.ok.eq(quota.o.p.status == Status.OK),
            vga.marks.p.u.eq(quota.o.p.u),
            vga.marks.p.v.eq(quota.o.p.v),
            vga.marks_number.eq(measure.number),
            *(getattr(self, name).eq(getattr(vga, name)) for name in _SCREEN),
        ]

        # The external memory.
        m.submodules.port = port = SRAMPort(clients=4)
        connect(m, port.pins, flipped(self.pins))
        for client, (command, answer) in enumerate([
                (frames.command, frames.answer), (measure.command[0], measure.answer[0]),
                (measure.command[1], measure.answer[1]),
                (flipped(self.memory), flipped(self.memory_word))]):
            connect(m, command, port.command[client])
            connect(m, port.answer[client], answer)

        # The spot side works while anything moves between its blocks, and a little longer.
        moves = Signal()
        linger = Signal(range(_LINGER + 1), init=_LINGER)
        m.d.comb += [
            moves.eq(measure.moves | self.wake | point_fifo.i.valid
                     | (point_fifo.o.valid & points.i.ready) | (points.o.valid & points.o.ready)),
            self.busy.eq(moves | linger.any()),
        ]
        with m.If(moves):
            m.d.sync += linger.eq(_LINGER)
        with m.Elif(linger.any()):
            m.d.sync += linger.eq(linger - 1)

        # For the sequencer and for the host.
        inside = Signal()
        beat = camera.o.valid & camera.o.ready
        mark = camera.o.p.mark
        with m.If(beat):
            m.d.sync += inside.eq(~mark.frame_end)
        m.d.comb += [
            self.idle.eq(measure.idle),
            self.frame_begun.eq(beat & ~inside & ~mark.broken),
            self.frame_ended.eq(beat & mark.frame_end & ~mark.broken),
            self.frame_broken.eq(beat & mark.broken),
            self.bad_sync.eq(camera.bad_sync),
            self.overrun.eq(camera.overrun),
            self.skipped.eq(gate.lost),
        ]
        return m
