"""Centres of gravity as fractions."""

from fractions import Fraction

__all__ = ["centre"]


def centre(weight, total):
    """The quotient of a sum and its weight, in pixels, exact."""
    return Fraction(int(total), int(weight))
