# amaranth: UnusedElaboratable=no
import pytest

from hdl.export import to_verilog
from hdl.link.receiver import Receiver
from model.link.receiver import PacketReceiver, encode
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run


@pytest.mark.parametrize("seed", [1])
def test_receiver(request, seed):
    run(request, "receiver", "tb.link.tb_receiver", component=Receiver(),
        parameters={"seed": seed})


def test_is_small():
    size = measure_verilog(to_verilog(Receiver(), "receiver"), "receiver")
    assert size["lut4"] <= 170 and size["ramb16"] == 1


def test_the_models_example():
    """The check value of CRC-32 for its usual example, and COBS about zeros."""
    assert encode(b"123456789").hex(" ") == "00 0e 31 32 33 34 35 36 37 38 39 26 39 f4 cb 00"
    octets = encode(b"\0\x11\0\0\x22")
    assert octets[:7].hex(" ") == "00 01 02 11 01 06 22" and octets[-1] == 0
    model = PacketReceiver()
    assert [model.receive(octet) for octet in octets][-1] == b"\0\x11\0\0\x22"
