# amaranth: UnusedElaboratable=no
import pytest

from hdl.preprocessing.histogram import Histogram
from model.preprocessing.histogram import counted_rows
from tb.hdlsim import run


@pytest.mark.parametrize("width,height,seed", [(64, 20, 1), (352, 6, 2), (37, 33, 3)])
def test_histogram(request, width, height, seed):
    run(request, "histogram", "tb.preprocessing.tb_histogram", component=Histogram(width, height),
        parameters={"width": width, "height": height, "seed": seed})


@pytest.mark.parametrize("width,height", [
    (352, 288), (64, 64), (64, 19), (512, 512), (512, 8), (300, 512), (511, 400), (363, 363)])
def test_rows_are_the_models_and_fit(width, height):
    first, stop = Histogram(width, height).rows
    assert (first, stop) == counted_rows(width, height)
    assert 0 < first < stop < height
    assert (stop - first) * width < 2**17, "a bin could overflow"
    assert first * width >= 256, "no time to clear the bins"
    assert (height - stop) * width >= 800, "no time to find the level"


@pytest.mark.parametrize("width,height,rows", [
    (352, 288, (0, 288)), (64, 4, (0, 4)), (512, 512, (128, 383)), (512, 256, (0, 255))])
def test_rows_of_whole_frames(width, height, rows):
    assert Histogram(width, height, whole=True).rows == rows
    assert counted_rows(width, height, whole=True) == rows


@pytest.mark.parametrize("size,error", [
    ((0, 64), "Frame width must be an integer from 1 to 512, not 0"),
    ((64, 513), "Frame height must be an integer from 1 to 512, not 513"),
    (("64", 64), "Frame width must be an integer from 1 to 512, not '64'"),
    ((64, 18), "A frame of 64 x 18 pixels is too small to learn a threshold from: "
               "it must have more than 18 rows"),
])
def test_refuses_sizes(size, error):
    with pytest.raises(ValueError) as caught:
        Histogram(*size)
    assert str(caught.value) == error
