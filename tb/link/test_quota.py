import pytest

from hdl.link.quota import Quota
from tb import hdlsim


@pytest.mark.parametrize("seed", [1, 2])
def test_quota(request, seed):
    hdlsim.run(request, "quota", "tb.link.tb_quota", component=Quota(), parameters={"seed": seed})


def test_frames_must_be_a_positive_integer():
    with pytest.raises(ValueError, match="Frames must be a positive integer, not 0"):
        Quota(0)
