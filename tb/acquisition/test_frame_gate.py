# amaranth: UnusedElaboratable=no
import pytest

from hdl.acquisition.frame_gate import FrameGate
from model.acquisition.frame_gate import LEFT_OUT, gate
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1, 2])
def test_frame_gate(request, seed):
    run(request, "frame_gate", "tb.acquisition.tb_frame_gate", component=FrameGate(),
        parameters={"seed": seed})


def test_model_counts_all_frames():
    assert gate([1, 0, 0, 1, 1]) == [(0, 0), None, None, (3, 2), (4, 0)]
    assert gate([0] * 65536 + [1])[-1] == (0, 255)


def test_model_measures_one_pattern_in_so_many():
    """Texture is not counted, a skipped frame is made up for, and a new share acts at once."""
    assert gate([1] * 7, every=[3] * 7) == [
        (0, 0), LEFT_OUT, LEFT_OUT, (3, 0), LEFT_OUT, LEFT_OUT, (6, 0)]
    assert gate([1] * 6, patterns=[1, 0, 1, 0, 1, 0], every=[2] * 6) == [
        (0, 0), (1, 0), LEFT_OUT, (3, 0), (4, 0), (5, 0)]
    assert gate([0, 1, 0, 0, 1], every=[2] * 5) == [None, (1, 1), LEFT_OUT, None, (4, 1)]
    assert gate([1] * 4, every=[9, 9, 9, 1]) == [(0, 0), LEFT_OUT, LEFT_OUT, (3, 0)]
