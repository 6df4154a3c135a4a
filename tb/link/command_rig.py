"""Receiver and commands with memories for tables, as their benches use them."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.link.commands import Commands
from hdl.link.receiver import Receiver
from hdl.payloads import PacketOctet
from hdl.protocol import REMAP
from tb.link.table_rig import TableMemories

__all__ = ["SPACING", "CommandRig"]

#: Clocks from an octet to the next, at the least.
SPACING = 9
_INNER = ("i", "address", "data", "write_enable", "write_data", "damaged", "table_ready",
          "table_write", "table_read", "table_select", "table_address", "table_data", "table_word",
          "memory", "memory_word")


class CommandRig(wiring.Component):
    """Octets from the line to replies; the rest of the commands' ports are the rig's.

    ``ready``, ``flicker`` and ``wrong`` are those of :class:`tb.link.table_rig.TableMemories`;
    ``writes`` and ``clears`` count table writes and CLEARs.
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

        m.submodules.memories = memories = TableMemories(
            commands, self.bank, self.ready, self.flicker,
            commands.counts[REMAP.number] if commands.has_memory else None)
        m.d.sync += [
            self.writes.eq(self.writes + memories.written),
            self.clears.eq(self.clears + commands.clear)]
        m.d.comb += self.wrong.eq(memories.wrong)
        return m
