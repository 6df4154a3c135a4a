"""Bench of the packet receiver: packets, damage and their clocks equal the model's."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.link.receiver import Receiver
from model.link.receiver import PacketReceiver, encode
from tb.harness import Bench, parameters

SEED = parameters()["seed"]
PORTS = ("i_valid", "i_payload", "o_ready", "address", "write_enable", "write_data")


class Rig(Bench):
    """Sends octets and does to the block what its reader does."""

    def __init__(self, dut, spacing=9):
        super().__init__(dut, inputs=(), outputs=(), plain=dict.fromkeys(PORTS, 0))
        self.model = PacketReceiver()
        self.spacing = spacing
        self.held = False

    async def clock(self, octet=None):
        """One clock, with an octet or none; True if the block says damaged in it."""
        self.dut.i_valid.value = octet is not None
        self.dut.i_payload.value = octet or 0
        await ReadOnly()
        damaged = bool(self.dut.damaged.value)
        assert not (damaged and self.dut.o_valid.value and not self.held)
        await RisingEdge(self.dut.clk)
        return damaged

    async def send(self, octets):
        """Send, check after each octet what the block says; the last whole packet's content."""
        last = None
        for octet in octets:
            wanted = self.model.receive(octet, self.held)
            damages = [await self.clock(octet)]
            for _ in range(self.spacing - 1):
                damages.append(await self.clock())
            assert damages == [
                n == Receiver.latency and wanted is False for n in range(self.spacing)]
            if wanted:
                assert not self.held
                self.held, last = True, wanted
            assert bool(self.dut.o_valid.value) == self.held
            if self.held and wanted:
                assert int(self.dut.o_payload.value) == len(wanted)
        return last

    async def read(self, length):
        octets = bytearray()
        for address in range(length):
            self.dut.address.value = address
            await self.clock()
            await ReadOnly()
            octets.append(int(self.dut.data.value))
            await RisingEdge(self.dut.clk)
        return bytes(octets)

    async def release(self):
        self.dut.o_ready.value = 1
        await self.clock()
        self.dut.o_ready.value = 0
        await ReadOnly()
        assert not self.dut.o_valid.value
        await RisingEdge(self.dut.clk)
        self.held = False

    async def exchange(self, octets):
        """Send a packet that must arrive, read it, and let go of it."""
        content = await self.send(octets)
        assert content is not None
        assert await self.read(len(content)) == content
        await self.release()
        return content


def random_content(rng, length=None):
    length = rng.randint(2, 93) if length is None else length
    choices = rng.choice([[0], [0, 1], range(256), range(256), [255], [0, 0x7E, 1, 93, 97, 98]])
    return bytes(rng.choice(choices) for _ in range(length))


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(spacing=[9, 20])
async def packets_of_every_length(dut, spacing):
    bench = Rig(dut, spacing)
    await bench.reset()
    rng = random.Random(SEED)
    for length in [*range(2, 94, 1 if spacing == 9 else 7), 93, 2]:
        content = random_content(rng, length)
        assert await bench.exchange(encode(content)) == content


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def lengths_outside_are_damaged(dut):
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    for length in (0, 1, 94, 95, 96, 120, 123, 124, 127, 128, 200):
        assert await bench.send(encode(random_content(rng, length))) is None
        await bench.exchange(encode(random_content(rng)))
    # Long ones of which every count and sum wraps, and codes that a packet cannot hold.
    for octets in (b"\1" * 300, bytes([255]) + b"\7" * 254, bytes([98]) + b"\7" * 97,
                   bytes([129, 1]), bytes([128, 1]), b"\1" * 97, b"\1" * 98, b"\1" * 99):
        assert await bench.send(b"\0" + octets + b"\0") is None
        await bench.exchange(encode(random_content(rng)))


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def damage_costs_what_it_hits(dut):
    """Octets changed, lost and added anywhere: what the model says, and the next one is right."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    for _ in range(80):
        octets = bytearray(encode(random_content(rng, rng.choice([2, 5, 30, None]))))
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(octets))
            match rng.randrange(3):
                case 0:
                    octets[at] ^= 1 << rng.randrange(8)
                case 1:
                    del octets[at]
                case 2:
                    octets.insert(at, rng.getrandbits(8))
        for piece in bytes(octets).split(b"\0"):
            if await bench.send(piece + b"\0"):
                await bench.release()
        await bench.exchange(encode(random_content(rng)))


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def every_changed_bit_is_found(dut):
    bench = Rig(dut)
    await bench.reset()
    octets = encode(bytes([2, 0x31, 0x22, 0, 0x5A, 0]))
    for place in range(8, 8 * (len(octets) - 1)):
        changed = bytearray(octets)
        changed[place // 8] ^= 1 << place % 8
        assert await bench.send(changed) is None
    await bench.exchange(octets)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def nothing_is_stored_while_held(dut):
    """The buffer stays its reader's; a packet that began before it was let go is damaged."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    for cut in (0, 1, 2, 5, 1000):
        content = await bench.send(encode(random_content(rng, 40)))
        other = encode(random_content(rng, 40))
        assert await bench.send(other[:cut]) is None
        # What the reader writes is there, the rest as it was.
        mine = bytearray(content)
        for address in rng.sample(range(40), 10):
            mine[address] = rng.getrandbits(8)
            dut.address.value, dut.write_data.value = address, mine[address]
            dut.write_enable.value = 1
            await bench.clock()
            dut.write_enable.value = 0
        assert await bench.read(40) == mine
        await bench.release()
        got = await bench.send(other[cut:])
        if cut > 1:
            assert got is None
        else:
            assert got
            await bench.release()
        await bench.exchange(encode(random_content(rng)))


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def empty_packets_are_none(dut):
    bench = Rig(dut)
    await bench.reset()
    assert await bench.send(b"\0" * 20) is None
    await bench.exchange(encode(b"\1\2") + b"\0" * 3)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reset_forgets(dut):
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    octets = encode(bytes(range(1, 20)))
    for count in range(1, len(octets) + 1):
        await bench.send(octets[:count])
        await bench.reset(1 + count % 2)
        bench.model, bench.held = PacketReceiver(), False
        await bench.exchange(encode(random_content(rng))[1:])
