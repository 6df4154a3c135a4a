# amaranth: UnusedElaboratable=no
import pytest

from hdl.common.activity import IDLE_TIMEOUT, Activity
from tb.hdlsim import run


@pytest.mark.parametrize("timeout,busy_after_reset", [
    (IDLE_TIMEOUT, False), (IDLE_TIMEOUT, True), (1, True), (5, False)])
def test_activity(request, timeout, busy_after_reset):
    run(request, "activity", "tb.common.tb_activity", component=Activity(timeout, busy_after_reset),
        parameters={"timeout": timeout, "busy_after_reset": busy_after_reset})


@pytest.mark.parametrize("timeout", [0, -1, 1.5, "127"])
def test_wrong_timeout(timeout):
    with pytest.raises(ValueError) as caught:
        Activity(timeout)
    assert str(caught.value) == f"Timeout must be a positive integer, not {timeout!r}"
