"""Whole frames from the sensor's pins to the reader's end of the serial line."""

import pickle
import time

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge, ValueChange

from hdl.capsule import Capsule
from hdl.protocol import TABLES
from scripts.host.decoder import Decoder
from tb.harness import parameters


class Rig:
    """The simulated rig: loads settings, shows frames, collects what the reader gets."""

    def __init__(self, dut):
        self.dut = dut
        with open(parameters()["case"], "rb") as file:
            self.case = pickle.load(file)
        self.octets = bytearray()

    async def begin(self):
        """Reset, load registers and tables, listen."""
        dut, settings = self.dut, self.case["settings"]
        dut.rst.value = 1
        divisor = self.case.get("divisor", 1)
        registers = {**settings.registers(), "divisor": divisor, "full_records": 1}
        for name in registers.keys() & Capsule.registers.keys():
            getattr(dut, name).value = registers[name]
        await ClockCycles(dut.clk, 4)
        dut.rst.value = 0
        await ClockCycles(dut.clk, 4)
        tables = settings.tables()
        dut.table_write.value = 1
        for table in TABLES:
            dut.table_select.value = table.number
            for address, word in enumerate(tables[table.name]):
                dut.table_address.value = address
                dut.table_data.value = word
                await RisingEdge(dut.clk)
        dut.table_write.value = 0
        dut.bank.value = 1
        cocotb.start_soon(self._listen())

    async def _listen(self):
        while True:
            await ValueChange(self.dut.octets)
            self.octets.append(self.dut.octet.value.to_unsigned())

    async def show(self):
        """Show every frame of the case, for each fault anew; wait until nothing comes any more."""
        dut = self.dut
        for name, value in self.case["sensor"].items():
            getattr(dut, name).value = value
        dut.frames.value = self.case["frames"]
        for fault in self.case["faults"]:
            for name in ("row", "extra", "lines"):
                getattr(dut, f"fault_{name}").value = fault.get(name, 0)
            await RisingEdge(dut.clk)
            dut.start.value = 1
            await RisingEdge(dut.done)
            dut.start.value = 0
        quiet = -1
        while quiet != len(self.octets):
            quiet = len(self.octets)
            await ClockCycles(dut.clk, 5000 * self.case.get("divisor", 1))


@cocotb.test()
async def reader_gets_what_the_model_says(dut):
    rig = Rig(dut)
    await rig.begin()
    begin = time.perf_counter()
    await rig.show()
    took = time.perf_counter() - begin
    assert not dut.framing_error.value, "the serial line broke the 8N1 framing"
    frames = Decoder().feed(bytes(rig.octets))
    with open(parameters()["answer"], "wb") as file:
        pickle.dump((frames, took), file)
