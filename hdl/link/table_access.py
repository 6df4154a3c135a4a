"""One way to the words of all tables, in the chip and in the external memory."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import MemoryCommand
from ..ports import TABLE_PORT
from ..protocol import MOST_BEAMS, PRESET_NAMES, REMAP, SMALL_SENSOR, tables

__all__ = ["TableAccess"]


class TableAccess(wiring.Component):
    """Writes a word of a table, or reads an octet of one, whichever memory it is in.

    ``write`` or ``read`` is held high, with everything that belongs to it, up to and with the
    clock in which ``done`` is high. Tables of the chip are accessed in clocks with
    ``table_ready``: a write is done in such a clock, a read three clocks after it. A word of the
    remap table, in the external memory, is two words there; both are written, and the one that
    holds the octet is read. Reset forgets an access.

    Parameters
    ----------
    preset : :class:`str`
        One of :data:`hdl.protocol.PRESET_NAMES`; only ``paper`` has an external memory.

    Members
    -------
    number, address : :py:`In`
        Number of the table in :func:`hdl.protocol.tables`, and of its word.
    word : :py:`In(72)`
        Word to write, in the low bits.
    octet_select : :py:`In(9)`
        Octet to read, one hot; 1 for a write.
    write, read : :py:`In(1)`
        Do it.
    done : :py:`Out(1)`
        The access ends in this clock.
    octet : :py:`Out(8)`
        The octet that was read, in that clock.
    table_ready : :py:`In(1)`
        No spot needs the tables in the next two clocks.
    table_write, table_read, table_select, table_address, table_data, table_word
        To the tables of the chip, see :class:`.commands.Commands`.
    memory, memory_word : :py:`Out(stream.Signature(MemoryCommand))`, \
    :py:`In(stream.Signature(32, always_ready=True))`
        To the external memory, in the preset ``paper`` only: word 2n has the lower half of word n
        of the remap table.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a read of a table of the chip, with ``table_ready``, to its octet.
    """

    latency = 3

    def __init__(self, preset="capsule"):
        if preset not in PRESET_NAMES:
            raise ValueError(f"Preset must be one of {', '.join(PRESET_NAMES)}, not {preset!r}")
        self.has_memory = preset == "paper"
        # Only the preset `paper` has a table of the size of the image.
        most = max(table.count(MOST_BEAMS, SMALL_SENSOR**2) for table in tables(preset))
        super().__init__({
            "number": In(range(len(tables(preset)))),
            "address": In(range(most)),
            "word": In(72),
            "octet_select": In(9),
            "write": In(1),
            "read": In(1),
            "done": Out(1),
            "octet": Out(8),
            "table_ready": In(1),
            **{name: member.flip() for name, member in TABLE_PORT.items() if name != "bank"},
            **({"memory": Out(stream.Signature(MemoryCommand)),
                "memory_word": In(stream.Signature(32, always_ready=True))}
               if self.has_memory else {}),
        })

    def elaborate(self, platform):
        m = Module()
        in_memory = self.number == REMAP.number if self.has_memory else C(0, 1)
        answer = Signal(72)
        octet = C(0, 8)
        for n, selected in enumerate(self.octet_select):
            octet |= answer.word_select(n, 8) & selected.replicate(8)
        m.d.comb += [
            self.table_select.eq(self.number),
            self.table_address.eq(self.address),
            self.table_data.eq(self.word),
            answer.eq(self.table_word),
            self.octet.eq(octet),
        ]
        with m.FSM():
            with m.State("IDLE"):
                with m.If(~in_memory):
                    m.d.comb += [
                        self.table_write.eq(self.write & self.table_ready),
                        self.table_read.eq(self.read & self.table_ready),
                        self.done.eq(self.table_write),
                    ]
                    with m.If(self.table_read):
                        m.next = "FIRST"
                if self.has_memory:
                    with m.Else():
                        self._use_memory(m)
            with m.State("FIRST"):
                m.next = "SECOND"
            with m.State("SECOND"):
                m.next = "THIRD"
            with m.State("THIRD"):
                m.d.comb += self.done.eq(1)
                m.next = "IDLE"
            if self.has_memory:
                with m.State("MEMORY"):
                    m.d.comb += [
                        answer.eq(Cat(self.memory_word.p, self.memory_word.p)),
                        self.done.eq(self.memory_word.valid),
                    ]
                    with m.If(self.done):
                        m.next = "IDLE"
        return m

    def _use_memory(self, m):
        """A command for the external memory, in the state IDLE."""
        half = Signal()  # the lower half was written
        upper = half | self.octet_select[4:8].any()
        m.d.comb += [
            self.memory.valid.eq(self.write | self.read),
            self.memory.p.write.eq(self.write),
            self.memory.p.address.eq(Cat(upper, self.address)),
            self.memory.p.data.eq(self.word[:64].word_select(upper, 32)),
            self.memory.p.lanes.eq(self.write.replicate(4)),
            self.done.eq(self.write & self.memory.ready & upper),
        ]
        with m.If(self.memory.ready):
            with m.If(self.write):
                m.d.sync += half.eq(~half)
            with m.Elif(self.read):
                m.next = "MEMORY"
