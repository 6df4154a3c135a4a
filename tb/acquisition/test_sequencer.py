# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.sequencer import Sequencer
from tb.hdlsim import run

#: Time limits of the benches, in microseconds.
LIMITS = {"begin_us": 20, "frame_us": 60, "warm_up_us": 500}


@pytest.mark.parametrize("clocks, seed", [(4, 1), (4, 2), (4, 3), (5, 1), (16, 1)])
def test_sequencer(request, clocks, seed):
    run(request, "sequencer", "tb.acquisition.tb_sequencer",
        component=Sequencer(clocks * 1_000_000, **LIMITS),
        parameters={"seed": seed, "clocks": clocks, **LIMITS},
        testcase=None if seed == 1 else "random_world")
