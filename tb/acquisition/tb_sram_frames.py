"""A camera, an external memory that takes its time, and a reader with a clock of its own."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.acquisition.sram_frames import SRAMFrames
from tb.harness import parameters, start_clock

#: (writer's, reader's) clock period in picoseconds.
CLOCKS = ((10_000, 10_000), (10_000, 9_998), (10_000, 6_350), (10_000, 21_000))


def pixel(number, address):
    """A grey value that identifies its frame."""
    mixed = (number * 0x9E3779B1 ^ (address + 1) * 0x85EBCA6B) & 0xFFFFFFFF
    return ((mixed ^ mixed >> 15) * 0xC2B2AE35 & 0xFFFFFFFF) >> 24


class Memory:
    """Takes a command with a chance of 1 - ``stall`` a clock; answers come ``latency`` later."""

    def __init__(self, dut, stall, latency, seed):
        self.dut, self.stall, self.latency = dut, stall, latency
        self.rng = random.Random(f"memory {seed}")
        self.words, self.reads, self.writes = {}, 0, 0
        cocotb.start_soon(self._run())

    async def _run(self):
        dut, waiting = self.dut, []
        before = None
        clock = 0
        while True:
            ready = self.rng.random() >= self.stall
            dut.command_ready.value = ready
            due = waiting and waiting[0][0] <= clock
            dut.answer_valid.value = bool(due)
            dut.answer_payload.value = waiting.pop(0)[1] if due else self.rng.getrandbits(32)
            await ReadOnly()
            valid, payload = bool(dut.command_valid.value), int(dut.command_payload.value)
            if before is not None and not dut.rst.value:
                assert valid and payload == before, "a command changed before it was taken"
            before = payload if valid and not ready else None
            if valid and ready and not dut.rst.value:
                address, data = payload >> 1 & 0x7FFFF, payload >> 20 & 0xFFFFFFFF
                if payload & 1:
                    assert payload >> 52 == 15
                    self.words[address] = data
                    self.writes += 1
                else:
                    assert address in self.words, f"word {address} was never written"
                    waiting.append((clock + self.latency, self.words[address]))
                    self.reads += 1
            await RisingEdge(dut.clk)
            clock += 1


class Ports:
    """Camera and reader; ``clocks`` as in :data:`CLOCKS`, ``line`` clocks of a shown row."""

    def __init__(self, dut, clocks=CLOCKS[0], stall=0.0, latency=2, line=80):
        given = parameters()
        self.dut, self.line = dut, line
        self.width, self.height, self.banks = (given[name] for name in ("width", "height", "banks"))
        self.rng = random.Random(f"ports {given['seed']} {clocks} {stall}")
        for name in ("i_valid", "i_payload", "info", "acquire", "give_back", "fetch", "fetch_row",
                     "turn", "row", "column", "command_ready", "answer_valid", "answer_payload"):
            getattr(dut, name).value = 0
        dut.rst.value = 1
        dut.display_rst.value = 1
        start_clock(dut.clk, clocks[0])
        start_clock(dut.display_clk, clocks[1])
        self.memory = Memory(dut, stall, latency, given["seed"])
        self.whole, self.faults = [], 0

    async def begin(self):
        await ClockCycles(self.dut.clk, 8)
        await ClockCycles(self.dut.display_clk, 8)
        self.dut.rst.value = 0
        self.dut.display_rst.value = 0
        await ClockCycles(self.dut.clk, 4)

    async def send(self, number, gap=0.0, stop=None):
        """A frame, or its first ``stop`` pixels and a break."""
        dut, width = self.dut, self.width
        count = width * self.height
        await RisingEdge(dut.clk)
        for address in range(count if stop is None else stop + 1):
            while self.rng.random() < gap:
                dut.i_valid.value = 0
                await RisingEdge(dut.clk)
            dut.i_valid.value = 1
            line_end, frame_end = address % width == width - 1, address == count - 1
            word = pixel(number, address) | line_end << 8 | frame_end << 9
            dut.i_payload.value = 0x7FF if address == stop else word
            dut.info.value = number if address == 0 else self.rng.getrandbits(17)
            await RisingEdge(dut.clk)
        dut.i_valid.value = 0
        if stop is None:
            self.whole.append(number)
        elif stop:
            self.faults += 1

    async def acquire(self):
        """The newest frame's number, or None."""
        dut = self.dut
        while True:
            await ReadOnly()
            idle = bool(dut.idle.value)
            await RisingEdge(dut.display_clk)
            if idle:
                break
        dut.acquire.value = 1
        await RisingEdge(dut.display_clk)
        dut.acquire.value = 0
        await RisingEdge(dut.display_clk)
        for _ in range(2000):
            await ReadOnly()
            if dut.held.value or dut.idle.value:
                break
            await RisingEdge(dut.display_clk)
        number = int(dut.frame.value) if dut.held.value else None
        await RisingEdge(dut.display_clk)
        return number

    async def show(self, rows=None, repeat=1):
        """All rows of the held frame as a screen asks for them: grey values, row by row."""
        dut, picture = self.dut, []
        rows = range(self.height) if rows is None else rows
        await RisingEdge(dut.display_clk)
        dut.fetch.value, dut.fetch_row.value = 1, rows[0]
        await RisingEdge(dut.display_clk)
        dut.fetch.value = 0
        await ClockCycles(dut.display_clk, self.line)
        for row, following in zip(rows, [*rows[1:], None], strict=True):
            for again in range(repeat):
                last = again == repeat - 1
                got = []
                for clock in range(max(self.line, self.width + 4)):
                    dut.fetch.value = int(clock == 0 and last and following is not None)
                    dut.fetch_row.value = following or 0
                    dut.turn.value = int(clock == 2 and again == 0)
                    dut.row.value = row
                    dut.column.value = min(max(clock - 2, 0), self.width - 1)
                    await ReadOnly()
                    if 0 <= clock - 2 - SRAMFrames.latency < self.width:
                        got.append(int(dut.data.value))
                    await RisingEdge(dut.display_clk)
                picture.append(got)
        return picture

    def expected(self, number):
        return [[pixel(number, row * self.width + column) for column in range(self.width)]
                for row in range(self.height)]

    def counters(self):
        return [int(getattr(self.dut, name).value)
                for name in ("broken", "skipped", "unread", "late")]


