# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from calibration.reciprocal import reciprocal_table
from hdl.common.table_memory import TableMemory
from hdl.payloads import Centre, Spot, Undistorted
from hdl.preprocessing.centre import Centring
from hdl.preprocessing.spot_queue import SpotQueue
from hdl.stereo.undistort import Undistort
from model.preprocessing.centre import centres
from model.stereo.undistort import radius_bits, undistort
from tb.hdlsim import run
from tb.native_block import NativeBlock, pack
from tb.stereo.undistort_cases import LENSES, lens_settings, random_settings


@pytest.mark.parametrize("lens,rounds,latency,seed", [
    ("barrel", 2, 21, 1), ("small", 2, 21, 2), ("large", 1, 13, 3), ("small", 3, 29, 4)])
def test_undistort(request, lens, rounds, latency, seed):
    component = Undistort(*LENSES[lens][0], rounds)
    assert (component.latency, component.period) == (latency, latency + 1)
    assert component.radius_bits == radius_bits(component.width, component.height)
    run(request, "undistort", "tb.stereo.tb_undistort", component=component,
        parameters={"lens": lens, "rounds": rounds, "latency": latency, "seed": seed})


def _load(block, settings):
    block.set(
        principal_u=settings.principal_u, principal_v=settings.principal_v,
        tangential_1=settings.tangential_1 & 0x3FFFF, tangential_2=settings.tangential_2 & 0x3FFFF,
        radial_write_enable=1)
    nothing = np.zeros((0, 2), np.uint32)
    for address, word in enumerate(settings.radial):
        block.set(radial_write_address=address, radial_write_data=word)
        block.stream(nothing, idle=1)
    block.set(radial_write_enable=0)


@pytest.mark.parametrize("size", [(352, 288), (64, 64)], ids="{0[0]}x{0[1]}".format)
@pytest.mark.parametrize("seed", [1, 2])
def test_many_spots(size, seed):
    """Every lens of the sensor's size, then settings at random, on places all over."""
    rng = np.random.default_rng(seed)
    block = NativeBlock(Undistort(*size))
    block.reset()
    lenses = [lens_settings(name)[0] for name in LENSES if LENSES[name][0] == size]
    for settings in [*lenses, *(random_settings(10 * seed + number) for number in range(8))]:
        _load(block, settings)
        count = 8000
        inside = rng.random(count) < 0.8
        u = np.where(inside, rng.integers(size[0] * 512, size=count), rng.integers(1 << 18))
        v = np.where(inside, rng.integers(size[1] * 512, size=count), rng.integers(1 << 18))
        rejected, area = rng.random(count) < 0.1, rng.integers(1, 512, count)
        saturated, border = rng.random((2, count)) < 0.5
        x, y, ok = undistort(u, v, settings, *size)
        got = block.stream(pack(Centre, rejected=rejected, area=area, saturated=saturated,
                                border=border, u=u, v=v), stall=0.1,
                           seed=seed, idle=60).fields(Undistorted)
        for name, want in [("end", 0 * u), ("rejected", rejected | ~ok), ("area", area),
                           ("saturated", saturated), ("border", border), ("u", u),
                           ("v", v), ("x", x & 0x3FFFF), ("y", y & 0x3FFFF)]:
            np.testing.assert_array_equal(got[name], want, err_msg=name)


class SpotsToPlaces(wiring.Component):
    """Queue, centre and undistortion one behind the other, their tables loaded from outside."""

    def __init__(self, width, height):
        self.undistort = Undistort(width, height)
        self.table = TableMemory()
        ports = {name: member for name, member in [
            *self.undistort.signature.members.items(), *self.table.signature.members.items()]
            if member.flow == In and name not in ("i", "a_address", "b_address")}
        super().__init__({
            "i": In(stream.Signature(Spot)), "o": Out(stream.Signature(Undistorted)), **ports})
        self.ports = ports

    def elaborate(self, platform):
        m = Module()
        m.submodules.spot_queue = spot_queue = SpotQueue()
        m.submodules.centre = centre = Centring()
        m.submodules.undistort = undistort = self.undistort
        m.submodules.table = table = self.table
        wiring.connect(m, wiring.flipped(self.i), spot_queue.i)
        wiring.connect(m, spot_queue.o, centre.i)
        wiring.connect(m, centre.o, undistort.i)
        wiring.connect(m, undistort.o, wiring.flipped(self.o))
        m.d.comb += [
            spot_queue.counts.ready.eq(1), spot_queue.area_min.eq(1), spot_queue.area_max.eq(1023),
            table.b_address.eq(centre.table_address), centre.table_data.eq(table.b_data)]
        for name in self.ports:
            block = undistort if name in undistort.signature.members else table
            m.d.comb += getattr(block, name).eq(getattr(self, name))
        return m


@pytest.mark.parametrize("seed", [1])
def test_a_row_of_spots(seed):
    """64 spots of weight 1 (the slowest) that end on one row of 352 pixels: all are out within
    1,600 clocks of the first one, and nothing is dropped."""
    rng = np.random.default_rng(seed)
    settings, size, _ = lens_settings("barrel")
    block = NativeBlock(SpotsToPlaces(*size))
    block.reset()
    _load(block, settings)
    block.set(write_enable=1)
    for address, word in enumerate(reciprocal_table()):
        block.set(write_address=address, write_data=word)
        block.stream(np.zeros((0, 3), np.uint32), idle=1)
    block.set(write_enable=0)
    spots = {"area": np.full(64, 1), "weight": np.full(64, 1),
             "sum_u": rng.permutation(size[0])[:64], "sum_v": rng.integers(size[1], size=64)}
    u, v = centres(spots, reciprocal_table())
    x, y, ok = undistort(u, v, settings, *size)
    words = np.vstack([pack(Spot, core=1, **spots), pack(Spot, end=1)])
    out = block.stream(words, pauses=np.full(65, 4), idle=2000)
    got = out.fields(Undistorted)
    assert got["end"].tolist() == [0] * 64 + [1]
    for name, want in [("u", u), ("v", v), ("x", x & 0x3FFFF), ("y", y & 0x3FFFF),
                       ("rejected", ~ok)]:
        np.testing.assert_array_equal(got[name][:64], want, err_msg=name)
    assert out.clocks[-1] - out.taken[0] <= 1600
    assert np.diff(out.clocks)[:-1].max() == 22


@pytest.mark.parametrize("width,height,rounds,error", [
    (15, 64, 2, "Frame width must be an integer from 16 to 1024, not 15"),
    (64, 1025, 2, "Frame height must be an integer from 16 to 1024, not 1025"),
    (64, "x", 2, "Frame height must be an integer from 16 to 1024, not 'x'"),
    (64, 64, 0, "Rounds must be an integer from 1 to 3, not 0"),
])
def test_wrong_parameters(width, height, rounds, error):
    with pytest.raises(ValueError) as caught:
        Undistort(width, height, rounds)
    assert str(caught.value) == error
