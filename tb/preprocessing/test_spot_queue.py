# amaranth: UnusedElaboratable=no
from types import SimpleNamespace

import numpy as np
import pytest

from hdl.payloads import QueuedSpot, Spot
from hdl.preprocessing.spot_queue import SpotQueue
from model.preprocessing.labelling import SPOT_DTYPE
from model.preprocessing.spot_queue import filter_spots
from tb.hdlsim import run
from tb.native_block import NativeBlock, pack


@pytest.mark.parametrize("depth,seed", [(64, 1), (12, 2)])
def test_spot_queue(request, depth, seed):
    run(request, "spot_queue", "tb.preprocessing.tb_spot_queue", component=SpotQueue(depth),
        parameters={"seed": seed, "depth": depth})


@pytest.mark.parametrize("seed", range(3))
def test_counters_saturate(seed):
    """More components in one frame than a counter holds, then a small frame."""
    rng = np.random.default_rng(seed)
    block = NativeBlock(SpotQueue(64))
    block.reset()
    block.set(area_min=2, area_max=9, report_rejected=0, counts_ready=0)
    for count in (70_000, 65_535, 65_536, 3):
        area = np.full(count, 5 if seed == 1 else 1)
        if seed == 2:
            area = rng.integers(1, 12, count)
        rejected = np.count_nonzero((area < 2) | (area > 9))
        words = pack(Spot, core=1, area=area, weight=area)
        out = block.stream(np.vstack([words, pack(Spot, end=1)]), idle=200)
        spots = out.fields(QueuedSpot)
        assert spots["end"].tolist() == [0] * (len(spots) - 1) + [1]
        counts = block.get("counts_payload")
        dropped = count - rejected - (len(spots) - 1)
        assert counts == (min(count, 65535) | min(rejected, 65535) << 16
                          | min(dropped, 65535) << 32)
        block.set(counts_ready=1)
        block.stream(words[:0], idle=1)
        block.set(counts_ready=0)


def test_model_screens():
    """The model against its rules, spot by spot."""
    spots = np.zeros(6, SPOT_DTYPE)
    spots["area"] = [2, 3, 9, 10, 1024, 5]
    spots["core"] = [1, 1, 1, 1, 1, 0]
    spots["weight"] = [7, 8, 9, 10, 0, 11]
    settings = SimpleNamespace(area_min=3, area_max=9, report_rejected=False)
    queued, counts = filter_spots(spots, settings)
    assert queued["weight"].tolist() == [8, 9]
    assert not queued["rejected"].any()
    assert counts == {"spots": 6, "rejected": 4, "dropped": 0}
    settings.report_rejected = True
    queued, counts = filter_spots(spots, settings)
    assert queued["weight"].tolist() == [7, 8, 9, 10, 11]
    assert queued["rejected"].tolist() == [True, False, False, True, True]
    assert counts == {"spots": 6, "rejected": 1, "dropped": 0}


@pytest.mark.parametrize("depth", [7, 513, "64"])
def test_wrong_parameters(depth):
    with pytest.raises(ValueError) as caught:
        SpotQueue(depth)
    assert str(caught.value) == f"Depth must be an integer from 8 to 512, not {depth!r}"
