"""Pixels of a texture to words of packets."""

from amaranth import *

__all__ = ["PACKET_WORDS", "TextureCode", "quantise"]

#: Words of a packet of full length, the head among them.
PACKET_WORDS = 22

_HEAD_BITS = 32
_FULL = 32 * PACKET_WORDS - 16  # bits; a code has at most 16
_ACTIVITY = 8
_LITERAL, _ROW_END = 6, 7  # zeros


def quantise(grey, bound):
    """The step of ``2 bound + 1`` grey values that ``grey``, 8 bits, is nearest to.

    ``bound`` is a value of the register ``texture_bound``: its bit 2 makes 4 of it, bit 1 makes 2.
    """
    # (p + 2) // 5 is 51 (p + 3) >> 8, and (p + 4) // 9 is 57 (p + 4) >> 9, for all p below 256.
    ninth = bound[2]
    above = grey + C(3) + ninth
    three = above + (above << 1)
    product = three + (three << 4) + ((three << 1) & ninth.replicate(12))
    return Mux(ninth, product[9:], Mux(bound[1], product[8:], grey))[:8]


def _above(activity):
    """Which bits of a fold are sent as they are."""
    return Cat(Value.cast(activity)[3 + n:].any() for n in range(8))


class TextureCode(Elaboratable):
    """Packs pixels, one a clock, see the README; words go to a memory two clocks later.

    In each clock there is a pixel, an end of a row (``mark``), or, when a pass is over, zeros up to
    the next whole word (``closing``), or nothing.

    Attributes
    ----------
    pixel, value, fold, mosaic : in
        A quantised pixel; its difference to the one that it resembles, folded: 0, -1, 1, -2 and so
        on. ``mosaic``: that is the one two before, not the last one.
    mark, closing, restart : in
        As above; ``restart`` forgets the packet that is under way.
    head : in
        Number, row, column and form of the packet whose first pixel came last.
    open, first : out
        A packet is under way; what came in this clock is a packet's first pixel.
    full, ends : out
        What came in this clock fills the packet; it is the packet's last.
    write, word, data, last : out
        A word of the packet, its place in it, and whether it is the last one; of what came two
        clocks before.
    """

    def __init__(self):
        self.pixel, self.mark, self.closing, self.restart = (Signal() for _ in range(4))
        self.mosaic = Signal()
        self.value, self.fold = Signal(8), Signal(9)
        self.head = Signal(_HEAD_BITS)
        self.open, self.first, self.full, self.ends = (Signal() for _ in range(4))
        self.write, self.last = Signal(), Signal()
        self.word = Signal(range(PACKET_WORDS))
        self.data = Signal(32)
        self._begins = Signal()

        self._used = Signal(10, init=_HEAD_BITS)  # bits of the packet
        self._emits = Signal()
        self._zeros = Signal(3)
        self._rest = Signal(9)
        self._length = Signal(5)

    def elaborate(self, platform):
        m = Module()
        self._encode(m)
        self._assemble(m)
        return m

    def _encode(self, m):
        """The code of what came: zeros, a one, and other bits."""
        fold = self.fold
        activity, following = Signal(11, init=_ACTIVITY), Signal(11)
        # above[n]: the fold's lowest n + 1 bits, or more, are sent as they are.
        above = Signal(8, init=(1 << (_ACTIVITY >> 3).bit_length()) - 1)
        waits = Signal()  # a pixel without a difference waits for its code
        second = Signal()  # the next pixel is the packet's second
        raw = Signal()
        m.d.comb += [
            self.first.eq(self.pixel & ~self.open),
            raw.eq(~self.open | (second & self.mosaic)),
            following.eq(activity + fold - activity[2:]),
        ]
        of_bits = [~above[0], *(above[n - 1] & ~above[n] for n in range(1, 8)), above[7]]
        runs = ~above[0]
        # The quotient's lowest bits, and whether it has others.
        quotient = Cat(
            Cat(of_bits[n] & fold[n + place] for n in range(9 - place)).any()
            for place in range(3))
        large = Cat(fold[n] & ~above[n - 3] for n in range(3, 9)).any()
        literal, even = Signal(), Signal()
        bits = Signal(4)
        m.d.comb += [
            literal.eq(large | (quotient[2] & quotient[1])),
            even.eq(runs & ~raw & ~fold.any()),
            self._emits.eq(Mux(self.pixel, ~even | waits, self.mark | self.closing)),
        ]
        with m.If(~self.pixel):
            m.d.comb += [self._zeros.eq(_ROW_END), bits.eq(self.mark & runs),
                         self._rest[0].eq(waits)]
        with m.Elif(raw):
            m.d.comb += [self._rest.eq(self.value), bits.eq(8)]
        with m.Elif(literal):
            m.d.comb += [self._zeros.eq(_LITERAL), bits.eq(Cat(runs, 0, 0, 1)),
                         self._rest.eq(Cat(self.value, waits))]
        with m.Else():
            m.d.comb += [
                self._zeros.eq(quotient), self._rest.eq(Cat(fold[0] & above[0] | waits & ~even,
                                                            fold[1:] & above[1:])),
                bits.eq(Cat(Cat(of_bits[n] for n in range(9) if n >> place & 1).any()
                            for place in range(4)) | (runs & ~even))]
        m.d.comb += self._length.eq(1 + self._zeros + bits)
        with m.If(self.pixel):
            m.d.sync += [waits.eq(even & ~waits), second.eq(~self.open)]
            with m.If(~raw):
                m.d.sync += [activity.eq(following), above.eq(_above(following))]
        with m.If(self.mark | self.restart):
            m.d.sync += waits.eq(0)
        with m.If(self.ends | self.restart):
            m.d.sync += [activity.eq(_ACTIVITY), above.eq(_above(_ACTIVITY))]

    def _assemble(self, m):
        """Codes one behind the other, and words of them."""
        used, following = self._used, Signal(10)
        crosses = Signal()
        m.d.comb += [
            following.eq(used + self._length),
            crosses.eq(self._emits & (following[4] != used[4])),
            self.full.eq(self._emits & (following[4:] >= _FULL // 16)),
            self.ends.eq(self.full | self.closing & crosses & used[4]),
        ]
        with m.If(self._emits):
            m.d.sync += used.eq(following)
        with m.If(self.first):
            m.d.sync += self.open.eq(1)
        with m.If(self.ends | self.restart):
            m.d.sync += [used.eq(_HEAD_BITS), self.open.eq(0)]

        # The code in its place, in two clocks.
        code, shift = Signal(10), Signal(5)
        place, crossed, first, full, last = (
            Signal(6), Signal(), Signal(), Signal(), Signal())
        m.d.sync += [
            code.eq(Mux(self._emits & ~self.closing, Cat(1, self._rest), 0)),
            shift.eq(used[:4] + self._zeros),
            place.eq(used[4:]), crossed.eq(crosses), first.eq(self.first), full.eq(self.full),
            last.eq(self.ends | self.restart),
        ]
        shifted = code
        for n in range(5):
            shifted = Mux(shift[n], shifted << (1 << n), shifted)
        half, upper = Signal(31), Signal()
        crossing, fills = Signal(), Signal()
        m.d.sync += [
            half.eq(shifted), upper.eq(place[0]), crossing.eq(crossed), self._begins.eq(first),
            fills.eq(full), self.last.eq(last), self.word.eq(Mux(first, 0, place[1:])),
            self.write.eq(first | full | crossed & place[0]),
        ]
        # Half words: one that grows, and the lower one of a word whose upper half grows.
        growing, lower = Signal(16), Signal(16, reset_less=True)
        bits = Signal(32)
        m.d.comb += [
            bits.eq(half | growing),
            self.data.eq(Mux(self._begins, self.head, Mux(fills, bits, Cat(lower, bits[:16])))),
        ]
        m.d.sync += growing.eq(Mux(crossing, bits[16:], bits[:16]))
        with m.If(crossing & ~upper):
            m.d.sync += lower.eq(bits[:16])
        with m.If(self.last):
            m.d.sync += growing.eq(0)
