# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from hdl.link.texture import Texture
from model.link import texture as model
from tb.hdlsim import run
from tb.link.texture_rig import TextureRig


@pytest.mark.parametrize("width,height,clock_gated,seed", [
    (16, 12, False, 1), (64, 24, False, 2), (87, 20, True, 3)])
def test_texture(request, width, height, clock_gated, seed):
    run(request, "texture_rig", "tb.link.tb_texture",
        component=TextureRig(width, height, clock_gated),
        parameters={"seed": seed, "width": width, "height": height})


@pytest.mark.parametrize("width,height,sentence", [
    (1, 8, "Frame width must be an integer from 2 to 1024, not 1"),
    (8, 1025, "Frame height must be an integer from 2 to 1024, not 1025"),
    ("foo", 8, "Frame width must be an integer from 2 to 1024, not 'foo'")])
def test_bad_size(width, height, sentence):
    with pytest.raises(ValueError, match=sentence):
        Texture(width, height)


def test_model_sends_every_pixel_once():
    """Packets of whole rows, of what is left of a row, and of what was captured."""
    rng = np.random.default_rng(1)
    one = model.Texture(352, 288)
    seen = np.zeros((288, 352), int)
    sizes = set()
    for number in range(100):
        image = rng.integers(0, 256, (288, 352)).astype(np.uint8)
        one.frame(image, model.TextureFrame(number=number))
        while (content := one.packet()) is not None:
            if content[0] == model.TEXTURE:
                row, column = (int.from_bytes(content[at:at + 2], "little") for at in (2, 4))
                pixels = np.frombuffer(content[6:], np.uint8)
                assert content[1] == number
                assert (image[row, column:column + len(pixels)] == pixels).all()
                seen[row, column:column + len(pixels)] += 1
                sizes.add(len(pixels))
        if one.stands == 0:
            break
    assert (seen == 1).all()
    # 1023 pixels a frame end anywhere in a row.
    assert max(sizes) == 86 and 8 in sizes
