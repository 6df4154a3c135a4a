"""Bench of the link behind the points: when its clock is needed, and how many points pass.

In each clock it is compared with one whose spot clock stands still while it is not needed.
"""

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.common.activity import IDLE_TIMEOUT
from hdl.payloads import Point
from tb.harness import Bench, parameters
from tb.native_block import pack

#: Streams of words that a frame needs once.
OF_A_FRAME = parameters()["of_a_frame"]
#: Records of a packet, and clocks that one takes.
RECORDS, RECORD_CLOCKS = 9, 81


def word(**fields):
    ok = not fields.get("status")
    return sum(int(part) << 32 * n for n, part in enumerate(
        pack(Point, inverse_z=int(ok), **fields)[0]))


class Rig(Bench):
    """``busy`` says in which clocks that is high, ``sent`` which words passed the limiter.

    ``late``: there was a point in a clock that was not busy.
    """

    def __init__(self, dut, points_max=0, cts=1):
        super().__init__(dut, outputs=(), plain={
            **{f"{name}_{part}": 0 for name in (*OF_A_FRAME, "reply", "texture", "texture_info")
               for part in ("valid", "payload")},
            "active": 0, "wake": 0, "cts": cts, "divisor": 2, "points_max": points_max,
            "full_records": 1, "texture_enable": 0, "bad_sync": 0, "overrun": 0})
        self.busy, self.sent, self.late = [], [], False

    async def begin(self):
        await self.reset()
        cocotb.start_soon(self._watch())

    async def _watch(self):
        while True:
            await ReadOnly()
            assert not self.dut.differs.value, "with the spot clock gated it is not the same"
            self.busy.append(bool(self.dut.busy.value))
            self.late |= bool(self.dut.i_valid.value) and not self.busy[-1]
            if self.dut.sent_valid.value:
                self.sent.append(self.dut.sent_payload.value.to_unsigned())
            await RisingEdge(self.dut.clk)

    def offer_frame(self):
        """From now on there is whatever a packet needs besides points."""
        for name in OF_A_FRAME:
            getattr(self.dut, f"{name}_valid").value = 1

    async def idle(self):
        """Wait until the clock is not needed."""
        await RisingEdge(self.dut.clk)
        while self.busy[-1]:
            await RisingEdge(self.dut.clk)
        self.busy.clear()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def busy_after_reset_and_activity(dut):
    """As long as something is active and for the timeout after it; from the same clock on."""
    bench = Rig(dut)
    await bench.begin()
    await ClockCycles(dut.clk, 2 * IDLE_TIMEOUT)
    after_reset = bench.busy.index(False)
    assert IDLE_TIMEOUT - 2 <= after_reset <= IDLE_TIMEOUT and not any(bench.busy[after_reset:])
    bench.busy.clear()
    for name, clocks in (("wake", 1), ("active", 1), ("wake", 30), ("active", 200)):
        getattr(dut, name).value = 1
        await ClockCycles(dut.clk, clocks)
        getattr(dut, name).value = 0
        await ClockCycles(dut.clk, 2 * IDLE_TIMEOUT)
        assert bench.busy[:clocks + IDLE_TIMEOUT] == [True] * (clocks + IDLE_TIMEOUT), name
        assert not any(bench.busy[clocks + IDLE_TIMEOUT:]), name
        bench.busy.clear()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def busy_while_a_point_is_packed(dut):
    bench = Rig(dut)
    await bench.begin()
    await bench.idle()
    await bench.i.send([word(beam=1)])
    await ClockCycles(dut.clk, RECORD_CLOCKS + 2 * IDLE_TIMEOUT)
    clocks = bench.busy.count(True)
    assert RECORD_CLOCKS <= clocks - IDLE_TIMEOUT <= RECORD_CLOCKS + 10, clocks
    assert bench.busy[bench.busy.index(True):][:clocks] == [True] * clocks
    assert not bench.late


@cocotb.test(timeout_time=5, timeout_unit="ms")
async def not_busy_while_a_packet_waits_for_the_line(dut):
    """Points wait behind a packet that waits; when the line takes octets again, so do they."""
    bench = Rig(dut, cts=0)
    await bench.begin()
    bench.offer_frame()
    points = 6 * RECORDS + 1
    bench.i.append([word(beam=n) for n in range(points)])
    await ClockCycles(dut.clk, 2 * points * RECORD_CLOCKS)
    await bench.idle()
    assert len(bench.sent) == points
    # One packet is in each half of the framer's memory.
    assert dut.packets.value == 2
    await ClockCycles(dut.clk, 1000)
    assert not any(bench.busy)
    dut.cts.value = 1
    for packets in range(3, 7):
        while dut.packets.value != packets:
            await RisingEdge(dut.clk)
        # Its octets have just been taken, one in nine clocks.
        assert all(bench.busy[-9 * RECORDS * 9:]), packets
    await bench.idle()
    assert dut.packets.value == 6


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def points_over_the_limit_do_not_pass(dut):
    """The register acts a clock later."""
    bench = Rig(dut, points_max=3)
    await bench.begin()
    await ClockCycles(dut.clk, 2)
    unmatched = word(status=1)
    bench.i.append([word(beam=1), unmatched, word(beam=2), word(beam=3), word(beam=4), unmatched])
    await ClockCycles(dut.clk, 40)
    assert bench.sent == [
        word(beam=1), unmatched, word(beam=2), word(beam=3), unmatched]


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def points_pass_once(dut):
    """Also those that wait because the buffer is full."""
    bench = Rig(dut, cts=0)
    await bench.begin()
    bench.offer_frame()
    words = [word(beam=n % 128, u=n) for n in range(400)]
    bench.i.append(words)
    await ClockCycles(dut.clk, 6000)
    assert 170 < len(bench.i.taken) < 400
    assert bench.sent == words[:len(bench.i.taken)]
