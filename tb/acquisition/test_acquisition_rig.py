# amaranth: UnusedElaboratable=no
import pytest

from tb.acquisition.acquisition_rig import AcquisitionRig
from tb.hdlsim import run


@pytest.mark.parametrize("blanking", [0, 48])
def test_pairs(request, blanking):
    """The guard's window is short, so that few dark frames come before the first pair."""
    run(request, "acquisition_rig", "tb.acquisition.tb_acquisition_rig", component=AcquisitionRig(
            64, 64, {"window_us": 2000, "repetition_us": 1000, "pulse_us": 800}),
        parameters={"rig": "small", "blanking": blanking, "period_us": 13_000}, testcase="pairs")


def test_addressed_pairs(request):
    """The same of an imager with addressed pixels and a converter."""
    latency, interval = 5, 3
    run(request, "acquisition_rig", "tb.acquisition.tb_acquisition_rig", component=AcquisitionRig(
            64, 64, {"window_us": 2000, "repetition_us": 1000, "pulse_us": 800},
            (latency, interval)),
        parameters={"rig": "small", "period_us": 13_000, "latency": latency,
                    "interval": interval}, testcase="pairs")


def test_imager_stops(request):
    run(request, "acquisition_rig", "tb.acquisition.tb_acquisition_rig", component=AcquisitionRig(
            64, 64, {"window_us": 2000, "repetition_us": 1000, "pulse_us": 800}),
        parameters={"rig": "small", "blanking": 5, "period_us": 13_000},
        testcase="imager_stops_and_comes_back")
