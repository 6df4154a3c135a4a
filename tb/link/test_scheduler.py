# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.scheduler import Scheduler
from tb.hdlsim import run


@pytest.mark.parametrize("sources", [1, 3, 8])
@pytest.mark.parametrize("seed", [1])
def test_scheduler(request, seed, sources):
    run(request, "scheduler", "tb.link.tb_scheduler", component=Scheduler(sources),
        parameters={"seed": seed, "sources": sources})


@pytest.mark.parametrize("sources", [0, 9, "foo", 2.0])
def test_bad_sources(sources):
    sentence = f"Sources must be an integer from 1 to 8, not {sources!r}"
    with pytest.raises(ValueError, match=sentence):
        Scheduler(sources)
