"""The depth table's two banks and the table of reciprocals, in one memory."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import bits_for

from hdl.protocol import MOST_BEAMS

__all__ = ["ADDRESS_BITS", "TableMemory"]

#: Bits of an address; the last one chooses the reciprocals.
ADDRESS_BITS = 1 + bits_for(2 * MOST_BEAMS - 1)

_WORD_BITS = 36
_RECIPROCALS = 256
#: Words of the memory by the address bits of a bank.
_DEPTHS = {7: 512, 8: 1024, 10: 2048}


class TableMemory(wiring.Component):
    """Holds words of 36 bits for two readers: two banks of depth words, and 256 reciprocals.

    Addresses 0 to ``2 * beams - 1`` are the depth words, 1024 to 1279 the reciprocals; no others
    may be used. Both readers may read in every clock. They see bank ``bank`` of the depth words;
    the host writes and reads bank ``write_bank``.

    Host accesses borrow the port of reader A, so that the memory fits dual-port block RAM: in the
    clock of a write or read, reader A's address is ignored, and its data of the next clock are the
    word that the host reads, or undefined after a write. Reader B sees a new word from the clock
    after the write on. All words are zero until they are written; reset does not change them.

    Parameters
    ----------
    beams : :class:`int`
        1 to :data:`hdl.protocol.MOST_BEAMS`, two depth words each. Up to 64 take one RAMB16, up to
        128 two, up to 384 four, and more take five, with multiplexers behind them.

    Members
    -------
    bank : :py:`In(1)`
        Bank that the readers see. May change in any clock; sampled with the address.
    a_address, b_address : :py:`In(11)`
        Addresses of the two readers.
    a_data, b_data : :py:`Out(36)`
        Their words.
    write_bank : :py:`In(1)`
        Bank that is written and read back.
    write_enable, read_enable : :py:`In(1)`
        Write a word in this clock, or read it: it is at ``a_data`` in the next clock.
    write_address : :py:`In(11)`
        Its address.
    write_data : :py:`In(36)`
        The word.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from an address to its word.
    """

    latency = 1

    def __init__(self, beams=MOST_BEAMS):
        if not isinstance(beams, int) or not 1 <= beams <= MOST_BEAMS:
            raise ValueError(f"Beams must be an integer from 1 to {MOST_BEAMS}, not {beams!r}")
        self.beams = beams
        super().__init__({
            "bank": In(1),
            "a_address": In(ADDRESS_BITS),
            "a_data": Out(_WORD_BITS),
            "b_address": In(ADDRESS_BITS),
            "b_data": Out(_WORD_BITS),
            "write_bank": In(1),
            "write_enable": In(1),
            "read_enable": In(1),
            "write_address": In(ADDRESS_BITS),
            "write_data": In(_WORD_BITS),
        })

    def elaborate(self, platform):
        m = Module()
        # Address bits in a bank: others than these leave a memory with multiplexers behind it. The
        # reciprocals stand behind both banks, at the end of the second one, or apart.
        bits = next(bits for bits in _DEPTHS if 2 * self.beams <= 1 << bits)
        apart = bits == 10 and 2 * self.beams + _RECIPROCALS > 1 << bits

        def index(address, bank):
            shared = address[-1]
            if bits == 7:
                return Cat(address[:7], Mux(shared, address[7], bank), shared)
            if bits == 8:
                return Cat(address[:8], bank & ~shared, shared)
            return Cat(address[:8], address[8:10] | shared.replicate(2), bank | shared)

        address = Signal(ADDRESS_BITS)
        bank = Signal()
        host = Signal()
        m.d.comb += [
            host.eq(self.write_enable | self.read_enable),
            address.eq(Mux(host, self.write_address, self.a_address)),
            bank.eq(Mux(host, self.write_bank, self.bank)),
        ]
        port, b_port = index(address, bank), index(self.b_address, self.bank)
        words = self._memory(m, "words", _DEPTHS[bits], port, b_port,
                             ~address[-1] if apart else 1)
        if apart:
            reciprocals = self._memory(m, "reciprocals", _RECIPROCALS, port[:8], b_port[:8],
                                       address[-1])
            for n, asked in enumerate((address[-1], self.b_address[-1])):
                shared = Signal(reset_less=True, name=f"shared_{n}")
                m.d.sync += shared.eq(asked)
                words[n] = Mux(shared, reciprocals[n], words[n])
        m.d.comb += [self.a_data.eq(words[0]), self.b_data.eq(words[1])]
        return m

    def _memory(self, m, name, depth, a_index, b_index, chosen):
        """A memory with two ports; gives the words of both."""
        memory = Memory(shape=_WORD_BITS, depth=depth, init=[])
        m.submodules[name] = memory
        write = memory.write_port()
        read_a, read_b = memory.read_port(), memory.read_port()
        port = Signal(len(write.addr), name=f"{name}_port")
        m.d.comb += [
            port.eq(a_index),
            write.addr.eq(port), write.data.eq(self.write_data),
            write.en.eq(self.write_enable & chosen),
            read_a.addr.eq(port), read_a.en.eq(1),
            read_b.addr.eq(b_index), read_b.en.eq(1),
        ]
        return [read_a.data, read_b.data]
