import pytest

from hdl.common.stage import Stage
from tb import hdlsim


@pytest.mark.parametrize("seed", [1, 2])
def test_stage(request, seed):
    hdlsim.run(request, "stage", "tb.common.tb_stage", component=Stage(),
               parameters={"seed": seed})
