# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from calibration.reciprocal import reciprocal_table
from hdl.payloads import Centre, QueuedSpot
from hdl.preprocessing.centre import Centring
from model.preprocessing.centre import centres
from tb.hdlsim import run
from tb.native_block import NativeBlock, pack


class CentringWithTable(wiring.Component):
    """The block with its table in a memory."""

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(QueuedSpot)), "o": Out(stream.Signature(Centre))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.centring = centring = Centring()
        m.submodules.table = table = Memory(shape=36, depth=256, init=reciprocal_table())
        read = table.read_port()
        wiring.connect(m, wiring.flipped(self.i), centring.i)
        wiring.connect(m, centring.o, wiring.flipped(self.o))
        m.d.comb += [
            read.addr.eq(centring.table_address), read.en.eq(1),
            centring.table_data.eq(read.data)]
        return m


@pytest.mark.parametrize("seed", [1, 2])
def test_centre(request, seed):
    run(request, "centre", "tb.preprocessing.tb_centre", component=Centring(),
        parameters={"seed": seed})


@pytest.mark.parametrize("stall,seed", [(0.0, 1), (0.95, 2)])
def test_every_weight(stall, seed):
    """All weights, with sums from 0 to the largest, end markers in between."""
    rng = np.random.default_rng(seed)
    weight = np.concatenate([np.arange(1, 65281), rng.integers(1, 256, 20_000),
                             rng.integers(65281, 261889, 40_000), [261888]])
    count = len(weight)
    spots = {
        "end": rng.random(count) < 0.02, "rejected": rng.random(count) < 0.3,
        "area": rng.integers(1, 512, count), "saturated": rng.random(count) < 0.5,
        "border": rng.random(count) < 0.5, "weight": weight,
        "sum_u": np.floor(weight * 511 * rng.random(count)).astype(int),
        "sum_v": weight * 511 - rng.integers(0, 20, count).clip(max=weight)}
    u, v = centres(spots, reciprocal_table())
    for name, values in spots.items():
        if name != "end":
            values[spots["end"]] = 0
    block = NativeBlock(CentringWithTable())
    block.reset()
    got = block.stream(pack(QueuedSpot, **spots), stall=stall, seed=seed, idle=1000).fields(Centre)
    for name, want in [("end", spots["end"]), ("rejected", spots["rejected"]),
                       ("area", spots["area"]), ("saturated", spots["saturated"]),
                       ("border", spots["border"]), ("u", u), ("v", v)]:
        np.testing.assert_array_equal(got[name], np.where(spots["end"] & (name != "end"), 0, want))
