"""Lists of spots in, rows of diamonds out."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.display.overlay import DIAMONDS, Overlay
from hdl.payloads import OverlaySpot
from model.display.vga import draw_diamond
from tb.harness import parameters, start_clock
from tb.native_block import pack

NONE, OK, OTHER = range(3)


class Ports:
    """``width`` and the like are those of the block."""

    def __init__(self, dut, sync_ps=10_000, display_ps=7_300):
        self.dut = dut
        self.width, self.height, self.reach = (
            parameters()[name] for name in ("width", "height", "reach"))
        for name in ("i_valid", "i_payload", "number", "acquire", "prepare", "prepare_row",
                     "enable", "odd", "column"):
            getattr(dut, name).value = 0
        dut.rst.value = 1
        dut.display_rst.value = 1
        start_clock(dut.clk, sync_ps)
        start_clock(dut.display_clk, display_ps)

    async def begin(self):
        await ClockCycles(self.dut.clk, 5)
        await ClockCycles(self.dut.display_clk, 5)
        self.dut.rst.value = 0
        self.dut.display_rst.value = 0
        await ClockCycles(self.dut.clk, 2)

    async def send(self, number, spots, end=True, gap=None):
        """A list, a spot in every clock or with gaps."""
        dut = self.dut
        words = [int(row[0]) | int(row[1]) << 32 for row in pack(
            OverlaySpot, u=[u for u, _, _ in spots], v=[v for _, v, _ in spots],
            ok=[ok for _, _, ok in spots])] if spots else []
        for word in words + [1] * end:
            while gap is not None and gap.random() < 0.5:
                dut.i_valid.value = 0
                await RisingEdge(dut.clk)
            dut.i_valid.value = 1
            dut.i_payload.value = word
            dut.number.value = number if word == 1 else number ^ 0xFFFF
            await RisingEdge(dut.clk)
        dut.i_valid.value = 0
        await ClockCycles(dut.clk, 2)

    async def acquire(self):
        """Go on to the newest list; its number, or None."""
        self.dut.acquire.value = 1
        await RisingEdge(self.dut.display_clk)
        self.dut.acquire.value = 0
        await ClockCycles(self.dut.display_clk, 15)
        return int(self.dut.list_number.value) if self.dut.held.value else None

    async def draw(self, row, enable=1, clocks=None):
        """Have a row drawn in as many clocks as the contract has."""
        dut = self.dut
        dut.prepare.value, dut.prepare_row.value, dut.enable.value = 1, row, enable
        await RisingEdge(dut.display_clk)
        dut.prepare.value = 0
        dut.enable.value = 0
        await ClockCycles(dut.display_clk, clocks or self.width + 2 * DIAMONDS + 6)

    async def show(self, row):
        """All colours of a row that was drawn, by a column a clock."""
        dut, colours = self.dut, []
        dut.odd.value = row & 1
        for column in range(self.width + Overlay.latency):
            dut.column.value = min(column, self.width - 1)
            await ReadOnly()
            if column >= Overlay.latency:
                colours.append(int(dut.colour.value))
            await RisingEdge(dut.display_clk)
        return colours

    def expected(self, spots):
        """Colours of all pixels."""
        picture = np.zeros((self.height, self.width, 3), np.uint8)
        for u, v, ok in spots[:DIAMONDS]:
            draw_diamond(picture, u, v, ok, self.reach)
        return np.where(picture[..., 1] > 0, OK, np.where(picture[..., 0] > 0, OTHER, NONE))

    async def check(self, spots):
        """Draw all rows, each while the one before is shown."""
        wanted = self.expected(spots)
        for row in range(self.height):
            await self.draw(row)
            got = await self.show(row)
            assert got == list(wanted[row]), f"row {row}: {got}, not {list(wanted[row])}"
            if row:
                assert await self.show(row - 1) == list(wanted[row - 1]), f"row {row - 1} is gone"


def random_spots(rng, ports, count):
    return [(int(rng.integers(0, ports.width * 512)), int(rng.integers(0, ports.height * 512)),
             int(rng.integers(0, 2))) for _ in range(count)]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def lists_are_drawn(dut):
    """None, few, as many as there is room for, and more: all of it within the promised clocks."""
    rng = np.random.default_rng(parameters()["seed"])
    ports = Ports(dut)
    await ports.begin()
    assert await ports.acquire() is None
    await ports.check([])
    for number, count in enumerate((0, 1, 5, DIAMONDS, DIAMONDS + 3)):
        spots = random_spots(rng, ports, count)
        await ports.send(100 + number, spots, gap=rng if number % 2 else None)
        assert await ports.acquire() == 100 + number
        await ports.check(spots)
    assert int(dut.undrawn.value) == 3


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def borders_and_order(dut):
    """Diamonds that leave the picture on every side, and diamonds on top of each other."""
    rng = np.random.default_rng(parameters()["seed"])
    ports = Ports(dut)
    await ports.begin()
    right, bottom = ports.width * 512 - 1, ports.height * 512 - 1
    edges = [(u, v, (u ^ v) & 1) for u in (0, 255, 256, right) for v in (0, 255, 256, bottom)]
    middle = (ports.width * 256, ports.height * 256)
    stacked = [(*middle, 0), (middle[0] + 512, middle[1], 1), (*middle, 1),
               (middle[0], middle[1] + 1024, 0)]
    for number, spots in enumerate((edges, stacked, stacked[::-1])):
        await ports.send(number, spots)
        assert await ports.acquire() == number
        await ports.check(spots)
    row = ports.height // 2
    level = [(int(u), row * 512, int(u) & 1) for u in rng.integers(0, right, DIAMONDS)]
    await ports.send(9, level)
    assert await ports.acquire() == 9
    await ports.check(level)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_list_stays_until_it_is_given_back(dut):
    """Half a list is not seen, newer ones wait, and a row without `enable` has no diamonds."""
    rng = np.random.default_rng(parameters()["seed"])
    ports = Ports(dut)
    await ports.begin()
    first, second = random_spots(rng, ports, 20), random_spots(rng, ports, 30)
    await ports.send(1, first)
    assert await ports.acquire() == 1
    await ports.send(2, second[:15], end=False)
    await ports.check(first)
    assert await ports.acquire() == 1
    await ports.check(first)
    await ports.send(2, second[15:])
    for number in range(3, 8):
        await ports.send(number, random_spots(rng, ports, 40))
    await ports.check(first)
    await ports.send(8, second)
    assert await ports.acquire() == 8
    await ports.check(second)
    await ports.draw(2, enable=0)
    assert await ports.show(2) == [NONE] * ports.width
    await ports.draw(2)
    await ports.draw(2)
    assert await ports.show(2) == list(ports.expected(second)[2])


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def the_clocks_are_not_generous(dut):
    """The last diamond's last pixel comes in the last clocks that are promised."""
    ports = Ports(dut)
    await ports.begin()
    await ports.send(1, [(0, 0, 1)] * (DIAMONDS - 1) + [(0, 0, 0)])
    await ports.acquire()
    dut.odd.value = 0
    dut.column.value = ports.reach
    await ports.draw(0, clocks=ports.width + 2 * DIAMONDS + 2)
    await ReadOnly()
    assert int(dut.colour.value) == OK
    await ClockCycles(dut.display_clk, 4)
    await ReadOnly()
    assert int(dut.colour.value) == OTHER


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def undrawn_stops_at_255(dut):
    ports = Ports(dut)
    await ports.begin()
    for _ in range(3):
        await ports.send(1, [(0, 0, 1)] * (DIAMONDS + 100))
    assert int(dut.undrawn.value) == 255
