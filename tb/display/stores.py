"""Frame stores as the screen's rig takes them: a module ``frame_store``, in Verilog."""

from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect

from hdl.acquisition.sram_frames import SRAMFrames
from hdl.common.sram import SRAMPort
from hdl.export import to_verilog
from tb.common.sram_chip import SRAMChip

__all__ = ["sram_store"]

_INNER = ("command", "answer")
_CHIP = {"violations": 16, "unwritten": 16, "reads": 32, "writes": 32}
#: The other client's words: the last ones.
_ELSEWHERE = 0x1FF00
#: Address bits of the memory: no more than three frames of 352 x 288 need, and the rig builds fast.
_CHIP_BITS = 17


class _Store(wiring.Component):
    """The store and its memory, which another client uses too, and first.

    That one writes or reads, in turn, every ``pace`` clocks.
    """

    def __init__(self, frames, pace):
        self.frames, self.pace = frames, pace
        self.names = [name for name in frames.signature.members if name not in _INNER]
        super().__init__({
            **{name: frames.signature.members[name] for name in self.names},
            **{name: Out(width) for name, width in _CHIP.items()}})

    def elaborate(self, platform):
        m = Module()
        m.submodules.frames = frames = self.frames
        m.submodules.port = port = SRAMPort(2)
        m.submodules.chip = chip = SRAMChip(_CHIP_BITS)
        connect(m, port.pins, chip.pins)
        connect(m, frames.command, port.command[1])
        connect(m, port.answer[1], frames.answer)
        for name in self.names:
            mine, its = getattr(self, name), getattr(frames, name)
            if name == "i":
                m.d.comb += [its.valid.eq(mine.valid), its.payload.eq(mine.payload)]
            elif self.signature.members[name].flow is In:
                m.d.comb += its.eq(mine)
            else:
                m.d.comb += mine.eq(its)
        m.d.comb += [getattr(self, name).eq(getattr(chip, name)) for name in _CHIP]

        command = port.command[0]
        clock = Signal(range(self.pace))
        count = Signal(8)
        m.d.sync += clock.eq(clock - 1)
        with m.If(clock == 0):
            m.d.sync += clock.eq(self.pace - 1)
        with m.If(command.valid & command.ready):
            m.d.sync += [command.valid.eq(0), count.eq(count + 1)]
        with m.Elif(clock == 0):
            m.d.sync += command.valid.eq(1)
        m.d.comb += [
            command.p.write.eq(~count[0]), command.p.address.eq(_ELSEWHERE | count[1:]),
            command.p.data.eq(count), command.p.lanes.eq(0b1111),
        ]
        return m


def sram_store(width, height, banks=3, pace=4):
    """Verilog texts of a :class:`.SRAMFrames` with all that it needs."""
    store = _Store(SRAMFrames(width, height, banks), pace)
    return {"frame_store.v": to_verilog(store, "frame_store")}
