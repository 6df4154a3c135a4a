import pytest

from hdl.link.packet import Packet
from tb.hdlsim import run


def test_packet(request):
    run(request, "packet", "tb.link.tb_packet", component=Packet(), parameters={"seed": 1})


@pytest.mark.parametrize("seed", [2, 3])
def test_random_frames(request, seed):
    run(request, "packet", "tb.link.tb_packet", component=Packet(), parameters={"seed": seed},
        testcase="frames_match_model")
