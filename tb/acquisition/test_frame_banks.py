# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.frame_banks import FrameBanks
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("banks", [2, 3])
def test_frame_banks(request, banks, seed):
    run(request, "frame_banks", "tb.acquisition.tb_frame_banks", component=FrameBanks(banks),
        parameters={"seed": seed, "banks": banks})


@pytest.mark.parametrize("banks", [1, 4, 2.5, True, "3"])
def test_refuses_other_numbers(banks):
    with pytest.raises(ValueError) as caught:
        FrameBanks(banks)
    assert str(caught.value) == f"The number of banks must be 2 or 3, not {banks!r}"
