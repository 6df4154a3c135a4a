"""The imager at its pins, driven by hand."""

import cocotb
import numpy as np
from cocotb.triggers import RisingEdge, Timer

from model.optics.imager import DARK, Imager, Light
from tb.acquisition.imager_pins import ImagerPins
from tb.acquisition.laser_driver import LaserDriver

PIXEL_PS = 125_000


class Board:
    """Pins without a chip behind them, and an imager of 6 x 4 pixels in even light."""

    def __init__(self, dut, blanking=3):
        self.dut = dut
        for name in ("sensor_reset", "sensor_integrate", "sensor_read", "laser"):
            getattr(dut, name).value = 0
        light = Light(np.full((4, 6), 0.5), np.full((4, 6), 2.0))
        self.imager = ImagerPins(dut, Imager(light), PIXEL_PS, blanking)
        self.seen = []
        cocotb.start_soon(self._see())

    async def _see(self):
        while True:
            await RisingEdge(self.dut.pixel_clk)
            if self.dut.frame_valid.value and self.dut.line_valid.value:
                self.seen.append(self.dut.data.value.to_unsigned())

    async def level(self, name, level, then_us):
        getattr(self.dut, name).value = level
        await Timer(round(then_us * 1_000_000), unit="ps")

    async def expose(self, integrate_us, reset_us=5):
        if reset_us:
            await self.level("sensor_reset", 1, reset_us)
        await self.level("sensor_reset", 0, 0.1)
        await self.level("sensor_integrate", 1, integrate_us)
        await self.level("sensor_integrate", 0, 0.1)

    async def read(self, then_us=20):
        await self.level("sensor_read", 1, 1)
        await self.level("sensor_read", 0, then_us)

    async def blink(self, changes, every_us):
        for _ in range(changes):
            await self.level("laser", 1 - int(self.dut.laser.value), every_us)


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(blanking=[0, 3, 48])
async def exposures(dut, blanking):
    """Dark level plus light times time; a frame again if it is read again; none without reset."""
    board = Board(dut, blanking)
    wait = 4 * (6 + blanking) / 8 + 5
    await board.expose(10)
    await board.read(wait)
    await board.expose(40)
    await board.read(wait)
    await board.read(wait)
    await board.expose(20, reset_us=0)
    await board.read(wait)
    levels = [10 * 0.5, 40 * 0.5, 40 * 0.5, 60 * 0.5]
    assert board.seen == [round(DARK + level) for level in levels for _ in range(24)]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def no_reset_since_power_on(dut):
    board = Board(dut)
    await board.expose(10, reset_us=0)
    await board.read()
    assert board.seen == [255] * 24


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(changes=[0, 1, 400], every=[1, 2])
async def laser_lights_by_its_edges(dut, changes, every):
    """The AC-coupled driver, here by events, gives the light of the one that goes by clocks."""
    board = Board(dut)
    dut.laser.value = 1
    await Timer(10, unit="us")  # high for long: dark
    driver, pin = LaserDriver(), 1
    driver.step(pin)
    driver.step(pin)
    lit = 0
    for clock in range(changes * every):
        pin ^= clock % every == 0
        lit += driver.step(pin)
    cocotb.start_soon(blink_inside(board, changes, every * 0.0625))
    await board.expose(60)
    await board.read()
    assert abs(board.imager.taken[0][1] - lit * 0.0625) < 1e-9
    assert board.seen == [round(DARK + 60 * 0.5 + lit * 0.0625 * 2.0)] * 24


async def blink_inside(board, changes, every_us):
    await RisingEdge(board.dut.sensor_integrate)
    await Timer(1, unit="us")
    await board.blink(changes, every_us)


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(spoilt=["sensor_reset", "sensor_integrate"])
async def rows_are_spoilt_during_the_read_out(dut, spoilt):
    """Rows that are still to come show a reset, or light that falls on them, in the read-out."""
    board = Board(dut, blanking=48)
    await board.expose(40)
    await board.read(0.1)
    await RisingEdge(dut.line_valid)  # of the second row
    await board.level(spoilt, 1, 1)
    await board.level(spoilt, 0, 40)
    rows = np.array(board.seen).reshape(4, 6)
    assert np.all(rows[:2] == 25)
    assert np.all(rows[2:] == (DARK if spoilt == "sensor_reset" else round(25.5)))


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def read_is_not_heard_twice(dut):
    board = Board(dut, blanking=48)
    await board.expose(40)
    await board.read(3)
    await board.read(3)
    await board.read(40)
    assert len(board.seen) == 24


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def silent_and_stopped(dut):
    board = Board(dut)
    board.imager.silent = True
    await board.expose(10)
    await board.read()
    assert not board.seen
    board.imager.silent, board.imager.stop_at = False, 2
    await board.expose(10)
    await board.read()
    assert len(board.seen) == 12 and dut.frame_valid.value
    board.imager.stop_at = None
    await board.expose(10)
    assert not dut.frame_valid.value
    await board.read()
    assert board.seen[12:] == [10] * 24
