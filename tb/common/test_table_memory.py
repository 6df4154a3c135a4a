import pytest

from hdl.common.table_memory import TableMemory
from hdl.export import to_verilog
from scripts.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
def test_table_memory(request, seed):
    run(request, "table_memory", "tb.common.tb_table_memory", component=TableMemory(),
        parameters={"seed": seed})


def test_is_one_block_ram():
    size = measure_verilog(to_verilog(TableMemory(), "table_memory"), "table_memory")
    assert size["ramb16"] == 1
    assert size["lut4"] <= 9
