# amaranth: UnusedElaboratable=no
import pytest

from hdl.export import to_verilog
from hdl.link.uart_rx import UARTReceiver
from model.link.uart_rx import LATENCY
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
def test_uart_rx(request, seed):
    component = UARTReceiver()
    assert component.latency == LATENCY
    run(request, "uart_rx", "tb.link.tb_uart_rx", component=component, parameters={"seed": seed})


def test_is_small():
    assert measure_verilog(to_verilog(UARTReceiver(), "uart_rx"), "uart_rx")["lut4"] <= 100
