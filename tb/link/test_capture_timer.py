# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.capture_timer import CaptureTimer
from tb.hdlsim import run


@pytest.mark.parametrize("clocks_per_ms", [2, 3, 64, 1000])
def test_capture_timer(request, clocks_per_ms):
    run(request, "capture_timer", "tb.link.tb_capture_timer",
        component=CaptureTimer(1000 * clocks_per_ms),
        parameters={"clocks_per_ms": clocks_per_ms, "seed": 1})


@pytest.mark.parametrize("clock_hz", [0, 1000, 16_000_500, 1e6])
def test_wrong_clock(clock_hz):
    with pytest.raises(ValueError) as caught:
        CaptureTimer(clock_hz)
    assert str(caught.value) == (
        f"System clock must be a multiple of 1 kHz, 2 kHz or more, not {clock_hz!r}")
