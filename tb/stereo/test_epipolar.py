# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Fragment
from amaranth.sim import Simulator

from hdl.payloads import Match, Undistorted
from hdl.stereo.epipolar import Epipolar
from model.stereo.epipolar import match, pack_line, pack_window
from tb.hdlsim import run
from tb.native_block import NativeBlock, pack, unpack

TWIN = ["hdl/stereo/epipolar.vhd"]


@pytest.mark.parametrize("beams,lanes,latency", [
    (49, 2, 28), (5, 1, 8), (13, 8, 5), (10, 3, 7), (9, 9, 4)])
def test_epipolar(request, beams, lanes, latency):
    component = Epipolar(beams, lanes)
    assert component.latency == latency
    run(request, "epipolar", "tb.stereo.tb_epipolar", component=component,
        parameters={"beams": beams, "lanes": lanes, "latency": latency, "seed": 1})


@pytest.mark.parametrize("beams,lanes,latency,standard", [
    (49, 2, 28, "93"), (5, 1, 8, "08"), (13, 8, 5, "93"), (10, 3, 7, "08"), (9, 9, 4, "08")])
def test_epipolar_twin(request, beams, lanes, latency, standard):
    run(request, "epipolar", "tb.stereo.tb_epipolar", vhdl=TWIN, standard=standard,
        generics={"beams": beams, "lanes": lanes},
        parameters={"beams": beams, "lanes": lanes, "latency": latency, "seed": 2})


@pytest.mark.parametrize("name", ["lines", "windows"])
@pytest.mark.parametrize("lanes,copy,bits", [
    (5, 0, 1), (5, 2, 1 << 35), (5, 4, 1 << 17), (5, 0, (1 << 36) - 1), (8, 0, 5), (8, 6, 1 << 9)])
def test_a_fault_in_any_copy_is_read_back(name, lanes, copy, bits):
    """Five lanes have three copies of each word, eight have four; the host reads one."""
    epipolar = Epipolar(9, lanes)
    fragment = Fragment.get(epipolar, None)
    rows = next(inner for inner, inner_name, _ in fragment.subfragments
                if inner_name == f"{name}_{copy}")._data
    words = 0x123456789, 0xFEDCBA987

    async def bench(context):
        read = []
        for fault in (0, bits):
            context.set(epipolar.write_address, 7)
            context.set(epipolar.write_line, words[0])
            context.set(epipolar.write_window, words[1])
            context.set(epipolar.write_enable, 1)
            await context.tick()
            context.set(epipolar.write_enable, 0)
            context.set(rows[7], context.get(rows[7]) ^ fault)
            context.set(epipolar.read_enable, 1)
            await context.tick()
            context.set(epipolar.read_enable, 0)
            read.append((context.get(epipolar.read_line), context.get(epipolar.read_window)))
        assert read[0] == words
        assert read[1] != words

    simulator = Simulator(fragment)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize("beams,lanes,error", [
    (0, 1, "Beams must be an integer from 1 to 512, not 0"),
    (513, 1, "Beams must be an integer from 1 to 512, not 513"),
    ("49", 1, "Beams must be an integer from 1 to 512, not '49'"),
    (49, 0, "Lanes must be an integer from 1 to 49, not 0"),
    (49, 50, "Lanes must be an integer from 1 to 49, not 50"),
])
def test_wrong_parameters(beams, lanes, error):
    with pytest.raises(ValueError) as caught:
        Epipolar(beams, lanes)
    assert str(caught.value) == error


@pytest.mark.parametrize("beams,lanes", [(49, 2), (49, 8)])
@pytest.mark.parametrize("gap,stall", [(0.0, 0.0), (0.9, 0.1), (0.1, 0.9)])
@pytest.mark.parametrize("seed", [1])
def test_heavy_traffic(beams, lanes, gap, stall, seed):
    """20,000 spots, most of them about a tolerance away from a line."""
    rng = np.random.default_rng([seed, lanes])
    slope = rng.integers(-8000, 8000, beams)
    offset = (np.arange(beams) - beams // 2) * 1500 + rng.integers(-300, 300, beams)
    tolerance = rng.integers(0, 64, beams)
    limits = np.sort(rng.integers(-4096, 4096, (2, beams)), axis=0)
    line, window = pack_line(slope, offset), pack_window(tolerance, *limits)

    block = NativeBlock(Epipolar(beams, lanes))
    block.reset()
    for beam in range(beams):
        block.set(write_enable=1, write_address=beam, write_line=int(line[beam]),
                  write_window=int(window[beam]))
        block.stream(np.empty((0, 3)), idle=1)
    block.set(write_enable=0)

    count = 20_000
    which = rng.integers(0, beams, count)
    x = rng.integers(-(1 << 17), 1 << 17, count)
    y = ((slope[which] * x + (1 << 16)) >> 17) + offset[which]
    y += rng.choice([-1, 1], count) * ((tolerance[which] << 4) + rng.integers(-40, 3, count))
    fields = {
        "end": np.zeros(count, int), "rejected": (rng.random(count) < 0.02).astype(int),
        "area": rng.integers(1, 512, count), "saturated": rng.random(count) < 0.5,
        "border": rng.random(count) < 0.5, "u": rng.integers(0, 1 << 18, count),
        "v": rng.integers(0, 1 << 18, count), "x": x, "y": np.clip(y, -(1 << 17), (1 << 17) - 1)}
    beats = block.stream(pack(Undistorted, **fields), gap=gap, stall=stall, seed=seed, idle=1000)
    got = unpack(Match, beats.words)
    status, beam = match(x, fields["y"], fields["rejected"], line, window)
    assert len(beats.words) == count
    assert len(np.unique(status)) == 4
    wanted = {**fields, "status": status, "beam": beam, "x": x & 0x3FFFF}
    for name in ("end", "status", "beam", "area", "saturated", "border", "u", "v", "x"):
        wrong = np.flatnonzero(got[name] != wanted[name])
        assert not len(wrong), f"spot {wrong[0]}: {name} is {got[name][wrong[0]]}"
    if not gap and not stall:
        assert set(np.diff(beats.clocks)) == {-(-beams // lanes)}
