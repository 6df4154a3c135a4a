"""The external static RAM as a block, for rigs in the native engine and in cocotb."""

from amaranth import ClockDomain, ClockSignal, Module, Signal
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.common.sram import SRAMPins

__all__ = ["SRAMChip"]

#: What a read shows of bytes that were never written, and the bus while nobody drives it.
_GARBAGE = 0xA5A5A5A5


class SRAMChip(wiring.Component):
    """Behaves as an asynchronous static RAM would, and counts how its controller mistreats it.

    It looks at the pins twice a clock, before each edge, and so works with pins that change with
    either edge. A write is carried out with the rising edge that follows the end of its pulse.

    Counted as violations, one for each half clock in which one of these is so:

    - address, lanes or chip enable changed while write enable was low, or with either edge of it;
    - write enable rose with the data pins not driven, or data changed with it;
    - the memory and the controller drove the data pins together, or one began with the very edge
      with which the other stopped.

    Parameters
    ----------
    address_bits : :class:`int`
        Of the memory that is there; addresses wrap.

    Members
    -------
    pins : :py:`In(SRAMPins())`
        The controller's pins.
    violations : :py:`Out(16)`
        See above; stops at its greatest value.
    unwritten : :py:`Out(16)`
        Clocks in which a word was read that has bytes that were never written; stops alike.
    reads, writes : :py:`Out(32)`
        Accesses so far.
    """

    def __init__(self, address_bits=19):
        self.address_bits = address_bits
        super().__init__({
            "pins": In(SRAMPins()),
            "violations": Out(16),
            "unwritten": Out(16),
            "reads": Out(32),
            "writes": Out(32),
        })

    def elaborate(self, platform):
        m = Module()
        m.domains += ClockDomain("falling", clk_edge="neg", reset_less=True, local=True)
        m.d.comb += ClockSignal("falling").eq(ClockSignal())
        size = 1 << self.address_bits
        # The ninth bit of a byte indicates that it was written.
        Byte = data.StructLayout({"data": 8, "known": 1})
        m.submodules.words = words = Memory(
            shape=data.ArrayLayout(Byte, 4), depth=size, init=[])
        read = words.read_port(domain="comb")
        write = words.write_port(granularity=1)

        Half = data.StructLayout({
            "address": 19, "lanes_n": 4, "data": 32, "drive": 1, "write": 1, "select": 1, "show": 1,
        })
        second = Signal(Half)  # of this clock, as it is before the rising edge,
        first = Signal(Half)  # of this clock,
        before = Signal(Half)  # and the half before that.
        pins = self.pins
        select = Signal()
        m.d.comb += [
            select.eq(~pins.chip_enable_n),
            second.address.eq(pins.address),
            second.lanes_n.eq(pins.lanes_n),
            second.data.eq(pins.data_out),
            second.drive.eq(pins.data_drive),
            second.select.eq(select),
            second.write.eq(select & ~pins.write_enable_n),
            second.show.eq(select & ~pins.output_enable_n & pins.write_enable_n),
        ]
        m.d.falling += first.eq(second)
        m.d.sync += before.eq(second)

        faults = []
        for number, (old, new) in enumerate([(before, first), (first, second)]):
            end = Signal(name=f"end_{number}")
            moved = Signal(name=f"moved_{number}")
            fault = Signal(name=f"fault_{number}")
            m.d.comb += [
                end.eq(old.write & ~new.write),
                moved.eq((old.address != new.address) | (old.lanes_n != new.lanes_n)
                         | (old.select != new.select)),
                fault.eq((old.write | new.write) & moved
                         | end & (~old.drive | ~new.drive | (old.data != new.data))
                         | new.show & (new.drive | old.drive) | old.show & new.drive),
            ]
            faults.append(fault)
            with m.If(end):
                m.d.comb += [write.addr.eq(old.address), write.en.eq(~old.lanes_n)]
                for lane in range(4):
                    m.d.comb += [
                        write.data[lane].data.eq(old.data.word_select(lane, 8)),
                        write.data[lane].known.eq(1),
                    ]
                m.d.sync += self.writes.eq(self.writes + 1)

        missing = Signal(4)
        m.d.comb += [read.addr.eq(pins.address), pins.data_in.eq(_GARBAGE)]
        with m.If(second.show):
            for lane in range(4):
                byte = read.data[lane]
                m.d.comb += missing[lane].eq(~second.lanes_n[lane] & ~byte.known)
                with m.If(~second.lanes_n[lane] & byte.known):
                    m.d.comb += pins.data_in.word_select(lane, 8).eq(byte.data)
            m.d.sync += self.reads.eq(self.reads + 1)
        with m.If((missing != 0) & ~self.unwritten.all()):
            m.d.sync += self.unwritten.eq(self.unwritten + 1)
        with m.If((faults[0] | faults[1]) & (self.violations < 0xFFFE)):
            m.d.sync += self.violations.eq(self.violations + faults[0] + faults[1])

        return m
