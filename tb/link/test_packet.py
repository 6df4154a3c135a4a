import pytest

from hdl.link.packet import Packet
from tb.hdlsim import run


def test_packet(request):
    run(request, "packet", "tb.link.tb_packet", component=Packet(), parameters={"seed": 1})


@pytest.mark.parametrize("seed,gap,stall", [(2, 0.0, 0.8), (3, 0.9, 0.3)])
def test_random_frames(request, seed, gap, stall):
    run(request, "packet", "tb.link.tb_packet", component=Packet(),
        parameters={"seed": seed, "gap": gap, "stall": stall}, testcase="random_frames")
