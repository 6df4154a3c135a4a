"""A memory for two tables, in one dual-port block RAM."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

__all__ = ["TableMemory"]

_WORD_BITS = 36
_DEPTH = 512


class TableMemory(wiring.Component):
    """Holds 512 words of 36 bits for two readers.

    The word at an address is at the data output one clock later, on both sides, in every clock.
    Writing borrows the port of reader A, so that the memory is one RAMB16: in the clock of a
    write, reader A's address is not heard, and its data of the next clock mean nothing. Reader B
    sees the new word from the clock after the write on. All words are zero until they are
    written; reset leaves them as they are.

    Members
    -------
    a_address, b_address : :py:`In(9)`
        Addresses of the two readers.
    a_data, b_data : :py:`Out(36)`
        Their words.
    write_enable : :py:`In(1)`
        Write a word in this clock.
    write_address : :py:`In(9)`
        Its address.
    write_data : :py:`In(36)`
        The word.
    """

    def __init__(self):
        super().__init__({
            "a_address": In(9),
            "a_data": Out(_WORD_BITS),
            "b_address": In(9),
            "b_data": Out(_WORD_BITS),
            "write_enable": In(1),
            "write_address": In(9),
            "write_data": In(_WORD_BITS),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.words = words = Memory(shape=_WORD_BITS, depth=_DEPTH, init=[])
        write = words.write_port()
        read_a = words.read_port()
        read_b = words.read_port()
        address = Signal(9)
        m.d.comb += [
            address.eq(Mux(self.write_enable, self.write_address, self.a_address)),
            write.addr.eq(address),
            write.data.eq(self.write_data),
            write.en.eq(self.write_enable),
            read_a.addr.eq(address),
            read_a.en.eq(1),
            self.a_data.eq(read_a.data),
            read_b.addr.eq(self.b_address),
            read_b.en.eq(1),
            self.b_data.eq(read_b.data),
        ]
        return m
