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
        testcase=None if (clocks, seed) == (4, 1) else "random_world")


@pytest.mark.parametrize("arguments, sentence", [
    ({"clock_hz": 16_200_000},
     "The clock must be a whole number of megahertz, in hertz, not 16200000"),
    ({"clock_hz": 3_000_000},
     "The sequencer needs 4 clocks a microsecond, but a clock of 3000000 Hz gives 3"),
    ({"begin_us": 1},
     "The time for a frame's first pixel must be an integer from 2 to 65535 microseconds, not 1"),
    ({"frame_us": 65_536},
     "The time for a frame must be an integer from 2 to 65535 microseconds, not 65536"),
    ({"begin_us": 30, "frame_us": 20},
     "A frame cannot be over 20 us after the integration if it may begin 30 us after it"),
    ({"warm_up_us": -1},
     "The time to wait for the laser must be an integer from 0 to 1000000 microseconds, not -1"),
])
def test_refuses_parameters(arguments, sentence):
    with pytest.raises(ValueError) as caught:
        Sequencer(**arguments)
    assert str(caught.value) == sentence
