# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.frame_gate import FrameGate
from model.acquisition.frame_gate import gate
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1, 2])
def test_frame_gate(request, seed):
    run(request, "frame_gate", "tb.acquisition.tb_frame_gate", component=FrameGate(),
        parameters={"seed": seed})


def test_model_counts_all_frames():
    assert gate([1, 0, 0, 1, 1]) == [(0, 0), None, None, (3, 2), (4, 0)]
    assert gate([0] * 65536 + [1])[-1] == (0, 255)
