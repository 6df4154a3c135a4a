# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.exposure import Exposure
from model.acquisition.exposure import exposure
from tb.hdlsim import run


@pytest.mark.parametrize("clocks", [1, 4, 16])
@pytest.mark.parametrize("seed", [1, 2])
def test_exposure(request, clocks, seed):
    run(request, "exposure", "tb.acquisition.tb_exposure",
        component=Exposure(clocks * 1_000_000), parameters={"seed": seed, "clocks": clocks},
        testcase=None if seed == 1 else "random_times")


def test_model_of_a_nominal_pattern():
    """100 us of reset and 500 us of light at 16 MHz."""
    assert exposure(16_000_000, 100, 500, laser=True) == {
        "sensor_reset": (1, 1601), "sensor_integrate": (1601, 9601), "sensor_read": (9601, 9617),
        "laser_request": (1601, 9601), "integrated": 9601, "done": 9617}


@pytest.mark.parametrize("clock_hz", [0, 500_000, 16_500_000, 1e6, "16"])
def test_refuses_clocks(clock_hz):
    with pytest.raises(ValueError) as caught:
        Exposure(clock_hz)
    assert str(caught.value) == (
        f"The clock must be a whole number of megahertz, in hertz, not {clock_hz!r}")
