# amaranth: UnusedElaboratable=no
import pytest

from hdl.preprocessing.remap import Remap
from tb.hdlsim import run


@pytest.mark.parametrize("width,height,seed", [(16, 12, 1), (17, 9, 2)])
def test_remap(request, width, height, seed):
    run(request, "remap", "tb.preprocessing.tb_remap", component=Remap(width, height),
        parameters={"width": width, "height": height, "seed": seed})


@pytest.mark.parametrize("size,name,value", [
    ((1, 64), "width", 1), ((64, 513), "height", 513), (("64", 64), "width", "'64'")])
def test_refuses_sizes(size, name, value):
    with pytest.raises(
            ValueError, match=f"Frame {name} must be an integer from 2 to 512, not {value}"):
        Remap(*size)
