"""The depth table's two banks and the table of reciprocals, in one memory."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

__all__ = ["TableMemory"]

_WORD_BITS = 36


class TableMemory(wiring.Component):
    """Holds words of 36 bits for two readers: 0 to 255 have two banks, 256 to 511 have one.

    Both readers may read in every clock. They see bank ``bank`` of the lower half; the host writes
    and reads bank ``write_bank``.

    Host accesses borrow the port of reader A, so that the memory fits dual-port block RAM: in the
    clock of a write or read, reader A's address is ignored, and its data of the next clock are the
    word that the host reads, or undefined after a write. Reader B sees a new word from the clock
    after the write on. All words are zero until they are written; reset does not change them.

    Parameters
    ----------
    beams : :class:`int`
        With up to 64, two words for each, a bank has 128 words and both tables fit into one
        RAMB16; address bit 7 is then ignored below 256. Otherwise they take two.

    Members
    -------
    bank : :py:`In(1)`
        Bank that the readers see. May change in any clock; sampled with the address.
    a_address, b_address : :py:`In(9)`
        Addresses of the two readers.
    a_data, b_data : :py:`Out(36)`
        Their words.
    write_bank : :py:`In(1)`
        Bank that is written and read back.
    write_enable, read_enable : :py:`In(1)`
        Write a word in this clock, or read it: it is at ``a_data`` in the next clock.
    write_address : :py:`In(9)`
        Its address.
    write_data : :py:`In(36)`
        The word.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from an address to its word.
    """

    latency = 1

    def __init__(self, beams=128):
        if not isinstance(beams, int) or not 1 <= beams <= 128:
            raise ValueError(f"Beams must be an integer from 1 to 128, not {beams!r}")
        self.beams = beams
        super().__init__({
            "bank": In(1),
            "a_address": In(9),
            "a_data": Out(_WORD_BITS),
            "b_address": In(9),
            "b_data": Out(_WORD_BITS),
            "write_bank": In(1),
            "write_enable": In(1),
            "read_enable": In(1),
            "write_address": In(9),
            "write_data": In(_WORD_BITS),
        })

    def elaborate(self, platform):
        m = Module()
        small = self.beams <= 64
        m.submodules.words = words = Memory(
            shape=_WORD_BITS, depth=512 if small else 1024, init=[])
        write = words.write_port()
        read_a = words.read_port()
        read_b = words.read_port()

        def index(address, bank):
            shared = address[8]
            if small:
                return Cat(address[:7], Mux(shared, address[7], bank), shared)
            return Cat(address[:8], bank & ~shared, shared)

        address = Signal(9)
        bank = Signal()
        port = Signal(len(write.addr))
        host = Signal()
        m.d.comb += [
            host.eq(self.write_enable | self.read_enable),
            address.eq(Mux(host, self.write_address, self.a_address)),
            bank.eq(Mux(host, self.write_bank, self.bank)),
            port.eq(index(address, bank)),
            write.addr.eq(port),
            write.data.eq(self.write_data),
            write.en.eq(self.write_enable),
            read_a.addr.eq(port),
            read_a.en.eq(1),
            self.a_data.eq(read_a.data),
            read_b.addr.eq(index(self.b_address, self.bank)),
            read_b.en.eq(1),
            self.b_data.eq(read_b.data),
        ]
        return m
