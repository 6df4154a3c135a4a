"""The instrument under cocotb: the host's commands bit by bit, pictures as the imager exposes."""

import pickle
from pathlib import Path

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge, ValueChange

from hdl.protocol import TABLES, Command
from scripts.host.chip import REGISTERS
from scripts.host.commands import table_octets
from scripts.host.decoder import Decoder, Frame, Reply
from scripts.host.framing import frame_packet
from scripts.host.loading import signed
from tb.harness import parameters


class Rig:
    """Host and imager of the simulated rig."""

    def __init__(self, dut):
        self.dut = dut
        with open(parameters()["case"], "rb") as file:
            self.case = pickle.load(file)
        self.octets, self.decoder, self.events, self.shown = bytearray(), Decoder(), [], []

    async def begin(self):
        """Reset; listen and look from then on."""
        dut = self.dut
        dut.rst.value = 1
        dut.line_blanking.value = self.case["line_blanking"]
        await ClockCycles(dut.clk, 8)
        dut.rst.value = 0
        cocotb.start_soon(self._listen())
        cocotb.start_soon(self._look())

    async def _listen(self):
        while True:
            await ValueChange(self.dut.octets)
            octet = bytes([self.dut.octet.value.to_unsigned()])
            self.octets += octet
            self.events += self.decoder.events(octet)

    async def _look(self):
        dut, patterns = self.dut, 0
        while True:
            await ValueChange(dut.exposures)
            microseconds = [counter.value.to_unsigned() / 16 for counter in (
                dut.integrated, dut.lit)]
            if microseconds[0] > 3000:
                image = self.case["texture"]
            else:
                image = self.case["images"][patterns % len(self.case["images"])]
                patterns += 1
            self.shown.append((image, *microseconds))
            Path(self.case["picture"]).write_text(image.tobytes().hex("\n"))
            dut.go.value = 1
            await ClockCycles(dut.clk, 8)
            dut.go.value = 0

    async def ask(self, command, data=b""):
        """Send a command, bit by bit, and give its reply."""
        seen = len(self.events)
        for octet in frame_packet(bytes([command, 1]) + data):
            self.dut.send_octet.value = octet
            sent = self.dut.sent.value.to_unsigned()
            self.dut.send.value = sent + 1
            while self.dut.sent.value.to_unsigned() == sent:
                await ValueChange(self.dut.sent)
        while True:
            for event in self.events[seen:]:
                if isinstance(event, Reply):
                    assert event.reason == 0, f"{command!r} was refused: {event.reason}"
                    return event
            await ValueChange(self.dut.octets)
            await RisingEdge(self.dut.clk)

    async def load(self):
        """All tables and registers, and start."""
        settings, width, height, beams = (
            self.case[name] for name in ("settings", "width", "height", "beams"))
        words = settings.tables()
        await self.ask(Command.BEGIN, b"".join(
            size.to_bytes(2, "little") for size in (width, height, beams)) + bytes([1]))
        for table in TABLES:
            step = 80 // table.octets
            for first in range(0, len(words[table.name]), step):
                await self.ask(Command.TABLE, bytes([table.number]) + first.to_bytes(2, "little")
                               + table_octets(table, words[table.name][first:first + step]))
        from zlib import crc32
        await self.ask(Command.COMMIT, b"".join(
            crc32(table_octets(table, words[table.name])).to_bytes(4, "little")
            for table in TABLES))
        for name, value in {**settings.registers(), "mode": 1}.items():
            await self.ask(Command.WRITE, bytes([REGISTERS[name].address])
                           + (signed(name, value) & 0xFFFFFFFF).to_bytes(4, "little"))


@cocotb.test()
async def pairs_reach_the_host(dut):
    rig = Rig(dut)
    await rig.begin()
    await rig.load()
    while sum(isinstance(event, Frame) and event.laser for event in rig.events) < (
            rig.case["pairs"]):
        await ClockCycles(dut.clk, 40_000)
    assert not dut.framing_error.value
    measured = {name: getattr(dut, name).value.to_unsigned()
                for name in ("pulses", "longest", "closest")}
    with open(parameters()["answer"], "wb") as file:
        pickle.dump({"octets": bytes(rig.octets), "shown": rig.shown, **measured}, file)
