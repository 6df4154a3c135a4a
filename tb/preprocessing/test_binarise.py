# amaranth: UnusedElaboratable=no
"""Both twins of binarise run one bench; the model against plain arithmetic."""

import numpy as np
import pytest

from hdl.preprocessing.binarise import Binarise
from model.preprocessing.binarise import binarise
from tb.hdlsim import run


@pytest.mark.parametrize("twin", ["amaranth", "vhdl-93", "vhdl-08"])
@pytest.mark.parametrize("seed", [1])
def test_binarise(request, twin, seed):
    if twin == "amaranth":
        run(request, "binarise", "tb.preprocessing.tb_binarise", component=Binarise(8),
            parameters={"seed": seed})
    else:
        run(request, "binarise", "tb.preprocessing.tb_binarise",
            vhdl=["hdl/preprocessing/binarise.vhd"], standard=twin[-2:],
            generics={"pixel_bits": 8}, parameters={"seed": seed})


def test_model_at_every_grey_and_level():
    grey = np.arange(256, dtype=np.uint8)[None]
    for level in range(256):
        lit, excess = binarise(grey, level)
        assert lit.tolist()[0] == [value >= level for value in range(256)]
        assert excess.tolist()[0] == [max(0, value - level) for value in range(256)]
        assert excess.dtype == np.uint8


@pytest.mark.parametrize("pixel_bits", [7, 10, "8", None])
def test_refuses_other_widths(pixel_bits):
    with pytest.raises(ValueError, match="Pixel bits must be 8, not "):
        Binarise(pixel_bits)
