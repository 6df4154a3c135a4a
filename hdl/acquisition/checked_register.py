"""A register that shows when one of its bits has flipped."""

from amaranth.hdl import Cat, Signal, Value

__all__ = ["CheckedRegister"]


class CheckedRegister:
    """Bits of ``sync``, all zero out of reset, with their parity in one more flip-flop.

    The parity is that of what the register is going to hold, taken before the clock's edge. A bit
    that flips after the edge therefore disagrees with it in the same clock. Assign with
    ``m.d.sync += register.eq(...)`` only, so that value and parity change together.

    Parameters
    ----------
    shape : :ref:`shape-like <lang-shapelike>`
        Of the value.
    name : :class:`str`
        Of the signal in the netlist; the parity's name has ``_parity`` behind it.

    Attributes
    ----------
    value : :class:`amaranth.hdl.Signal` or a view of one
        What the register holds.
    upset : :class:`amaranth.hdl.Value`
        High while an odd number of its bits, the parity among them, is wrong.
    """

    def __init__(self, shape, name):
        self.value = Signal(shape, name=name)
        self._parity = Signal(name=f"{name}_parity")

    @property
    def upset(self):
        return Cat(self.value, self._parity).xor()

    def eq(self, value):
        """Assign an unsigned value, cut to the register's width, and its parity."""
        register, value = Value.cast(self.value), Value.cast(value)
        return [register.eq(value), self._parity.eq(value[:len(register)].xor())]
