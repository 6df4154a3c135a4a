"""Bench of the fields of replies: their octets are the model's, however they are stepped."""

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.protocol import IDENTITY_FIELDS, STATUS_FIELDS
from model.link.reply_fields import field_octets
from tb.harness import Bench, parameters

SEED, IDENTITY = (parameters()[name] for name in ("seed", "identity"))
STARTS = ("start_identity", "start_status", "start_register")


class Rig(Bench):
    def __init__(self, dut):
        names = [field.name for field in STATUS_FIELDS]
        super().__init__(dut, inputs=(), outputs=(), seed=SEED, plain=dict.fromkeys(
            (*STARTS, "step", "register_value", *names), 0))
        self.widths = {name: len(getattr(dut, name)) for name in names}

    def change(self):
        """Other values for STATUS; gives them."""
        values = {name: self.rng.getrandbits(width) for name, width in self.widths.items()}
        for name, value in values.items():
            getattr(self.dut, name).value = value
        return values

    async def read(self, kind, octets, changing=False):
        """Octets of a reply, stepped with pauses; with ``changing``, the values of each octet."""
        dut, got, seen = self.dut, bytearray(), []
        getattr(dut, f"start_{kind}").value = 1
        await RisingEdge(dut.clk)
        getattr(dut, f"start_{kind}").value = 0
        for n in range(octets):
            while self.rng.random() < 0.5:
                if changing:
                    self.change()
                await RisingEdge(dut.clk)
            if changing:
                seen.append(self.change())
            dut.step.value = 1
            await ReadOnly()
            got.append(int(dut.octet.value))
            assert bool(dut.last.value) == (n == octets - 1)
            await RisingEdge(dut.clk)
            dut.step.value = 0
        await ReadOnly()
        assert not int(dut.octet.value) and not int(dut.last.value)
        await RisingEdge(dut.clk)
        return bytes(got), seen


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def identity_and_register(dut):
    bench = Rig(dut)
    await bench.reset()
    for _ in range(20):
        wanted = field_octets(IDENTITY_FIELDS, IDENTITY)
        assert (await bench.read("identity", len(wanted), changing=True))[0] == wanted
        value = bench.rng.choice([0, 0xFFFFFFFF, bench.rng.getrandbits(32)])
        dut.register_value.value = value
        assert (await bench.read("register", 4, changing=True))[0] == value.to_bytes(4, "little")


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def status_while_nothing_changes(dut):
    bench = Rig(dut)
    await bench.reset()
    for _ in range(20):
        wanted = field_octets(STATUS_FIELDS, bench.change())
        assert (await bench.read("status", len(wanted)))[0] == wanted


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def numbers_are_of_one_clock(dut):
    """Values change in every clock: each field is what it was as its lower octet was stepped."""
    bench = Rig(dut)
    await bench.reset()
    octets = sum(field.bits // 8 for field in STATUS_FIELDS)
    for _ in range(20):
        got, seen = await bench.read("status", octets, changing=True)
        position = 0
        for field in STATUS_FIELDS:
            size = field.bits // 8
            wanted = seen[position][field.name].to_bytes(size, "little")
            assert got[position:position + size] == wanted, field.name
            position += size


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def reset_ends_a_reply(dut):
    bench = Rig(dut)
    await bench.reset()
    for name in STARTS:
        getattr(dut, name).value = 1
        await RisingEdge(dut.clk)
        getattr(dut, name).value = 0
        await bench.reset()
        await ReadOnly()
        assert not int(dut.octet.value) and not int(dut.last.value)
        await RisingEdge(dut.clk)
