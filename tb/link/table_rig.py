"""Memories for the tables of the chip and outside, and the table access around them."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.link.table_access import TableAccess
from hdl.protocol import TABLES

__all__ = ["Access", "TableMemories", "TableRig"]


class TableMemories(wiring.Elaboratable):
    """The tables' memories at the table port of ``block``, which also has ``memory``, or not.

    ``wrong`` rises with an access that comes too soon, out of turn or outside the memory.
    ``written`` is high in the clock in which a word has been written.

    Parameters
    ----------
    block
        A component with the ports of :class:`hdl.link.table_access.TableAccess`.
    bank, ready, flicker
        Bank that acts; whether the tables are free; whether they are free only one clock of four,
        and the external memory three clocks of four.
    remap_words : :class:`int`
        Words of the remap table; None without one.
    """

    def __init__(self, block, bank, ready, flicker, remap_words):
        self.block, self.bank, self.ready, self.flicker = block, bank, ready, flicker
        self.remap_words = remap_words
        self.wrong, self.written = Signal(), Signal()

    def elaborate(self, platform):
        m = Module()
        block = self.block
        phase = Signal(2)
        m.d.sync += phase.eq(phase + 1)
        m.d.comb += block.table_ready.eq(self.ready & ((phase == 0) | ~self.flicker))
        self._add_tables(m)

        since = Signal(2, init=3)
        access = block.table_write | block.table_read
        m.d.sync += since.eq(since + (since != 3))
        with m.If(access):
            m.d.sync += since.eq(0)
            with m.If(~block.table_ready | (since != 3)
                      | (block.table_write & block.table_read)):
                m.d.sync += self.wrong.eq(1)
        upper_written = self._add_external(m, phase) if self.remap_words else 0
        m.d.comb += self.written.eq(block.table_write | upper_written)
        return m

    def _add_tables(self, m):
        """The tables of the chip: a word comes in the third clock, and in no other."""
        block = self.block
        answer = Signal(72)
        asked = Signal(2)
        m.d.sync += asked.eq(Cat(block.table_read, asked[0]))
        for table in TABLES:
            banks = 2 if table.banked else 1
            depth = 1 << (banks * table.words - 1).bit_length()
            memory = Memory(shape=table.bits, depth=depth, init=[])
            m.submodules[table.name] = memory
            port, read = memory.write_port(), memory.read_port()
            chosen, chosen_before = Signal(), Signal()
            m.d.comb += [
                chosen.eq(block.table_select == table.number),
                port.addr.eq(block.table_address if banks == 1 else Cat(
                    block.table_address[:(table.words - 1).bit_length()], ~self.bank)),
                port.data.eq(block.table_data),
                port.en.eq(block.table_write & chosen),
                read.addr.eq(port.addr),
                read.en.eq(block.table_read),
            ]
            with m.If(block.table_read):
                m.d.sync += chosen_before.eq(chosen)
            with m.If(asked[0] & chosen_before):
                m.d.sync += answer.eq(read.data)
        m.d.sync += block.table_word.eq(0)
        with m.If(asked[1]):
            m.d.sync += block.table_word.eq(answer)

    def _add_external(self, m, phase):
        """The external memory; high when the upper half of a word is written."""
        command, answer = self.block.memory, self.block.memory_word
        m.submodules.external = memory = Memory(shape=32, depth=2 * self.remap_words, init=[])
        port, read = memory.write_port(), memory.read_port()
        taken = command.valid & command.ready
        coming, stays = Signal(), Signal()
        before = Signal.like(Value.cast(command.p))
        m.d.comb += [
            command.ready.eq((phase != 2) | ~self.flicker),
            port.addr.eq(command.p.address),
            port.data.eq(command.p.data),
            port.en.eq(taken & command.p.write),
            read.addr.eq(command.p.address),
        ]
        m.d.sync += [
            coming.eq(taken & ~command.p.write),
            stays.eq(command.valid & ~command.ready),
            before.eq(command.p),
        ]
        # The word comes in the second clock, and in no other.
        m.d.sync += answer.valid.eq(coming)
        held = Signal(32)
        with m.If(coming):
            m.d.sync += held.eq(read.data)
        m.d.comb += answer.p.eq(Mux(answer.valid, held, 0))
        with m.If(stays & ~(command.valid & (Value.cast(command.p) == before))):
            m.d.sync += self.wrong.eq(1)
        with m.If(taken & ((command.p.address >= 2 * self.remap_words)
                           | (command.p.write & (command.p.lanes != 0b1111)))):
            m.d.sync += self.wrong.eq(1)
        return taken & command.p.write & command.p.address[0]


class Access(data.Struct):
    """A word to write, or an octet to read."""

    write: 1
    number: 3
    address: 16
    octet: 4
    word: 72


class TableRig(wiring.Component):
    """Accesses in, octets that were read out, which must be taken at once."""

    def __init__(self, preset, remap_words):
        self.access = TableAccess(preset)
        self.remap_words = remap_words if self.access.has_memory else None
        super().__init__({
            "i": In(stream.Signature(Access)), "o": Out(stream.Signature(8)), "bank": In(1),
            "ready": In(1), "flicker": In(1), "wrong": Out(1)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.access = access = self.access
        m.submodules.memories = memories = TableMemories(
            access, self.bank, self.ready, self.flicker, self.remap_words)
        request = self.i.p
        m.d.comb += [
            access.number.eq(request.number), access.address.eq(request.address),
            access.word.eq(request.word), access.octet_select.eq(1 << request.octet),
            access.write.eq(self.i.valid & request.write),
            access.read.eq(self.i.valid & ~request.write),
            self.i.ready.eq(access.done),
            self.o.valid.eq(access.done & ~request.write), self.o.payload.eq(access.octet),
            self.wrong.eq(memories.wrong),
        ]
        return m
