# amaranth: UnusedElaboratable=no
import pytest

from model.acquisition.sequencer import Registers, pair_us
from tb.acquisition.guarded import Guarded
from tb.acquisition.tb_guarded import PERIOD_US, READOUT_US
from tb.hdlsim import run


def test_guarded(request):
    run(request, "guarded", "tb.acquisition.tb_guarded", component=Guarded(4_000_000),
        parameters={"clocks": 4})


def test_video_rate(request):
    run(request, "guarded", "tb.acquisition.tb_guarded", component=Guarded(16_000_000),
        parameters={"clocks": 16}, testcase="video_rate")


@pytest.mark.parametrize("readout_us, spare_us", [(READOUT_US, 512), (352 * 288 / 8, 3956)])
def test_what_a_pair_leaves(readout_us, spare_us):
    """With the nominal exposures, at the most line blanking and with none."""
    assert PERIOD_US - pair_us(Registers(), readout_us) == spare_us
