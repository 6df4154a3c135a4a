# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.texture import Texture
from tb.hdlsim import run
from tb.link.texture_rig import TextureRig


@pytest.mark.parametrize("width,height,clock_gated,seed", [
    (16, 16, False, 1), (64, 24, False, 2), (87, 21, True, 3)])
def test_texture(request, width, height, clock_gated, seed):
    run(request, "texture_rig", "tb.link.tb_texture",
        component=TextureRig(width, height, clock_gated),
        parameters={"seed": seed, "width": width, "height": height})


@pytest.mark.parametrize("width,height,sentence", [
    (15, 16, "Frame width must be an integer from 16 to 1024, not 15"),
    (16, 1025, "Frame height must be an integer from 16 to 1024, not 1025"),
    ("foo", 16, "Frame width must be an integer from 16 to 1024, not 'foo'")])
def test_bad_size(width, height, sentence):
    with pytest.raises(ValueError, match=sentence):
        Texture(width, height)
