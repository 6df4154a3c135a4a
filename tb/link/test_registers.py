# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.registers import Registers
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
def test_registers(request, seed):
    run(request, "registers", "tb.link.tb_registers", component=Registers(),
        parameters={"seed": seed})


def test_reset_value_of_the_divisor():
    assert Registers().signature.members["divisor"].init == 139
    assert Registers(8_000_000, 9600).signature.members["divisor"].init == 833


@pytest.mark.parametrize("arguments,error", [
    ((0, 9600), "System clock must be a positive integer, not 0"),
    ((1_000_000, 1.5), "Baud rate must be a positive integer, not 1.5"),
    ((1_000_000, 1_000_000),
     "1000000 baud cannot be made of a clock of 1000000 Hz: a bit must take 2 to 65535 clocks"),
    ((16_000_000, 100),
     "100 baud cannot be made of a clock of 16000000 Hz: a bit must take 2 to 65535 clocks"),
])
def test_wrong_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        Registers(*arguments)
    assert str(caught.value) == error
