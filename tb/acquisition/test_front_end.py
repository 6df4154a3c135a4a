# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.front_end import FrontEnd
from hdl.config import Config
from tb.hdlsim import run

SIZE = {"width": 24, "height": 22}


@pytest.mark.parametrize("converter", [None, 4], ids=["frames", "addressed"])
def test_front_end(request, converter):
    run(request, "front_end", "tb.acquisition.tb_front_end",
        component=FrontEnd(Config(**SIZE, converter_latency=converter)),
        parameters={**SIZE, "seed": 1, "addressed": converter is not None})
