"""Sums of spots to their centres."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import COORDINATE_BITS, Centre, QueuedSpot

__all__ = ["Centring"]

_SLOPE_BITS = 16


class Centring(wiring.Component):
    """Divides the sums of a spot by its weight: multiplies by a reciprocal from a table.

    The weight is shifted left, a bit a clock, until its bit 17 is set, and the sums with it; the
    shifted weight gives the reciprocal by a table of 256 words and linear interpolation; two
    multipliers serve u and v. The result is within 0.005 px of the quotient, 0.01 px with
    8 fraction bits. The arithmetic and
    the format of the table are those of :func:`model.preprocessing.centre.centres`.

    A spot of weight w is taken ``21 - w.bit_length()`` clocks after the clock in which it became
    valid, or later if ``o`` stalls, and is valid at ``o`` one clock later. So spots follow each
    other every 4 to 21 clocks while ``o`` is ready, and end markers take 4. Reset discards the spot
    under way.

    Paper, section on the spot centres: a product with a coefficient from a table, there indexed
    by the area. Normalising is ours: 18 bits of 1/N would miss 0.01 px.

    Parameters
    ----------
    fraction : :class:`int`
        Fraction bits of the centre: 9, or 8 for columns and rows up to 1,023.

    Members
    -------
    i : :py:`In(stream.Signature(QueuedSpot))`
        Spots and end markers. Weights are 1 to 261,888, sums below 512 times the weight, or 1024.
    o : :py:`Out(stream.Signature(Centre))`
        The same with centres, in the same order.
    table_address : :py:`Out(8)`
        Word of the reciprocal table to be read.
    table_data : :py:`In(36)`
        That word, one clock later.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a spot at ``i`` to its centre at ``o``, at most: those of a spot of weight 1.
    """

    latency = 21

    def __init__(self, fraction=9):
        if fraction not in (8, 9):
            raise ValueError(f"A centre has 8 or 9 fraction bits, not {fraction!r}")
        self.fraction = fraction
        super().__init__({
            "i": In(stream.Signature(QueuedSpot)),
            "o": Out(stream.Signature(Centre)),
            "table_address": Out(8),
            "table_data": In(36),
        })

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p
        value = self.table_data[_SLOPE_BITS:]
        slope = self.table_data[:_SLOPE_BITS]

        # The spot stays at `i` until its centre is known: only what is shifted has registers. An
        # end marker's sums are zero, and so is what comes of them; its weight becomes 2**17.
        weight = Signal(18)
        below = 9 - self.fraction  # bits of the sums that make no difference
        sums = [Signal(27 + below, name=f"sum_{axis}") for axis in "uv"]
        m.d.comb += self.table_address.eq(weight[9:17])

        # The first multiplier also interpolates.
        interpolate = Signal()
        complement = Signal(17)
        factor = Signal(17)
        products = []
        for axis, total in zip("uv", (total[below:] for total in sums), strict=True):
            operand = Signal(17, name=f"operand_{axis}")
            product = Signal(34, name=f"product_{axis}")
            m.d.comb += [
                operand.eq(Mux(interpolate, slope, total[10:]) if axis == "u" else total[10:]),
                # Signed operands of 18 bits are what the multipliers are made of.
                product.eq(Cat(operand, C(0, 1)).as_signed()
                           * Cat(factor if axis == "u" else complement, C(0, 1)).as_signed()),
            ]
            products.append(product)
        interpolated = Signal(20)
        m.d.comb += [
            factor.eq(Mux(interpolate, weight[:9], complement)),
            interpolated.eq(value + products[0][11:]),
        ]

        result = []
        for axis, total, product in zip(
                "uv", (total[below:] for total in sums), products, strict=True):
            # The two bits below the operand, in half LSBs, and what rounds.
            low = Signal(3, name=f"low_{axis}")
            m.d.comb += low.eq(1 + Mux(total[9], Mux(weight[16], 2, 3), 0)
                               + Mux(total[8], Mux(weight[16], 1, 2), 0))
            half = Signal(COORDINATE_BITS + 1, name=f"half_{axis}")
            m.d.comb += half.eq(Cat(low, total[10:]) - product[15:])
            result.append(half[1:])

        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.FSM():
            with m.State("LOAD"):
                m.d.sync += [
                    weight.eq(spot.weight | spot.end << 17),
                    sums[0].eq(spot.sum_u), sums[1].eq(spot.sum_v),
                ]
                with m.If(self.i.valid):
                    m.next = "SHIFT"
            with m.State("SHIFT"):
                with m.If(weight[17]):
                    m.next = "INTERPOLATE"
                with m.Else():
                    m.d.sync += [
                        weight.eq(weight << 1),
                        *(total.eq(total << 1) for total in sums),
                    ]
            with m.State("INTERPOLATE"):
                m.d.comb += interpolate.eq(1)
                m.d.sync += complement.eq(interpolated[3:])
                m.next = "MULTIPLY"
            with m.State("MULTIPLY"), m.If(~self.o.valid | self.o.ready):
                m.d.comb += self.i.ready.eq(1)
                m.d.sync += [
                    self.o.valid.eq(1),
                    self.o.p.end.eq(spot.end),
                    self.o.p.rejected.eq(spot.rejected),
                    self.o.p.area.eq(spot.area),
                    self.o.p.saturated.eq(spot.saturated),
                    self.o.p.border.eq(spot.border),
                    self.o.p.u.eq(result[0]),
                    self.o.p.v.eq(result[1]),
                ]
                m.next = "LOAD"

        return m
