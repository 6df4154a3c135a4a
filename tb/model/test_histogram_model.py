import numpy as np
import pytest

from model.preprocessing.histogram import BIN_LIMIT, counted_rows, histogram


@pytest.mark.parametrize("shape", [(288, 352), (64, 64), (19, 64), (512, 512), (200, 16)])
@pytest.mark.parametrize("seed", range(3))
def test_counts_as_numpy_does(shape, seed):
    frame = np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)
    first, stop = counted_rows(shape[1], shape[0])
    counts = histogram(frame)
    assert np.array_equal(counts, np.histogram(frame[first:stop], np.arange(257))[0])
    assert counts.sum() == (stop - first) * shape[1] <= BIN_LIMIT
    for row in (first - 1, stop):  # the rows beside it do not count
        frame[row] += 1
    assert np.array_equal(counts, histogram(frame))


@pytest.mark.parametrize("width,height,rows", [
    (352, 288, (1, 285)), (64, 64, (5, 51)), (512, 512, (128, 383))])
def test_rows_of_some_sensors(width, height, rows):
    assert counted_rows(width, height) == rows


def test_refuses_small_frames():
    with pytest.raises(ValueError, match="64 x 18 pixels is too small .* more than 18 rows"):
        counted_rows(64, 18)
