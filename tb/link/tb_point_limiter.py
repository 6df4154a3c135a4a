import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from hdl.payloads import Counts, Point
from model.link.point_limiter import limit_points
from model.link.points import POINT
from tb.harness import Bench, parameters
from tb.native_block import pack


def words(shape, **fields):
    return [sum(int(part) << 32 * n for n, part in enumerate(row)) for row in pack(shape, **fields)]


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.6], limit=[0, 1, 7, 255])
async def so_many_ok_points_a_frame(dut, gap, stall, limit):
    rng = np.random.default_rng([parameters()["seed"], limit])
    bench = Bench(dut, inputs=("i", "counts_i"), outputs=("o", "counts_o"), gap=gap, stall=stall,
                  plain={"limit": limit})
    await bench.reset()
    wanted, wanted_counts, before = [], [], 0
    for length in (0, 1, 7, 8, 300, 300, 299, 520, 520, *rng.integers(0, 40, 12)):
        points = np.zeros(length, POINT)
        points["status"] = rng.choice(4, length, p=[0.97, 0.01, 0.01, 0.01])
        points["u"] = rng.integers(0, 1 << 18, length)
        dropped = int(rng.choice([0, 3, 65_533]))
        kept, over = limit_points(points, limit, before)
        before = np.count_nonzero(points["status"] == 0)
        end = words(Point, end=[1])
        bench.i.append(words(Point, status=points["status"], u=points["u"]) * bool(length) + end)
        wanted += words(Point, status=kept["status"], u=kept["u"]) * bool(len(kept)) + end
        counts = {"spots": [length], "rejected": [2], "broken": [length & 1]}
        bench.counts_i.append(words(Counts, dropped=[dropped], **counts))
        wanted_counts += words(Counts, dropped=[min(65_535, dropped + over)], **counts)
    assert await bench.o.receive(len(wanted)) == wanted
    assert await bench.counts_o.receive(len(wanted_counts)) == wanted_counts
    await ClockCycles(dut.clk, 10)
    assert not bench.o.words and not bench.counts_o.words


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def an_end_waits_for_its_counts(dut):
    """... and for room for them; points do not."""
    bench = Bench(dut, inputs=("i", "counts_i"), outputs=("o", "counts_o"), plain={"limit": 0})
    await bench.reset()
    bench.counts_o.stall = 1.0
    point, end = words(Point, u=[5])[0], words(Point, end=[1])[0]
    bench.i.append([point, end] * 6)
    await ClockCycles(dut.clk, 20)
    assert [word for _, word in bench.o.words] == [point]
    bench.counts_i.append(words(Counts, spots=range(6)))
    await ClockCycles(dut.clk, 40)
    assert [word for _, word in bench.o.words] == [point, end] * 4 + [point]
    bench.counts_o.stall = 0.0
    assert await bench.counts_o.receive(6) == words(Counts, spots=range(6))
