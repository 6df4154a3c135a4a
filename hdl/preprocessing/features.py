"""The sums that make a component's features.

The features form a monoid: :func:`empty`, :func:`of_pixel`, and :func:`merge`, which is associative
and commutative. Labelling adds them up without knowing what they mean.
"""

from amaranth import *
from amaranth.lib import data

from ..payloads import AREA_LIMIT, Spot
from ..protocol import SMALL_SENSOR

__all__ = ["Features", "empty", "merge", "of_pixel", "sum_bits"]


class Features(data.Struct):
    """Sums over pixels; fields as in :class:`..payloads.Spot`.

    The top bit of ``area`` stays set once the area reached :data:`..payloads.AREA_LIMIT`. All
    other bits except the flags are then meaningless; the sums may have wrapped.
    """

    core: 1
    saturated: 1
    border: 1
    area: Spot.as_shape()["area"].shape
    weight: Spot.as_shape()["weight"].shape
    sum_u: Spot.as_shape()["sum_u"].shape
    sum_v: Spot.as_shape()["sum_v"].shape


_AREA_BITS = AREA_LIMIT.bit_length() - 1


def empty():
    """Features of no pixel."""
    return Features(Const(0, Features.as_shape().size))


def _assembled(*parts):
    fields = [member for _, member in Features.as_shape()]
    return Features(Cat((Value.cast(part) | Const(0, field.width))[:field.width]
                        for part, field in zip(parts, fields, strict=True)))


def of_pixel(core, saturated, border, weight, column, row):
    """Features of one lit pixel; two products."""
    return _assembled(core, saturated, border, C(1, 1), weight, weight * column, weight * row)


def sum_bits(width, height):
    """Bits of the sums of a component in a frame of that size."""
    return Spot.as_shape()["sum_u"].width - (max(width, height) <= SMALL_SENSOR)


def merge(one, other, bits):
    """Features of two disjoint sets of pixels together; sums have so many bits."""
    area = one.area[:_AREA_BITS] + other.area[:_AREA_BITS]
    full = one.area[_AREA_BITS] | other.area[_AREA_BITS] | area[_AREA_BITS]
    return _assembled(
        one.core | other.core, one.saturated | other.saturated, one.border | other.border,
        Cat(area[:_AREA_BITS], full), one.weight + other.weight,
        (one.sum_u + other.sum_u)[:bits], (one.sum_v + other.sum_v)[:bits])
