"""cocotb half of the memory port's bench: clients against a list of bytes, and planted faults."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.common.sram import SRAMPort
from tb.common.sram_model import SRAM
from tb.harness import parameters, start_clock

P = parameters()
CLIENTS = P.get("clients", 1)
LATENCY = SRAMPort.latency
PERIOD_PS = 62_500  # 16 MHz


def word_of(write, address, data, lanes):
    return write | address << 1 | data << 20 | lanes << 52


class Client:
    """Drives one client's commands with gaps; notes when each was taken, and what was answered."""

    def __init__(self, bench, index, gap, seed):
        self.bench, self.gap, self.rng = bench, gap, random.Random(f"client {index} {seed}")
        self.index = index
        self.valid = getattr(bench.dut, f"command_{index}_valid")
        self.ready = getattr(bench.dut, f"command_{index}_ready")
        self.payload = getattr(bench.dut, f"command_{index}_payload")
        self.answered = getattr(bench.dut, f"answer_{index}_valid")
        self.answer = getattr(bench.dut, f"answer_{index}_payload")
        self.valid.value = 0
        self.payload.value = 0
        self.queue, self.taken, self.offers = [], 0, False

    def begin(self):
        """Called in each clock before the pins settle."""
        if not self.offers and self.queue and self.rng.random() >= self.gap:
            self.offers = True
            self.payload.value = word_of(*self.queue[0])
        self.valid.value = self.offers


class Bench:
    """The port's clients and the memory; every answer is compared, and comes on time."""

    def __init__(self, dut, gap=0.0, seed=1):
        self.dut, self.clock = dut, 0
        self.bytes, self.due, self.log = {}, {}, []
        dut.rst.value = 1
        self.clients = [Client(self, index, gap, seed) for index in range(CLIENTS)]
        self.memory = SRAM(dut, seed=seed)
        start_clock(dut.clk, PERIOD_PS)

    async def reset(self):
        await ClockCycles(self.dut.clk, 2)
        self.dut.rst.value = 0
        await RisingEdge(self.dut.clk)

    async def run(self, clocks=None):
        """Until all queues are empty and answered, or for some clocks."""
        ends = None if clocks is None else self.clock + clocks
        while (self.clock < ends if clocks is not None else
               self.due or any(client.queue for client in self.clients)):
            for client in self.clients:
                client.begin()
            await ReadOnly()
            moved = []
            for client in self.clients:
                self._compare(client)
                if client.offers and int(client.ready.value):
                    moved.append(client)
            assert len(moved) <= 1, "two commands were taken together"
            waiting = [client.index for client in self.clients if client.offers]
            if moved:
                assert moved[0].index == waiting[0], "a client was passed over"
            await RisingEdge(self.dut.clk)
            for client in moved:
                self._take(client)
            self.clock += 1

    def _take(self, client):
        write, address, data, lanes = client.queue.pop(0)
        client.taken += 1
        self.log.append((self.clock, client.index, write))
        for lane in range(4):
            if write and lanes >> lane & 1:
                self.bytes[address, lane] = data >> 8 * lane & 0xFF
        if not write:
            self.due[client.index, self.clock + LATENCY] = (
                address, [self.bytes.get((address, lane)) for lane in range(4)])
        client.offers = False

    def _compare(self, client):
        want = self.due.pop((client.index, self.clock), None)
        answered = int(client.answered.value)
        assert answered == (want is not None), f"clock {self.clock}, client {client.index}"
        if want:
            got = client.answer.value.to_unsigned()
            for lane, byte in enumerate(want[1]):
                assert byte in (None, got >> 8 * lane & 0xFF), (
                    f"clock {self.clock}: address {want[0]} lane {lane} is {byte:#x}, got {got:#x}")


def accesses(rng, count, places, writes):
    return [(rng.random() < writes, rng.choice(places), rng.getrandbits(32),
             rng.choice([0xF, 0xF, 0x3, 0xC, rng.getrandbits(4)])) for _ in range(count)]


@cocotb.test(timeout_time=2, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.5, 0.9])
async def clients_share_the_memory(dut, gap):
    """Random accesses to a few words; lower clients leave gaps, or the others would starve."""
    bench = Bench(dut, gap, P["seed"])
    rng = random.Random(P["seed"])
    places = [0, 1, 0x7FFFF, *(rng.getrandbits(19) for _ in range(5))]
    for client in bench.clients:
        client.queue = [(1, place, rng.getrandbits(32), 15) for place in places]
    await bench.reset()
    await bench.run()
    for client in bench.clients:
        client.queue = [tuple(map(int, one)) for one in accesses(rng, 400, places, 0.4)]
    await bench.run()
    await bench.run(4)
    assert [client.taken for client in bench.clients] == [400 + len(places)] * CLIENTS
    assert bench.memory.unwritten == 0 and not bench.memory.faults
    assert bench.memory.writes == sum(write for _, _, write in bench.log)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_read_a_clock_and_two_clocks_a_write(dut):
    bench = Bench(dut, 0.0, P["seed"])
    await bench.reset()
    kinds = [1, 1, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0]
    bench.clients[-1].queue = [
        (kind, place % 3, 77 * place, 15) for place, kind in enumerate(kinds)]
    await bench.run()
    clocks = [clock for clock, _, _ in bench.log]
    assert [after - before for before, after in zip(clocks, clocks[1:], strict=False)] == [
        2 if kind else 1 for kind in kinds[:-1]]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_does_not_break_a_write(dut):
    """Whatever the phase in which reset comes, the word is written, and no other."""
    bench = Bench(dut, 0.0, P["seed"])
    await bench.reset()
    client = bench.clients[0]
    for wait in range(1, 5):
        client.queue = [(1, 5, 0x1000 + wait, 15), (1, 0, 0, 15)]
        await bench.run(wait)
        dut.rst.value = 1
        client.valid.value, client.offers = 0, False
        written = 0x1000 + wait
        await ClockCycles(dut.clk, 4)
        client.queue = []
        dut.rst.value = 0
        await RisingEdge(dut.clk)
        bench.due.clear()
        got = sum(bench.memory.words[5, lane] << 8 * lane for lane in range(4))
        assert got == written, f"reset after {wait} clocks"
    assert not bench.memory.faults


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def unwritten_words_are_counted(dut):
    bench = Bench(dut, 0.0, P["seed"])
    await bench.reset()
    bench.clients[0].queue = [
        (1, 9, 1, 15), (1, 10, 1, 3), (0, 9, 0, 0), (1, 12, 0, 15), (0, 10, 0, 0), (0, 9, 0, 0),
        (0, 11, 0, 0), (1, 13, 0, 15), (1, 14, 0, 15)]
    await bench.run()
    await bench.run(6)
    assert bench.memory.unwritten == 2
