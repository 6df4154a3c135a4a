# amaranth: UnusedElaboratable=no
import pytest

from hdl.stereo.recentre import Recentre
from model.stereo.recentre import recentre
from tb.hdlsim import run


@pytest.mark.parametrize("width,height,seed", [(352, 288, 1), (64, 64, 2), (512, 16, 3)])
def test_recentre(request, width, height, seed):
    run(request, "recentre", "tb.stereo.tb_recentre", component=Recentre(width, height),
        parameters={"width": width, "height": height, "seed": seed})


def test_model_in_pixels():
    x, y, ok = recentre([0, 351 * 512, 512], [0, 287 * 512, 0], 352, 288)
    assert (x / 512).tolist() == [-175.5, 175.5, -174.5]
    assert (y / 512).tolist() == [-143.5, 143.5, -143.5]
    assert ok.all()


@pytest.mark.parametrize("size,name,value", [
    ((15, 64), "width", 15), ((64, 513), "height", 513), (("64", 64), "width", "'64'")])
def test_refuses_sizes(size, name, value):
    with pytest.raises(
            ValueError, match=f"Frame {name} must be an integer from 16 to 512, not {value}"):
        Recentre(*size)
