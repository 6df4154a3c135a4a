# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.point_limiter import PointLimiter
from tb import hdlsim


@pytest.mark.parametrize("seed", [1, 2])
def test_point_limiter(request, seed):
    hdlsim.run(request, "point_limiter", "tb.link.tb_point_limiter", component=PointLimiter(),
               parameters={"seed": seed})


def test_frames_must_be_a_positive_integer():
    with pytest.raises(ValueError, match="Frames must be a positive integer, not 0"):
        PointLimiter(0)
