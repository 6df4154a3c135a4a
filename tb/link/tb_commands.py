"""Bench of the commands, clock by clock: when replies come, and when what they say holds."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.link.commands import Commands
from hdl.link.receiver import Receiver
from hdl.protocol import TABLES, Command, Mode, Reason
from model.link.commands import CommandMachine
from model.link.receiver import encode
from tb.harness import Bench, parameters

GAP, STALL, SEED = (parameters()[name] for name in ("gap", "stall", "seed"))
PLAIN = ("ready", "flicker", "damage", "framing", "apply", "idle", "single_done", "laser_armed",
         "sensor_silent", "guard_causes", "pairs", "timeouts", "bad_sync", "overrun", "skipped",
         "packets")
CLOCKS_PER_MS = 1000
SENSOR = bytes([64, 0, 48, 0, 3, 0, 1])


class Rig(Bench):
    def __init__(self, dut):
        super().__init__(dut, gap=GAP, stall=STALL, seed=SEED, plain=dict.fromkeys(PLAIN, 0))
        dut.ready.value = 1
        self.model = CommandMachine(64, 48, 3, 2, clock_hz=CLOCKS_PER_MS * 1000)
        self.address = {entry.name: address for address, entry in self.model.registers.items()}

    async def reply(self):
        """The next reply's content, and the clock in which its last octet was taken."""
        octets = bytearray()
        while True:
            if not self.o.words:
                await RisingEdge(self.dut.clk)
                continue
            clock, word = self.o.words.pop(0)
            octets.append(word & 0xFF)
            if word >> 8:
                return bytes(octets), clock

    async def ask(self, command, data=b"", tag=7):
        content = bytes([command, tag]) + bytes(data)
        await self.i.send(encode(content))
        got, clock = await self.reply()
        assert got == self.model.reply(content), got.hex(" ")
        return clock

    def word(self, name, value):
        return bytes([self.address[name]]) + value.to_bytes(4, "little")

    async def write(self, name, value):
        await self.ask(Command.WRITE, self.word(name, value))

    async def pulse(self, *names):
        for name in names:
            getattr(self.dut, name).value = 1
        await RisingEdge(self.dut.clk)
        for name in names:
            getattr(self.dut, name).value = 0

    def values(self):
        return {name: int(getattr(self.dut, name).value) for name in self.address}


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def commit_takes_its_time(dut):
    """The first test of a run: no word has been written yet."""
    bench = Rig(dut)
    await bench.reset()
    await bench.ask(Command.BEGIN, SENSOR)
    checks = b"".join(check.to_bytes(4, "little") for check in bench.model.checks())
    await bench.i.send(encode(bytes([Command.COMMIT, 1]) + checks))
    bench.model.reply(bytes([Command.COMMIT, 1]) + checks)
    start = bench.cycle
    while not int(dut.o_valid.value):
        await RisingEdge(dut.clk)
    clocks = bench.cycle - start
    assert 0 <= parameters()["commit_clocks"] - clocks < 100
    assert (await bench.reply())[0][3] == Reason.OK
    assert not int(dut.tables_valid.value) and not int(dut.bank.value)
    await bench.pulse("apply")
    await ReadOnly()
    assert int(dut.tables_valid.value) and int(dut.bank.value)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def latency(dut):
    """From a packet's closing delimiter to the reply, through the receiver."""
    bench = Rig(dut)
    await bench.reset()
    for content in (bytes([Command.CLEAR, 1]), bytes([Command.CAPTURE, 2, 0, 0])):
        await bench.i.send(encode(content))
        while not int(dut.o_valid.value):
            await RisingEdge(dut.clk)
        assert bench.cycle - bench.i.taken[-1] == Receiver.latency + Commands.latency
        assert (await bench.reply())[0] == bench.model.reply(content)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def replies_keep_the_streams_rules(dut):
    """Every command, with long and short replies."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    await bench.ask(Command.BEGIN, SENSOR)
    for table in TABLES:
        words = min(88 // table.octets, bench.model.counts[table.number])
        head = bytes([table.number, 0, 0])
        octets = b"".join(rng.getrandbits(table.bits).to_bytes(table.octets, "little")
                          for _ in range(words))
        await bench.ask(Command.TABLE, head + octets)
        await bench.ask(Command.READ_TABLE, head + bytes([words]))
    for command in (Command.IDENTIFY, Command.STATUS, Command.CLEAR, 0x55):
        await bench.ask(command, tag=rng.getrandbits(8))
    for name, address in bench.address.items():
        await bench.write(name, 1)
        await bench.ask(Command.READ, [address])


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def registers_act_together(dut):
    """Nothing acts before ``apply``; in the clock after it everything that was written does."""
    bench = Rig(dut)
    await bench.reset()
    before = bench.values()
    for name in bench.address:
        await bench.write(name, 3 if name == "divisor" else 1)
    assert bench.values() == before
    for wait in (0, 5):
        await ClockCycles(dut.clk, wait + 1)
        dut.apply.value = 1
        await ReadOnly()
        assert bench.values() == before
        await RisingEdge(dut.clk)
        dut.apply.value = 0
        await ReadOnly()
        before = bench.values()
        assert before == {name: 3 if name == "divisor" else 1 for name in before}
        await RisingEdge(dut.clk)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def at_once_while_stopped_and_idle(dut):
    """Not before the reply is gone, so that a new divisor does not spoil it."""
    bench = Rig(dut)
    await bench.reset()
    dut.idle.value = 1
    for divisor in (50, 60):
        old = int(dut.divisor.value)
        content = bytes([Command.WRITE, 1]) + bench.word("divisor", divisor)
        sending = cocotb.start_soon(bench.i.send(encode(content)))
        while not bench.o.words or not bench.o.words[-1][1] >> 8:
            assert int(dut.divisor.value) == old
            await RisingEdge(dut.clk)
        await sending
        await bench.reply()
        await ClockCycles(dut.clk, 4)
        assert int(dut.divisor.value) == divisor
    # Not while frames are taken, idle or not.
    await bench.write("mode", Mode.CONTINUOUS)
    await ClockCycles(dut.clk, 4)
    assert int(dut.mode.value) == Mode.CONTINUOUS
    await bench.write("threshold_alpha", 9)
    await ClockCycles(dut.clk, 50)
    assert int(dut.threshold_alpha.value) != 9


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_single_pair_ends_by_itself(dut):
    bench = Rig(dut)
    await bench.reset()

    async def modes(acting, written):
        content = bytes([Command.READ, 2, bench.address["mode"]])
        await bench.i.send(encode(content))
        got, _ = await bench.reply()
        assert (int(dut.mode.value), got[4]) == (acting, written)

    async def write(mode):
        content = bytes([Command.WRITE, 2]) + bench.word("mode", mode)
        await bench.i.send(encode(content))
        await bench.reply()

    stop, run, single = Mode.STOP, Mode.CONTINUOUS, Mode.SINGLE
    await write(single)
    await bench.pulse("single_done")  # of nothing
    await modes(stop, single)
    await bench.pulse("apply")
    await modes(single, single)
    await bench.pulse("single_done")
    await modes(stop, stop)
    # Another pair was asked for meanwhile, or another mode.
    for mode in (single, run):
        await write(single)
        await bench.pulse("apply")
        await write(mode)
        await bench.pulse("single_done")
        await modes(stop, mode)
        await bench.pulse("apply")
        await modes(mode, mode)
    # Pairs end only where one is being taken; both pulses at once.
    await bench.pulse("single_done")
    await modes(run, run)
    await write(single)
    await bench.pulse("apply", "single_done")
    await modes(single, single)
    await bench.pulse("apply", "single_done")
    await modes(stop, stop)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def capture_lasts_as_long_as_asked(dut):
    bench = Rig(dut)
    await bench.reset()
    for milliseconds in (1, 3):
        lasted = 0
        sending = cocotb.start_soon(bench.i.send(encode(bytes([
            Command.CAPTURE, 1, milliseconds, 0]))))
        while not int(dut.capture.value):
            await RisingEdge(dut.clk)
        while int(dut.capture.value):
            lasted += 1
            await RisingEdge(dut.clk)
        assert lasted == milliseconds * CLOCKS_PER_MS
        await sending
        await bench.reply()
    # Asked for again before its end it begins anew; with none it ends at once.
    await bench.ask(Command.CAPTURE, [2, 0])
    await ClockCycles(dut.clk, CLOCKS_PER_MS)
    await bench.ask(Command.CAPTURE, [2, 0])
    await ClockCycles(dut.clk, 2 * CLOCKS_PER_MS - 600)
    assert int(dut.capture.value)
    await ClockCycles(dut.clk, 650)
    assert not int(dut.capture.value)
    await bench.ask(Command.CAPTURE, [255, 255])
    assert int(dut.capture.value)
    await bench.ask(Command.CAPTURE, [0, 0])
    assert not int(dut.capture.value)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def damage_gets_a_reply(dut):
    """Also while a packet waits or is answered: a reply is shared, a packet is not lost."""
    bench = Rig(dut)
    await bench.reset()
    damage = bytes([0x5A, 0, 0, Reason.DAMAGED_PACKET])
    await bench.pulse("damage")
    assert (await bench.reply())[0] == damage
    # A packet that is complete while the reply to damage cannot leave.
    bench.o.stall = 1.0
    await ClockCycles(dut.clk, 2)
    await bench.pulse("damage")
    content = bytes([Command.IDENTIFY, 9])
    await bench.i.send(encode(content))
    for _ in range(3):
        await ClockCycles(dut.clk, 20)
        await bench.pulse("damage")
    bench.o.stall = STALL
    replies = [(await bench.reply())[0] for _ in range(3)]
    assert replies == [damage, damage, bench.model.reply(content)]
    # Octets that come while a reply waits are lost; that is reported to the host.
    bench.o.stall = 1.0
    await ClockCycles(dut.clk, 2)
    await bench.i.send(encode(content))
    await ClockCycles(dut.clk, 60)
    await bench.i.send(encode(content))
    await ClockCycles(dut.clk, 60)
    bench.o.stall = STALL
    assert [(await bench.reply())[0] for _ in range(2)] == [bench.model.reply(content), damage]
    await bench.ask(Command.CLEAR)
    status = bytes([Command.STATUS, 1])
    bench.model.status.update(damaged=6)
    await bench.i.send(encode(status))
    assert (await bench.reply())[0] == bench.model.reply(status)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def numbers_of_two_octets_are_whole(dut):
    """Inputs count on while STATUS is answered: what it tells was so at some time."""
    bench = Rig(dut)
    await bench.reset()

    async def count():
        for value in range(0x1F0, 0xFFFF):
            dut.pairs.value = value
            dut.packets.value = 0xFFFF - value
            await RisingEdge(dut.clk)

    counting = cocotb.start_soon(count())
    for _ in range(12):
        await bench.i.send(encode(bytes([Command.STATUS, 1])))
        first = int(dut.pairs.value)
        got, _ = await bench.reply()
        data = got[4:]
        pairs, packets = (int.from_bytes(data[at:at + 2], "little") for at in (2, 15))
        assert first <= pairs < int(dut.pairs.value)
        assert first <= 0xFFFF - packets < int(dut.pairs.value)
        await ClockCycles(dut.clk, 37)
    counting.cancel()


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reset_forgets(dut):
    """Reset while a set is begun, written, checked, waiting, and while replies leave."""
    bench = Rig(dut)
    await bench.reset()
    for wait in (5, 150, 400, 3000):
        await bench.ask(Command.BEGIN, SENSOR)
        await bench.write("threshold_alpha", 1)
        await bench.pulse("apply")
        checks = b"".join(check.to_bytes(4, "little") for check in bench.model.checks())
        bench.i.append(encode(bytes([Command.COMMIT, 1]) + checks))
        await ClockCycles(dut.clk, wait)
        bench.i.kill()
        dut.i_valid.value = 0
        await bench.reset()
        bench.i.__init__(bench, "i", GAP, SEED)
        bench.o.words.clear()
        bench.model = CommandMachine(64, 48, 3, 2, clock_hz=CLOCKS_PER_MS * 1000)
        await ReadOnly()
        assert bench.values() == {name: value & 0x3FFFF
                                  for name, value in bench.model.acting.items()}
        await RisingEdge(dut.clk)
        await bench.pulse("apply")
        assert not int(dut.tables_valid.value) and not int(dut.bank.value)
        content = bytes([Command.COMMIT, 1]) + checks
        await bench.i.send(b"\0" + encode(content))
        assert (await bench.reply())[0][3] == Reason.NO_BEGIN
