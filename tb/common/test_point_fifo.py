import pytest

from hdl.common.point_fifo import PointFIFO
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
def test_point_fifo(request, seed):
    component = PointFIFO()
    assert component.depth == 257
    run(request, "point_fifo", "tb.common.tb_point_fifo", component=component,
        parameters={"seed": seed, "depth": component.depth})
