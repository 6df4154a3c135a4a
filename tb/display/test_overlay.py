# amaranth: UnusedElaboratable=no
import pytest

from hdl.display.overlay import Overlay
from model.display.vga import reach_of
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("size, reach", [((33, 20), 3), ((64, 14), 5), ((130, 9), 1),
                                         ((20, 40), 15)])
def test_overlay(request, size, reach, seed):
    run(request, "overlay", "tb.display.tb_overlay", component=Overlay(*size, reach),
        parameters={"width": size[0], "height": size[1], "reach": reach, "seed": seed})


@pytest.mark.parametrize("width", [2, 64, 128, 129, 352, 512])
def test_reach(width):
    assert Overlay(width, 8).reach == reach_of(width)


@pytest.mark.parametrize("arguments, error", [
    ((1, 5), "Frame width must be an integer from 2 to 512, not 1"),
    ((8, 8, 0), "The reach of a diamond must be an integer from 1 to 15, not 0"),
    ((8, 8, 16), "The reach of a diamond must be an integer from 1 to 15, not 16"),
])
def test_refuses_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        Overlay(*arguments)
    assert str(caught.value) == error
