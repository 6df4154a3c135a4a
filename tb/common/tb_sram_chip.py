"""Both models of the memory under the same hand-made waves: good ones, and each fault by itself."""

import cocotb
from cocotb.triggers import ClockCycles, FallingEdge, RisingEdge, Timer

from tb.common.sram_model import SRAM
from tb.harness import start_clock

PERIOD_PS = 62_500
IDLE = {"address": 0, "data_out": 0, "data_drive": 0, "chip_enable_n": 1, "write_enable_n": 1,
        "output_enable_n": 1, "lanes_n": 0}


def write(address, data, lanes_n=0):
    """Half clocks of a write, as the port makes it."""
    pins = IDLE | {"address": address, "data_out": data, "chip_enable_n": 0, "lanes_n": lanes_n}
    low = pins | {"write_enable_n": 0}
    return [pins, low, low | {"data_drive": 1}, pins | {"data_drive": 1}]


def read(address):
    pins = IDLE | {"address": address, "chip_enable_n": 0}
    return [pins, pins | {"output_enable_n": 0}]


def changed(waves, **changes):
    """Waves with some half clocks changed: ``at_2={"address": 7}``."""
    waves = [dict(pins) for pins in waves]
    for name, pins in changes.items():
        waves[int(name[3:])].update(pins)
    return waves


PAUSE = [IDLE, IDLE]
FAULTS = {
    "address with the start": changed(write(5, 1), at_0={"address": 4}),
    "address with the end": changed(write(5, 1), at_3={"address": 4}),
    "address within": changed(write(5, 1), at_2={"address": 4}, at_3={"address": 4}),
    "lanes within": changed(write(5, 1), at_2={"lanes_n": 8}, at_3={"lanes_n": 8}),
    "chip enable with the end": changed(write(5, 1), at_3={"chip_enable_n": 1}),
    "not driven": changed(write(5, 1), at_2={"data_drive": 0}, at_3={"data_drive": 0}),
    "driven until the end only": changed(write(5, 1), at_3={"data_drive": 0}),
    "data changed with the end": changed(write(5, 1), at_3={"data_out": 2}),
    "driven while a read lasts": changed(read(5), at_1={"data_drive": 1}) + PAUSE,
    "driven with the end of a read": read(5) + [IDLE | {"data_drive": 1}] + PAUSE[1:],
    "read with the end of driving": write(5, 1) + [
        IDLE | {"chip_enable_n": 0, "output_enable_n": 0, "address": 5}] * 2,
}


class Waves:
    def __init__(self, dut):
        self.dut = dut
        dut.rst.value = 1
        self._set(IDLE)
        self.memory = SRAM(dut, strict=False, answers=False)
        start_clock(dut.clk, PERIOD_PS)

    def _set(self, pins):
        for name, value in pins.items():
            getattr(self.dut, f"pins_{name}").value = value

    async def reset(self):
        await ClockCycles(self.dut.clk, 2)
        self.dut.rst.value = 0
        await RisingEdge(self.dut.clk)

    async def play(self, waves):
        """A half clock for each set of pins; returns what was read before the rising edges."""
        seen = []
        assert len(waves) % 2 == 0
        for index, pins in enumerate(waves):
            self._set(pins)
            if index % 2:
                await Timer(PERIOD_PS // 2 - 100, unit="ps")
                seen.append(int(self.dut.pins_data_in.value))
                await RisingEdge(self.dut.clk)
            else:
                await FallingEdge(self.dut.clk)
        return seen

    def counts(self):
        return int(self.dut.violations.value), len(self.memory.faults)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def good_waves(dut):
    waves = Waves(dut)
    await waves.reset()
    await waves.play(write(5, 0x11223344) + write(6, 0xAABBCCDD, lanes_n=0b0110) + PAUSE)
    seen = await waves.play(read(5) + read(6) + write(6, 0x55667788, lanes_n=0b1001) + read(6)
                            + read(7) + PAUSE + PAUSE)
    assert seen[0] == 0x11223344 and seen[4] == 0xAA6677DD
    assert seen[1] & 0xFF0000FF == 0xAA0000DD
    assert waves.counts() == (0, 0), waves.memory.faults
    assert int(dut.unwritten.value) == 2  # half of word 6, and word 7
    assert int(dut.reads.value) == 4 and int(dut.writes.value) == 3 == waves.memory.writes


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(name=list(FAULTS))
async def faults_are_found(dut, name):
    waves = Waves(dut)
    await waves.reset()
    await waves.play(PAUSE + write(4, 0) + PAUSE)
    assert waves.counts() == (0, 0), waves.memory.faults
    await waves.play(FAULTS[name] + PAUSE + PAUSE)
    chip, pins = waves.counts()
    assert chip and pins, f"{name}: the chip saw {chip} faults, the pins {waves.memory.faults}"
