import pytest

from hdl.stereo.depth import Depth
from tb.hdlsim import run


@pytest.mark.parametrize("twin", ["amaranth", "vhdl-93", "vhdl-08"])
@pytest.mark.parametrize("seed", [1])
def test_depth(request, twin, seed):
    parameters = {"seed": seed, "latency": Depth.latency}
    if twin == "amaranth":
        run(request, "depth", "tb.stereo.tb_depth", component=Depth(), parameters=parameters)
    else:
        run(request, "depth", "tb.stereo.tb_depth", vhdl=["hdl/stereo/depth.vhd"],
            standard=twin[-2:], parameters=parameters)