@cocotb.test(timeout_time=100, timeout_unit="ms")
@cocotb.parametrize(clocks=CLOCKS, stall=[0.0, 0.6])
async def frames_are_whole(dut, clocks, stall):
    """Frames of every kind arrive all the time; each picture is one frame, the newest there was."""
    ports = Ports(dut, clocks, stall, latency=2 + int(5 * stall), line=110)
    await ports.begin()
    rng = ports.rng

    async def camera():
        for number in range(1, 1 << 16):
            faulty = rng.random() < 0.2
            await ports.send(number, 0.85, rng.randrange(ports.width * ports.height)
                             if faulty else None)
            await ClockCycles(dut.clk, rng.randrange(50, 300))

    sender = cocotb.start_soon(camera())
    shown = fresh = 0
    before = None
    while shown < 7:
        least = ports.whole[-2] if len(ports.whole) > 1 else 0
        number = await ports.acquire()
        if number is None:
            continue
        if ports.banks == 3:
            assert number >= least, f"frame {number} is not the newest"
        fresh += number != before
        assert bool(dut.fresh.value) == (number != before)
        before = number
        picture = await ports.show(repeat=1 + shown % 2)
        wanted = [row for row in ports.expected(number) for _ in range(1 + shown % 2)]
        assert picture == wanted, f"frame {number} is torn"
        shown += 1
    assert fresh > 2
    sender.cancel()
    broken, skipped, _, late = ports.counters()
    assert late == 0
    assert broken in (ports.faults, ports.faults + 1) and not dut.overrun.value
    assert not skipped or ports.banks == 2


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def accesses_are_counted(dut):
    """A write for each word of a frame, a read for each word of a row, whatever the scale."""
    ports = Ports(dut, line=200)
    await ports.begin()
    row_words = -(-ports.width // 4)
    await ports.send(1)
    await ClockCycles(dut.clk, 3 * row_words * ports.height)
    assert ports.memory.writes == row_words * ports.height and ports.memory.reads == 0
    assert await ports.acquire() == 1
    for repeat in (1, 3):
        ports.memory.reads = 0
        assert len(await ports.show(repeat=repeat)) == repeat * ports.height
        assert ports.memory.reads == row_words * ports.height
    rows = [0, 1, 2, 1, 4, 3, 0]
    assert await ports.show(rows=rows) == [ports.expected(1)[row] for row in rows]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_memory_that_stands_still(dut):
    """What the queue cannot hold breaks its frame, is counted, and the next frame is whole."""
    ports = Ports(dut, line=200)
    await ports.begin()
    await ports.send(1)
    assert await ports.acquire() == 1
    ports.memory.stall = 1.0
    words = -(-ports.width // 4) * ports.height
    frames = 512 // words + 3
    for number in range(2, 2 + frames):
        await ports.send(number)
    await ClockCycles(dut.clk, 2)
    assert ports.counters()[0] >= 2 and dut.overrun.value, "words were lost, and none was reported"
    lost = ports.counters()[0]
    ports.memory.stall = 0.0
    await ClockCycles(dut.clk, 4000)
    assert ports.counters()[0] == lost
    assert await ports.show() == ports.expected(1)
    last = await ports.acquire()
    assert last == (2 if ports.banks == 2 else frames + 1 - lost)
    assert await ports.show() == ports.expected(last)
    for number in range(frames + 10, frames + 15):
        await ports.send(number)
        await ClockCycles(dut.clk, 1500)
        assert await ports.acquire() == number
        assert await ports.show() == ports.expected(number)
    assert ports.counters()[0] == lost


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def late_rows_are_black_and_counted(dut):
    """A memory too slow for the screen: each row is right or zero, and zero ones are counted."""
    ports = Ports(dut, line=30)
    await ports.begin()
    await ports.send(7)
    await ClockCycles(dut.clk, 1000)
    assert await ports.acquire() == 7
    wanted = ports.expected(7)
    lates = 0
    for stall in (0.0, 0.3, 0.7, 0.85, 0.95):
        ports.memory.stall = stall
        picture = await ports.show()
        for got, row in zip(picture, wanted, strict=True):
            assert got in (row, [0] * ports.width)
            lates += got != row
        assert ports.counters()[3] == lates
        ports.memory.stall = 0.0
        await ClockCycles(dut.display_clk, 300)
    assert lates > 5
    assert await ports.acquire() == 7
    ports.line = 200
    assert await ports.show() == wanted
    assert ports.counters()[3] == lates


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def nothing_is_given_back_while_it_is_read(dut):
    """The reader asks for another frame with a row under way: the bank stays until it has come."""
    ports = Ports(dut, line=200)
    await ports.begin()
    for number in range(1, 12):
        await ports.send(number)
        await ClockCycles(dut.clk, 1500)
        assert await ports.acquire() == number
        ports.memory.stall = 0.8
        await RisingEdge(dut.display_clk)
        dut.fetch.value, dut.fetch_row.value = 1, number % ports.height
        await RisingEdge(dut.display_clk)
        dut.fetch.value = 0
        await ClockCycles(dut.display_clk, 2 * number)
        ports.memory.stall = 0.0
        await ports.acquire()
        assert await ports.show() == ports.expected(number)
