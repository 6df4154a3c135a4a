"""The registers that the host writes."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.ports import register_shape
from hdl.protocol import Mode, registers

__all__ = ["Registers", "register_members"]


def register_members(clock_hz, baud):
    """Outputs for every register as it acts, by its name.

    Raises
    ------
    ValueError
        If the clock cannot make that rate.
    """
    for name, value in [("System clock", clock_hz), ("Baud rate", baud)]:
        if not isinstance(value, int) or value < 1:
            raise ValueError(f"{name} must be a positive integer, not {value!r}")
    if not 2 <= round(clock_hz / baud) < 1 << 16:
        raise ValueError(f"{baud} baud cannot be made of a clock of {clock_hz} Hz: a bit must "
                         "take 2 to 65535 clocks")
    return {register.name: Out(register_shape(register), init=register.reset)
            for register in registers(clock_hz, baud)}


class Registers(wiring.Component):
    """Holds every register of :func:`hdl.protocol.registers` twice: as written, and as it acts.

    ``write`` sets the value as written in the next clock; it may be high only for a register that
    is ``known`` and a value that ``fits``. ``hand_over`` makes all values act in the next clock,
    together; a value written in the same clock is not handed over yet. Reset sets all of them to
    their reset values.

    A single pair ends by itself: ``single_done`` sets ``mode`` to stop if a single pair is what
    acts, and as written too unless another mode was written meanwhile.

    Parameters
    ----------
    clock_hz, baud : :class:`int`
        System clock and rate of the serial line: the divisor's reset value.

    Members
    -------
    address, value : :py:`In(8)`, :py:`In(32)`
        Register and the value to write, in two's complement if the register is signed. All members
        below refer to the address of the clock before, and to the value of this one.
    known, fits, only_stopped : :py:`Out(1)`
        There is a register of that address; the value is inside its limits; it may be written
        only while the chip is stopped.
    write : :py:`In(1)`
        Write the value.
    read_data : :py:`Out(32)`
        Value of the register as written.
    hand_over, single_done : :py:`In(1)`
        As above.
    stop : :py:`Out(1)`
        ``mode`` as written is stop.
    mode, period_us, and so on : :py:`Out`
        Each register's value as it acts, by its name, with its bits and sign.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``hand_over`` to the values that act.
    """

    latency = 1

    def __init__(self, clock_hz=16_000_000, baud=115_200):
        members = register_members(clock_hz, baud)
        self.table = registers(clock_hz, baud)
        super().__init__({
            "address": In(8),
            "value": In(32),
            "known": Out(1),
            "fits": Out(1),
            "only_stopped": Out(1),
            "write": In(1),
            "read_data": Out(32),
            "hand_over": In(1),
            "single_done": In(1),
            "stop": Out(1, init=1),
            **members,
        })

    def elaborate(self, platform):
        m = Module()
        # A flip-flop for each register selects it: with them the choices below take half of the
        # logic that they take behind the address.
        selected = Signal(len(self.table))
        m.d.sync += selected.eq(Cat(self.address == register.address for register in self.table))
        fits, only_stopped, read_data = 0, 0, 0
        written = {}
        for is_selected, register in zip(selected, self.table, strict=True):
            name = register.name
            value = written[name] = Signal(
                register_shape(register), name=f"{name}_written", init=register.reset)
            with m.If(is_selected & self.write):
                m.d.sync += value.eq(self.value)
            fits |= is_selected & self._fits(register)
            if register.only_stopped:
                only_stopped |= is_selected
            wide = Signal(signed(32), name=f"{name}_wide")
            m.d.comb += wide.eq(value)
            read_data |= wide & is_selected.replicate(32)
        m.d.comb += [
            self.known.eq(selected.any()),
            self.fits.eq(fits),
            self.only_stopped.eq(only_stopped),
            self.read_data.eq(read_data),
            self.stop.eq(written["mode"] == Mode.STOP),
        ]
        with m.If(self.hand_over):
            m.d.sync += [getattr(self, name).eq(value) for name, value in written.items()]

        # The mode may be another one as written only if the host wrote it since the hand-over.
        mode, next_mode = self.mode, written["mode"]
        done = Signal()
        m.d.comb += done.eq(self.single_done & (mode == Mode.SINGLE))
        new = Signal()
        with m.If(self.write & selected[self._index("mode")]):
            m.d.sync += new.eq(1)
        with m.Else():
            with m.If(self.hand_over):
                m.d.sync += new.eq(0)
            with m.If(done & ~new):
                m.d.sync += next_mode.eq(Mode.STOP)
        with m.If(done & ~(self.hand_over & new)):
            m.d.sync += mode.eq(Mode.STOP)
        return m

    def _index(self, name):
        return next(n for n, register in enumerate(self.table) if register.name == name)

    def _fits(self, register):
        """Whether the value is inside the register's limits."""
        bits = register.bits
        if register.signed:
            return self.value[bits - 1:].all() | ~self.value[bits - 1:].any()
        fits = ~self.value[bits:].any()
        if register.low == 1:
            fits &= self.value[:bits].any()
        elif register.low:
            fits &= self.value[:bits] >= register.low
        if register.high is not None and register.high < (1 << bits) - 1:
            fits &= self.value[:bits] <= register.high
        return fits
