"""Bits that flip in the registers of a design, in any clock, and power-up in any state."""

import re

from amaranth.hdl import Cat, Signal
from amaranth.hdl._ast import SignalDict
from amaranth.hdl._xfrm import StatementTransformer, ValueTransformer

__all__ = ["Upsets", "without_initial_values"]


class Upsets:
    """Lets one bit of the registers of a fragment flip in each clock.

    Every register becomes the output of a flip-flop, and a bit of it is inverted in a clock in
    which it is hit. All that reads the register has the inverted bit, its own next value included,
    so the bit stays flipped until something else is assigned.

    Parameters
    ----------
    fragment : :class:`amaranth.hdl.Fragment`
        In the domain ``sync`` and without submodules. It is changed.

    Attributes
    ----------
    target : :class:`amaranth.hdl.Signal`
        Input: number of the bit to flip in this clock; ``bits``, and what is more, for none.
    bits : :class:`int`
        In all registers together.
    flops : :class:`dict`
        By a register's name, what its flip-flops hold before anything is flipped.
    """

    def __init__(self, fragment):
        if fragment.subfragments or not set(fragment.statements) <= {"comb", "sync"}:
            raise ValueError("Registers of submodules and of other domains would not be hit")
        statements = fragment.statements.pop("sync")
        registers = {register.name: register for statement in statements
                     for register in statement._lhs_signals()}
        self.flops = {name: Signal.like(register, name=f"{name}_flop")
                      for name, register in registers.items()}
        self.bits = sum(map(len, self.flops.values()))
        self.target = Signal(range(self.bits + 1), name="upset_target")
        self._first, first = {}, 0
        for name, flop in self.flops.items():
            self._first[name] = first
            flip = Cat(self.target == first + bit for bit in range(len(flop)))
            first += len(flop)
            fragment.add_statements("comb", registers[name].eq(flop ^ flip))
            fragment.add_statements("sync", flop.eq(registers[name]))  # if nothing is assigned
        rename = _Assigned(SignalDict(
            (registers[name], flop) for name, flop in self.flops.items()))
        fragment.add_statements("sync", rename.on_statements(statements))

    def hit(self, name):
        """High while a bit of the register flips."""
        first = self._first[name]
        return (self.target >= first) & (self.target < first + len(self.flops[name]))


class _Assigned(ValueTransformer, StatementTransformer):
    """Statements that read the same signals but assign to others."""

    def __init__(self, others):
        self._others, self._assigns = others, False

    def on_Signal(self, value):  # noqa: N802
        return self._others.get(value, value) if self._assigns else value

    def on_Assign(self, stmt):  # noqa: N802
        self._assigns = True
        target = self.on_value(stmt.lhs)
        self._assigns = False
        return target.eq(self.on_value(stmt.rhs))


def without_initial_values(text, module):
    """RTLIL in which the registers of one module have any value at first."""
    start = text.index(f"module \\{module}\n")
    end = text.index("\nend\n", start)
    body, count = re.subn(r"^ *attribute \\init .*\n", "", text[start:end], flags=re.MULTILINE)
    if not count:
        raise LookupError(f"No register of {module} has an initial value")
    return text[:start] + body + text[end:]
