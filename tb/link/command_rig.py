"""Receiver and commands with memories for tables, as their benches use them."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.link.commands import Commands
from hdl.link.receiver import Receiver
from hdl.payloads import PacketOctet
from hdl.protocol import REMAP, TABLES

__all__ = ["SPACING", "CommandRig"]

#: Clocks from an octet to the next, at the least.
SPACING = 9
_INNER = ("i", "address", "data", "write_enable", "write_data", "damaged", "table_ready",
          "table_write", "table_read", "table_select", "table_address", "table_data", "table_word",
          "memory", "memory_word")


class CommandRig(wiring.Component):
    """Octets from the line to replies; the rest of the commands' ports are the rig's.

    ``flicker`` makes the tables unavailable three clocks of four, the external memory one of four.
    ``writes`` and ``clears`` count table writes and CLEARs; ``wrong`` tells that an access came too
    soon or out of turn.
    """

    def __init__(self, *arguments, **choices):
        self.commands = Commands(*arguments, **choices)
        self.outer = {name: member for name, member in self.commands.signature.members.items()
                      if name not in (*_INNER, "o")}
        super().__init__({
            "i": In(stream.Signature(8)), "o": Out(stream.Signature(PacketOctet)),
            "ready": In(1), "flicker": In(1), "damage": In(1), "writes": Out(16),
            "clears": Out(8), "wrong": Out(1), **self.outer})

    def elaborate(self, platform):
        m = Module()
        m.submodules.receiver = receiver = Receiver()
        m.submodules.commands = commands = self.commands
        wiring.connect(m, receiver.o, commands.i)
        wiring.connect(m, commands.o, wiring.flipped(self.o))
        for name, member in self.outer.items():
            mine, theirs = getattr(self, name), getattr(commands, name)
            m.d.comb += theirs.eq(mine) if member.flow == In else mine.eq(theirs)
        rest = Signal(range(SPACING))
        m.d.comb += [
            self.i.ready.eq(rest == 0),
            receiver.i.valid.eq(self.i.valid & self.i.ready),
            receiver.i.payload.eq(self.i.payload),
            receiver.address.eq(commands.address),
            commands.data.eq(receiver.data),
            receiver.write_enable.eq(commands.write_enable),
            receiver.write_data.eq(commands.write_data),
            commands.damaged.eq(receiver.damaged | self.damage),
        ]
        m.d.sync += rest.eq(rest - 1)
        with m.If(rest == 0):
            m.d.sync += rest.eq(0)
            with m.If(self.i.valid):
                m.d.sync += rest.eq(SPACING - 1)

        # The tables: the word comes in the third clock, and in no other.
        phase = Signal(2)
        m.d.sync += phase.eq(phase + 1)
        m.d.comb += commands.table_ready.eq(self.ready & ((phase == 0) | ~self.flicker))
        answer = Signal(72)
        asked = Signal(2)
        m.d.sync += asked.eq(Cat(commands.table_read, asked[0]))
        for table in TABLES:
            banks = 2 if table.banked else 1
            depth = 1 << (banks * table.words - 1).bit_length()
            memory = Memory(shape=table.bits, depth=depth, init=[])
            m.submodules[table.name] = memory
            port, read = memory.write_port(), memory.read_port()
            chosen, chosen_before = Signal(), Signal()
            m.d.comb += [
                chosen.eq(commands.table_select == table.number),
                port.addr.eq(commands.table_address if banks == 1 else Cat(
                    commands.table_address[:(table.words - 1).bit_length()], ~self.bank)),
                port.data.eq(commands.table_data),
                port.en.eq(commands.table_write & chosen),
                read.addr.eq(port.addr),
                read.en.eq(commands.table_read),
            ]
            with m.If(commands.table_read):
                m.d.sync += chosen_before.eq(chosen)
            with m.If(asked[0] & chosen_before):
                m.d.sync += answer.eq(read.data)
        m.d.sync += commands.table_word.eq(0)
        with m.If(asked[1]):
            m.d.sync += commands.table_word.eq(answer)

        since = Signal(2, init=3)
        access = commands.table_write | commands.table_read
        m.d.sync += since.eq(since + (since != 3))
        with m.If(access):
            m.d.sync += [since.eq(0), self.wrong.eq(
                self.wrong | ~commands.table_ready | (since != 3)
                | (commands.table_write & commands.table_read))]
        written = self._external(m, phase) if commands.has_memory else 0
        m.d.sync += [
            self.writes.eq(self.writes + (commands.table_write | written)),
            self.clears.eq(self.clears + commands.clear)]
        return m

    def _external(self, m, phase):
        """The external memory; high when the upper half of a word is written."""
        commands = self.commands
        command, answer = commands.memory, commands.memory_word
        m.submodules.external = memory = Memory(
            shape=32, depth=2 * commands.counts[REMAP.number], init=[])
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
        with m.If(taken & ((command.p.address >= 2 * commands.counts[REMAP.number])
                           | (command.p.write & (command.p.lanes != 0b1111)))):
            m.d.sync += self.wrong.eq(1)
        return taken & command.p.write & command.p.address[0]
