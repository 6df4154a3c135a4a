"""Fields and flags in the order of the protocol."""

import pytest
from amaranth.hdl import C, Const, Signal

from hdl.link.packet_fields import bits_of_fields, flags_octet
from hdl.protocol import TRAILER_FIELDS, Field, Flag

FIELDS = (Field("low", 8, ""), Field("wide", 16, ""), Field("high", 8, ""))


def test_fields_stand_in_their_order():
    value = Const.cast(bits_of_fields(FIELDS, {"low": C(0x12, 8), "wide": C(0xABC, 12),
                                               "high": C(1, 1)}))
    assert (value.value, len(value)) == (0x010ABC12, 32)


def test_widths_may_differ():
    value = Const.cast(bits_of_fields(
        FIELDS, {"low": C(0x123, 12), "wide": C(5, 16), "high": C(7, 8)}, {"low": 12}))
    assert (value.value, len(value)) == (0x07 << 28 | 5 << 12 | 0x123, 36)


def test_a_value_that_is_too_wide_is_refused():
    with pytest.raises(ValueError) as caught:
        bits_of_fields(FIELDS, {"low": C(0, 9), "wide": C(0, 16), "high": C(0, 8)})
    assert str(caught.value) == "The field 'low' has 8 bits, not 9"


def test_every_field_wants_a_value():
    with pytest.raises(KeyError):
        bits_of_fields(TRAILER_FIELDS, {"number": Signal(16)})


@pytest.mark.parametrize("flag", Flag)
def test_flags_are_at_their_bits(flag):
    value = Const.cast(flags_octet(**{flag.name.lower(): C(1, 1)}))
    assert (value.value, len(value)) == (1 << flag, 8)


def test_unknown_flag_is_refused():
    with pytest.raises(LookupError) as caught:
        flags_octet(wide=C(1, 1), lit=C(1, 1))
    assert str(caught.value) == "The protocol has no flag 'lit'"
