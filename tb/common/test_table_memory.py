# amaranth: UnusedElaboratable=no
import pytest

from hdl.common.table_memory import TableMemory
from hdl.export import to_verilog
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("beams", [49, 128, 361, 512])
@pytest.mark.parametrize("seed", [1])
def test_table_memory(request, beams, seed):
    run(request, "table_memory", "tb.common.tb_table_memory", component=TableMemory(beams),
        parameters={"seed": seed, "beams": beams})


@pytest.mark.parametrize("beams,block_rams", [
    (1, 1), (64, 1), (65, 2), (128, 2), (129, 4), (384, 4), (512, 5)])
def test_block_rams(beams, block_rams):
    size = measure_verilog(to_verilog(TableMemory(beams), "table_memory"), "table_memory")
    assert size["ramb16"] == block_rams
    assert size["lut4"] <= (25 if beams <= 384 else 180)


@pytest.mark.parametrize("beams", [0, 513, "49"])
def test_wrong_parameters(beams):
    with pytest.raises(ValueError) as caught:
        TableMemory(beams)
    assert str(caught.value) == f"Beams must be an integer from 1 to 512, not {beams!r}"
