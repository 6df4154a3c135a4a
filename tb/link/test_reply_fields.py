# amaranth: UnusedElaboratable=no
import pytest

from hdl.link.reply_fields import ReplyFields
from hdl.protocol import PROTOCOL_VERSION, TABLE_VERSION
from tb.hdlsim import run

SIZES = {"width": 352, "height": 288, "beams": 49, "lanes": 7, "preset": "paper",
         "clock_hz": 24_000_000}


@pytest.mark.parametrize("seed", [1, 2])
def test_reply_fields(request, seed):
    identity = {name: SIZES[name] for name in ("width", "height", "beams", "lanes")}
    identity |= {"protocol": PROTOCOL_VERSION, "tables": TABLE_VERSION, "preset": 1,
                 "clock_khz": 24_000}
    run(request, "reply_fields", "tb.link.tb_reply_fields", component=ReplyFields(**SIZES),
        parameters={"seed": seed, "identity": identity})
