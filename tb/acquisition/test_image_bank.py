# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.image_bank import ImageBank
from tb.hdlsim import run


@pytest.mark.parametrize("width,height,seed", [(16, 12, 1), (190, 91, 2)])
def test_image_bank(request, width, height, seed):
    run(request, "image_bank", "tb.acquisition.tb_image_bank",
        component=ImageBank(width, height),
        parameters={"width": width, "height": height, "seed": seed})


@pytest.mark.parametrize("size,name,value", [
    ((1, 64), "width", 1), ((64, 513), "height", 513), (("64", 64), "width", "'64'")])
def test_refuses_sizes(size, name, value):
    with pytest.raises(
            ValueError, match=f"Frame {name} must be an integer from 2 to 512, not {value}"):
        ImageBank(*size)
