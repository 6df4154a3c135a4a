# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from hdl.acquisition.addressed_camera import AddressedCamera
from model.acquisition.addressed_camera import addressed_camera, conversions
from tb.hdlsim import run


@pytest.mark.parametrize("latency, interval, seed", [
    (1, 2, 1), (4, 2, 1), (4, 2, 2), (7, 3, 1), (20, 2, 1), (2, 9, 1)])
def test_addressed_camera(request, latency, interval, seed):
    size = {"width": 10, "height": 6}
    run(request, "addressed_camera", "tb.acquisition.tb_addressed_camera",
        component=AddressedCamera(**size, converter_latency=latency, interval=interval),
        parameters={**size, "latency": latency, "interval": interval, "seed": seed})


def test_model_marks_the_ends():
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    grey, marker = addressed_camera([(image, 6), (image, 4)])
    assert grey.tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 1]
    assert marker.tolist() == [0, 0, 1, 0, 0, 3, 0, 0, 1, 0, 7]


def test_a_frame_takes_no_longer_than_from_a_camera_of_8_mhz():
    """At 16 MHz and 2 clocks a pixel, with the default latency."""
    clocks = conversions(352, 288, AddressedCamera(352, 288).interval, 0)
    assert clocks[-1] / 16e6 == 352 * 288 / 8e6


@pytest.mark.parametrize("arguments, sentence", [
    ((1, 5), "Frame width must be an integer from 2 to 1024, not 1"),
    ((8, 1025), "Frame height must be an integer from 2 to 1024, not 1025"),
    ((8, 8, 0), "The converter's latency must be an integer from 1 to 64, not 0"),
    ((8, 8, 4, 1), "The clocks of a pixel must be an integer from 2 to 64, not 1"),
])
def test_refuses(arguments, sentence):
    with pytest.raises(ValueError) as caught:
        AddressedCamera(*arguments)
    assert str(caught.value) == sentence
