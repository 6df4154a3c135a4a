# amaranth: UnusedElaboratable=no
import pytest

from hdl.stereo.epipolar import Epipolar
from tb.hdlsim import run

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


@pytest.mark.parametrize("beams,lanes,error", [
    (0, 1, "Beams must be an integer from 1 to 128, not 0"),
    (129, 1, "Beams must be an integer from 1 to 128, not 129"),
    ("49", 1, "Beams must be an integer from 1 to 128, not '49'"),
    (49, 0, "Lanes must be an integer from 1 to 49, not 0"),
    (49, 50, "Lanes must be an integer from 1 to 49, not 50"),
])
def test_wrong_parameters(beams, lanes, error):
    with pytest.raises(ValueError) as caught:
        Epipolar(beams, lanes)
    assert str(caught.value) == error
