# amaranth: UnusedElaboratable=no
import random
import zlib

import pytest
from cobs import cobs as oracle

from hdl.link.framer import Framer
from model.link.framer import cobs, frame
from tb.hdlsim import run
from tb.link.serial_line import SerialLine


@pytest.mark.parametrize("seed", [1, 2])
def test_framer(request, seed):
    run(request, "framer", "tb.link.tb_framer", component=Framer(), parameters={"seed": seed})


@pytest.mark.parametrize("seed", [1])
def test_serial_line(request, seed):
    run(request, "serial_line", "tb.link.tb_serial_line", component=SerialLine(),
        parameters={"seed": seed})


@pytest.mark.parametrize("seed", [1])
def test_model_against_the_cobs_package(seed):
    rng = random.Random(seed)
    for size in list(range(98)) + [252, 253]:
        for octets in (range(256), range(2), range(1), range(1, 256)):
            content = bytes(rng.choice(octets) for _ in range(size))
            assert cobs(content) == oracle.encode(content)
    with pytest.raises(ValueError, match="Content must have fewer than 254 octets, not 254"):
        cobs(bytes(254))


def test_model_of_a_packet():
    packets, following = frame([b"\x50abc", b"\x51" + bytes(91)], 0xFF)
    assert following == 1
    for packet, content in zip(packets, [b"\x50\xffabc", b"\x51\0" + bytes(91)], strict=True):
        assert packet[0] == packet[-1] == 0 and 0 not in packet[1:-1] and len(packet) <= 100
        decoded = oracle.decode(packet[1:-1])
        assert decoded[:-4] == content
        assert int.from_bytes(decoded[-4:], "little") == zlib.crc32(content)
