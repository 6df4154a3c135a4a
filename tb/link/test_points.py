# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.points import Points
from tb.hdlsim import run


@pytest.mark.parametrize("full_records", [0, 1])
@pytest.mark.parametrize("seed", [1, 2])
def test_points(request, seed, full_records):
    run(request, "points", "tb.link.tb_points", component=Points(),
        parameters={"seed": seed, "full_records": full_records})
