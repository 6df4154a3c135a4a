# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from hdl.payloads import Centre, Undistorted
from hdl.stereo.undistort import Undistort
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
        rejected, area = rng.random(count) < 0.1, rng.integers(1, 256, count)
        x, y, ok = undistort(u, v, settings, *size)
        got = block.stream(pack(Centre, rejected=rejected, area=area, u=u, v=v), stall=0.1,
                           seed=seed, idle=60).fields(Undistorted)
        for name, want in [("end", 0 * u), ("rejected", rejected | ~ok), ("area", area), ("u", u),
                           ("v", v), ("x", x & 0x3FFFF), ("y", y & 0x3FFFF)]:
            np.testing.assert_array_equal(got[name], want, err_msg=name)


@pytest.mark.parametrize("width,height,rounds,error", [
    (15, 64, 2, "Frame width must be an integer from 16 to 512, not 15"),
    (64, 513, 2, "Frame height must be an integer from 16 to 512, not 513"),
    (64, "x", 2, "Frame height must be an integer from 16 to 512, not 'x'"),
    (64, 64, 0, "Rounds must be an integer from 1 to 3, not 0"),
])
def test_wrong_parameters(width, height, rounds, error):
    with pytest.raises(ValueError) as caught:
        Undistort(width, height, rounds)
    assert str(caught.value) == error
