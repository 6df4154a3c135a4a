# amaranth: UnusedElaboratable=no
import pytest

from hdl.common.point_fifo import PointFIFO
from hdl.export import to_verilog
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("blocks,depth", [(1, 171), (2, 342)])
@pytest.mark.parametrize("seed", [1])
def test_point_fifo(request, seed, blocks, depth):
    component = PointFIFO(blocks)
    assert component.depth == depth
    run(request, "point_fifo", "tb.common.tb_point_fifo", component=component,
        parameters={"seed": seed, "depth": component.depth})


@pytest.mark.parametrize("blocks", [1, 2])
def test_block_rams(blocks):
    size = measure_verilog(to_verilog(PointFIFO(blocks), "point_fifo"), "point_fifo")
    assert size["ramb16"] == blocks


def test_blocks_must_be_a_positive_integer():
    with pytest.raises(ValueError, match="Blocks must be a positive integer, not 0"):
        PointFIFO(0)
