"""The sharing of banks, step by step, by one who may do anything at any time."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.acquisition.frame_banks import FrameBanks
from tb.harness import parameters, start_clock

#: (writer's, reader's) clock period in picoseconds.
CLOCKS = ((10_000, 10_000), (10_000, 7_300), (7_300, 10_000), (10_000, 83_000), (83_000, 10_000))
#: Most clocks of reader and writer that an answer takes.
ANSWER = FrameBanks.latency, 4


class Ports:
    """Writer and reader; ``whole`` are the infos of all frames that were closed, in order."""

    def __init__(self, dut, sync_ps, display_ps):
        self.dut, self.sync_ps, self.display_ps = dut, sync_ps, display_ps
        self.whole, self.refused = [], 0
        for name in ("opens", "info", "closes", "acquire", "give_back"):
            getattr(dut, name).value = 0
        dut.rst.value = 1
        dut.display_rst.value = 1
        start_clock(dut.clk, sync_ps)
        start_clock(dut.display_clk, display_ps)

    async def begin(self):
        for clock in (self.dut.clk, self.dut.display_clk):
            await ClockCycles(clock, 5)
        self.dut.display_rst.value = 0
        self.dut.rst.value = 0
        await ClockCycles(self.dut.clk, 1)

    async def store(self, info, clocks=2, broken=False):
        """A frame of so many clocks; the bank that it went to, or None."""
        dut = self.dut
        dut.opens.value = 1
        dut.info.value = info ^ 0x1FFFF  # sampled only at the end
        await ReadOnly()
        free, bank = bool(dut.free.value), int(dut.write_bank.value)
        await RisingEdge(dut.clk)
        dut.opens.value = 0
        await ClockCycles(dut.clk, clocks)
        self.refused += not free
        if free and not broken:
            dut.closes.value = 1
            dut.info.value = info
            await ReadOnly()
            assert int(dut.write_bank.value) == bank, "the bank moved within a frame"
            await RisingEdge(dut.clk)
            dut.closes.value = 0
            self.whole.append(info)
        return bank if free else None

    async def ask(self, want=True):
        """Wait until the reader may ask, ask, and wait for the answer; (bank, info, fresh)."""
        dut = self.dut
        while True:
            await ReadOnly()
            idle = bool(dut.idle.value)
            await RisingEdge(dut.display_clk)
            if idle:
                break
        (dut.acquire if want else dut.give_back).value = 1
        await RisingEdge(dut.display_clk)
        dut.acquire.value = 0
        dut.give_back.value = 0
        waited = 0
        while True:
            await ReadOnly()
            if dut.held.value or dut.idle.value:
                break
            await RisingEdge(dut.display_clk)
            waited += 1
        limit = ANSWER[0] * self.display_ps + ANSWER[1] * self.sync_ps
        if dut.held.value:
            assert waited * self.display_ps <= limit, f"an answer took {waited} clocks"
            answer = (int(dut.read_bank.value), dut.frame.value.to_unsigned(),
                      bool(dut.fresh.value))
        else:
            answer = None
        await RisingEdge(dut.display_clk)
        return answer


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(clocks=CLOCKS)
async def one_after_the_other(dut, clocks):
    """Nothing at first; then the newest; the same again is not fresh; broken ones never show."""
    ports = Ports(dut, *clocks)
    await ports.begin()
    assert await ports.ask() is None
    first = await ports.store(1)
    assert await ports.ask() == (first, 1, True)
    assert await ports.ask() == (first, 1, False)
    second = await ports.store(2, broken=True)
    assert second != first
    assert await ports.ask() == (first, 1, False)
    assert await ports.store(3) == second, "the bank of a broken frame takes the next one"
    if parameters()["banks"] == 2:
        assert await ports.store(4) is None
        assert await ports.ask() == (second, 3, True)
        assert await ports.store(5) == first
        assert await ports.ask(want=False) is None
        assert await ports.store(6) == second, "with no reader there is a bank for each frame"
        assert await ports.store(7) == first
        assert await ports.ask() == (first, 7, True)
        counted = 1, 2
    else:
        third = await ports.store(4)
        assert {first, second, third} == {0, 1, 2}
        for number in range(5, 9):
            assert await ports.store(number) in {second, third}
        assert await ports.ask() == (third if number % 2 == 0 else second, 8, True)
        counted = 0, 5
    await ClockCycles(dut.clk, 2)
    assert (dut.skipped.value.to_unsigned(), dut.unread.value.to_unsigned()) == counted


@cocotb.test(timeout_time=100, timeout_unit="ms")
@cocotb.parametrize(clocks=CLOCKS)
async def anything_goes(dut, clocks):
    """Writer and reader do as they like: banks never meet, and the newest frame is got."""
    rng = random.Random(f"{parameters()['seed']} {clocks}")
    ports = Ports(dut, *clocks)
    await ports.begin()
    held = [None]

    async def write():
        for number in range(200):
            bank = await ports.store(number + 1, rng.randrange(1, 12), rng.random() < 0.2)
            assert bank is not None or parameters()["banks"] == 2
            if rng.random() < 0.5:
                await ClockCycles(dut.clk, rng.randrange(1, 30))

    async def watch():
        while True:
            await RisingEdge(dut.clk)
            await ReadOnly()
            if dut.held.value and dut.free.value:
                assert dut.write_bank.value != dut.read_bank.value

    writer = cocotb.start_soon(write())
    watcher = cocotb.start_soon(watch())
    fresh = 0
    while not writer.done():
        least = ports.whole[-1] if ports.whole else 0
        answer = await ports.ask(rng.random() < 0.8)
        if answer:
            assert answer[1] in ports.whole and answer[1] >= least
            assert answer[2] == (answer[1] != held[0])
            held[0] = answer[1]
            fresh += answer[2]
        await ClockCycles(dut.display_clk, rng.randrange(1, 20))
    watcher.cancel()
    last = await ports.ask()
    assert last[1] == ports.whole[-1]
    fresh += last[2]
    await ClockCycles(dut.clk, 2)
    assert dut.skipped.value.to_unsigned() == ports.refused
    assert fresh + dut.unread.value.to_unsigned() == len(ports.whole)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def counters_stop_at_255(dut):
    ports = Ports(dut, 10_000, 10_000)
    await ports.begin()
    for number in range(260):
        await ports.store(number + 1, clocks=1)
    await ClockCycles(dut.clk, 2)
    assert dut.unread.value.to_unsigned() == 255
    if parameters()["banks"] == 2:
        await ports.ask()
        for number in range(260):
            await ports.store(number + 1, clocks=1)
        await ClockCycles(dut.clk, 2)
        assert dut.skipped.value.to_unsigned() == 255


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reader_reset_alone(dut):
    """The reader may be reset alone, for long enough: it holds nothing then, and can ask again."""
    ports = Ports(dut, 10_000, 7_300)
    await ports.begin()
    await ports.store(1)
    await ports.ask()
    for clocks in range(4):
        dut.acquire.value = 1
        await ClockCycles(dut.display_clk, clocks + 1)
        dut.acquire.value = 0
        dut.display_rst.value = 1
        await RisingEdge(dut.display_clk)
        await ReadOnly()
        assert not dut.held.value
        await ClockCycles(dut.display_clk, 8)
        dut.display_rst.value = 0
        await RisingEdge(dut.display_clk)
        assert (await ports.ask())[1] == 1
