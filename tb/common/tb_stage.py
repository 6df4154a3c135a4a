import cocotb

from tb.harness import Bench, parameters


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.5], stall=[0.0, 0.5])
async def words_pass_in_order(dut, gap, stall):
    bench = Bench(dut, gap=gap, stall=stall, seed=parameters()["seed"])
    await bench.reset()
    words = [0, (1 << 82) - 1] + [bench.rng.getrandbits(82) for _ in range(300)]
    bench.i.append(words)
    assert await bench.o.receive(len(words)) == words
    if not gap and not stall:
        assert bench.i.taken[-1] - bench.i.taken[0] == len(words) - 1
