# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from hdl.acquisition.camera import Camera
from model.acquisition.camera import BROKEN, FRAME_END, LINE_END, camera
from tb.acquisition.pins import FAULTS, show
from tb.acquisition.tb_camera import HEIGHT, WIDTH
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1, 2])
def test_camera(request, seed):
    run(request, "camera", "tb.acquisition.tb_camera", component=Camera(WIDTH, HEIGHT),
        parameters={"seed": seed})


@pytest.mark.parametrize("fault", (None, *FAULTS))
@pytest.mark.parametrize("seed", range(5))
def test_model_keeps_frames_apart(fault, seed):
    """Whatever comes between two good frames, both are whole, and the fault is seen once."""
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (3, 5, 8))
    pins = np.concatenate([show(rng, images[0]), show(rng, images[1], fault),
                           show(rng, images[2]), [(0, 0, 0)]])
    grey, marker = camera(*pins.T, 8, 5)
    assert np.count_nonzero(marker & BROKEN) == (fault is not None)
    for image, (pixels, markers) in ((images[0], (grey[:40], marker[:40])),
                                   (images[2], (grey[-40:], marker[-40:]))):
        assert np.array_equal(pixels.reshape(5, 8), image)
        assert np.array_equal(markers.reshape(5, 8)[:, -1], [LINE_END] * 4 + [LINE_END | FRAME_END])
        assert not markers.reshape(5, 8)[:, :-1].any()


@pytest.mark.parametrize("size,error", [
    ((1, 5), "Frame width must be an integer from 2 to 1024, not 1"),
    ((8, 1025), "Frame height must be an integer from 2 to 1024, not 1025"),
    ((8, "x"), "Frame height must be an integer from 2 to 1024, not 'x'"),
])
def test_refuses_sizes(size, error):
    with pytest.raises(ValueError) as caught:
        Camera(*size)
    assert str(caught.value) == error
