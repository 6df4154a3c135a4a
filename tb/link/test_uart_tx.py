import pytest

from hdl.link.uart_tx import UARTTransmitter
from tb.hdlsim import run


@pytest.mark.parametrize("twin", ["amaranth", "vhdl-93", "vhdl-08"])
@pytest.mark.parametrize("seed", [1])
def test_uart_tx(request, twin, seed):
    if twin == "amaranth":
        run(request, "uart_tx", "tb.link.tb_uart_tx", component=UARTTransmitter(),
            parameters={"seed": seed})
    else:
        run(request, "uart_tx", "tb.link.tb_uart_tx", vhdl=["hdl/link/uart_tx.vhd"],
            standard=twin[-2:], parameters={"seed": seed})
