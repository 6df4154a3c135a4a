import cocotb
from cocotb.triggers import RisingEdge

from hdl.common.stage import Stage
from tb.harness import Bench, parameters


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.5], stall=[0.0, 0.5])
async def words_pass_in_order(dut, gap, stall):
    bench = Bench(dut, gap=gap, stall=stall, seed=parameters()["seed"])
    await bench.reset()
    words = [0, (1 << 82) - 1] + [bench.rng.getrandbits(82) for _ in range(300)]
    bench.i.append(words)
    while len(bench.o.words) < len(words):
        await RisingEdge(dut.clk)
    clocks, got = zip(*bench.o.words, strict=True)
    assert list(got) == words
    if not gap and not stall:
        assert bench.i.taken[-1] - bench.i.taken[0] == len(words) - 1
        assert list(clocks) == [clock + Stage.latency for clock in bench.i.taken]
