# amaranth: UnusedElaboratable=no
import pytest

from tb.hdlsim import run
from tb.link.link_rig import LinkRig


@pytest.mark.parametrize("seed,divisor", [(1, 2), (2, 1)])
def test_transmitter(request, seed, divisor):
    run(request, "link_rig", "tb.link.tb_transmitter", component=LinkRig(90, 24),
        parameters={"seed": seed, "width": 90, "height": 24, "divisor": divisor})
