# amaranth: UnusedElaboratable=no
import pytest
from amaranth.hdl import unsigned

from hdl.acquisition.sram_frames import SRAMFrames
from hdl.export import to_verilog
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize("width, banks", [(22, 3), (24, 2)])
def test_sram_frames(request, width, banks, seed):
    run(request, "sram_frames", "tb.acquisition.tb_sram_frames",
        component=SRAMFrames(width, 9, banks, base=1000 * width),
        parameters={"width": width, "height": 9, "banks": banks, "seed": seed})


def test_memory_is_block_memory():
    cost = measure_verilog(to_verilog(SRAMFrames(352, 288), "sram_frames"), "sram_frames")
    assert cost["ramb16"] == 2 and not cost["distributed"] and not cost["latches"]


def test_words():
    store = SRAMFrames(350, 100)
    assert (store.row_words, store.bank_words) == (88, 8800)


@pytest.mark.parametrize("arguments, error", [
    ((1, 5), "Frame width must be an integer from 2 to 512, not 1"),
    ((8, 8, 1), "The number of banks must be 2 or 3, not 1"),
    ((352, 288, 3, 448_257),
     "The address of the first bank must be an integer from 0 to 448256, not 448257"),
    ((8, 8, 3, 0, unsigned(33)),
     "A frame's information must fit 32 bits, which unsigned(33) does not"),
])
def test_refuses_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        SRAMFrames(*arguments)
    assert str(caught.value) == error
