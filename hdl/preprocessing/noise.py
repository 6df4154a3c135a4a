"""Noise of a frame from its pixels below the local mean, and the levels that follow from it."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import CONTRAST_FRACTION_BITS, NOISE_BITS, ContrastPixel
from ..ports import register_ports
from ..protocol import SENSOR_PIXELS

__all__ = ["Noise"]

_LEVEL_BITS = 8 + CONTRAST_FRACTION_BITS
_DENT_BITS = 10
_LEAST_NOISE = 8  # in eighths of a grey value, a power of two
_DEPTH_BITS = 11  # of a difference below zero, in eighths of a grey value
#: Pixels that follow those that teach the noise, at least: as many as it takes clocks to find root
#: and products.
_FOLLOWING_PIXELS = 48
_GAIN_BITS = 6


def _learning_rows(width, height):
    """First row and number of rows that teach the noise, and the logarithm of their samples."""
    following = -(-_FOLLOWING_PIXELS // width)
    samples = width // 2
    bits = (samples * (height - 2 * following + 1)).bit_length() - 1
    rows = round((1 << bits) / samples)
    return (height - rows) // 2, rows, bits


class Noise(wiring.Component):
    """Learns the levels for the next frame from the pixels that lie below their local mean.

    Spots and highlights stand above their surroundings, never below; so the root mean square of
    the differences below zero is the noise of what is no spot. Each level is a multiple of it.
    With ``fixed_noise`` the levels are the same multiples of that, and valid before any frame.

    The sum of squares takes the odd columns of the rows in the middle of the frame, as many as make
    their samples as nearly as possible a power of two and leave 48 pixels behind them. Then the
    multiplier that squared the pixels finds the root bit by bit, and multiplies it by each gain.
    New levels are there with the pixel after the frame's last one. A ``broken`` frame teaches
    nothing.

    Only listens: a pixel counts in the clock in which ``i.valid`` is high.

    Parameters
    ----------
    width, height : :class:`int`
        Pixels of a row, 16 to 1024, and rows of a frame, 8 to 1024.

    Members
    -------
    i : :py:`In(stream.Signature(ContrastPixel, always_ready=True))`
        Pixels as they pass.
    lit_gain, core_gain, dent_gain : :py:`In(6)`
        Multiples of the noise, unsigned Q2.4.
    fixed_noise : :py:`In(9)`
        Noise to take instead of the learnt one, in eighths of a grey value; 0 to learn it. These
        four may change while no frame passes.
    lit, core : :py:`Out(12)`
        Least difference of lit and of core pixels, unsigned Q8.4.
    dent : :py:`Out(10)`
        Depth of a dent, unsigned Q8.2; 0: there are none.
    valid : :py:`Out(1)`
        There are levels: a frame has been seen, or the noise is fixed.
    grey_noise : :py:`Out(9)`
        What the levels are multiples of: the noise of the last whole frame, or the fixed one.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the last pixel that teaches the noise to the last level, at most.
    """

    latency = 28

    registers = register_ports("fixed_noise", "lit_gain", "core_gain", "dent_gain")

    def __init__(self, width, height):
        for name, size, least in (("width", width, 16), ("height", height, 8)):
            if not isinstance(size, int) or not least <= size <= SENSOR_PIXELS[1]:
                raise ValueError(
                    f"Frame {name} must be an integer from {least} to {SENSOR_PIXELS[1]}, "
                    f"not {size!r}")
        self.width, self.height = width, height
        super().__init__({
            "i": In(stream.Signature(ContrastPixel, always_ready=True)),
            **self.registers,
            "lit": Out(_LEVEL_BITS), "core": Out(_LEVEL_BITS), "dent": Out(_DENT_BITS),
            "valid": Out(1),
            "grey_noise": Out(NOISE_BITS),
        })

    def elaborate(self, platform):
        m = Module()
        first, rows, self._sample_bits = _learning_rows(self.width, self.height)
        self._frame_end, self._between = Signal(), Signal(init=1)
        self._fixed, self._ends = Signal(), Signal()
        m.d.comb += [
            self._frame_end.eq(self.i.valid & self.i.p.marker.frame_end),
            self._fixed.eq(self.fixed_noise.any()),
        ]
        with m.If(self.i.valid):
            m.d.sync += self._between.eq(self._frame_end)
        begins, samples = self._band(m, first, first + rows - 1)
        self._course(m)
        product = self._square(m, begins, samples)
        self._levels(m, product)
        return m

    def _band(self, m, first, last):
        """Whether the rows begin that teach the noise, and whether this pixel is one that does."""
        row, odd, inside = Signal(range(self.height)), Signal(), Signal()
        line_end, begins, samples, turns = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [
            line_end.eq(self.i.valid & self.i.p.marker.line_end),
            turns.eq(line_end & (row == Mux(inside, last, first - 1))),
            begins.eq(turns & ~inside),
            self._ends.eq(turns & inside),
            samples.eq(self.i.valid & inside & odd & ~self._frame_end),
        ]
        with m.If(self.i.valid):
            m.d.sync += odd.eq(~odd & ~self.i.p.marker.line_end)
        with m.If(line_end):
            m.d.sync += row.eq(row + 1)
        with m.If(begins):
            m.d.sync += inside.eq(1)
        with m.If(self._ends | self._frame_end):
            m.d.sync += inside.eq(0)
        with m.If(self._frame_end):
            m.d.sync += row.eq(0)
        return begins, samples

    def _course(self, m):
        """Steps of two clocks: the sum settles, a bit of the root after the other, the levels."""
        self._busy, self._second = Signal(), Signal()
        self._settles, self._bit = Signal(), Signal(NOISE_BITS)
        self._level = Signal(3)  # lit, core, dent
        starts = Signal()
        m.d.comb += starts.eq(~self._busy & (self._ends | self._fixed & self._between))
        with m.If(starts):
            m.d.sync += [self._busy.eq(1), self._settles.eq(1)]
        with m.If(self._busy):
            m.d.sync += self._second.eq(~self._second)
        with m.If(self._second):
            m.d.sync += [
                self._settles.eq(0), self._bit.eq(Cat(self._bit[1:], self._settles)),
                self._level.eq(Cat(self._bit[0], self._level)),
            ]
            with m.If(self._level[2]):
                m.d.sync += self._busy.eq(0)

    def _square(self, m, begins, samples):
        """Sum of the squares below zero, and the root of their mean, with one multiplier.

        Returns the product of root and gain. The sum is two halves that take turns at one adder:
        the lower one with a square, then the upper one with the carry.
        """
        half = max(2 * _DEPTH_BITS, _DEPTH_BITS + self._sample_bits // 2 + 1)
        depth, factor = Signal(_DEPTH_BITS), Signal(_DEPTH_BITS)
        product = Signal(2 * _DEPTH_BITS)
        adds, carries, carry = Signal(), Signal(), Signal()
        low, high, added = Signal(half), Signal(half), Signal(half + 2)
        root = Signal(NOISE_BITS)
        m.d.comb += [
            product.eq(depth * factor),
            added.eq(Cat(C(1, 1), low) + Cat(carry, Mux(adds, product, 0))),
        ]
        m.d.sync += [
            depth.eq(Mux(self._busy, root | self._bit, ~self.i.p.difference[1:-1])),
            adds.eq(samples & self.i.p.difference[-1]), carries.eq(adds),
        ]
        with m.If(adds | carries):
            m.d.sync += [high.eq(added[1:]), low.eq(high), carry.eq(added[-1] & adds)]
        with m.If(begins):
            m.d.sync += [high.eq(0), low.eq(0)]

        # The root: the largest number whose square is not more than the mean.
        mean, fits, keeps = Signal(2 * half), Signal(), Signal()
        m.d.comb += [
            mean.eq(Cat(low, high) >> self._sample_bits - 1),
            fits.eq((product[:2 * NOISE_BITS] <= mean[:2 * NOISE_BITS])
                    | mean[2 * NOISE_BITS:].any()),
            keeps.eq(Mux(self._fixed, (self.fixed_noise & self._bit).any(),
                         fits | (self._bit[_LEAST_NOISE.bit_length() - 1] & ~root.any()))),
        ]
        with m.If(self._settles):
            m.d.sync += root.eq(0)
        with m.Elif(self._second & keeps & ~self._level.any()):
            m.d.sync += root.eq(depth)

        # In two tables a bit: where `chosen[1]` is high, `between` hands `chosen[0]` on.
        chosen = Signal(2)
        m.d.comb += chosen.eq(Cat(self._level[0] | self._level[2],
                                  self._level[1] | self._level[2]))
        for bit in range(_DEPTH_BITS):
            if bit < _GAIN_BITS:
                between = Mux(chosen[1], chosen[0],
                              Mux(chosen[0], self.lit_gain[bit], depth[bit]))
                m.d.comb += factor[bit].eq(Mux(
                    chosen[1], Mux(between, self.dent_gain[bit], self.core_gain[bit]), between))
            else:  # the root has no more bits
                m.d.comb += factor[bit].eq(
                    depth[bit] & ~chosen.any() if bit < NOISE_BITS else depth[bit])
        self._root = root
        return product

    def _levels(self, m, product):
        """Levels of the next frame, which act from the frame's end on."""
        new_levels = Signal(_LEVEL_BITS), Signal(_LEVEL_BITS), Signal(_DENT_BITS)
        new_noise = Signal(NOISE_BITS)
        learnt, apply = Signal(), Signal()
        for level, chosen, shift in zip(new_levels, self._level, (3, 3, 5), strict=True):
            with m.If(self._second & chosen):
                m.d.sync += level.eq(product >> shift)
        with m.If(self._level[0]):
            m.d.sync += new_noise.eq(self._root)
        # A whole frame's products are there before its end, see the class.
        m.d.comb += [
            apply.eq(Mux(self._fixed, self._between,
                         self._frame_end & ~self.i.p.marker.broken)),
            self.valid.eq(learnt | self._fixed),
        ]
        with m.If(apply):
            m.d.sync += [
                learnt.eq(~self._fixed), self.grey_noise.eq(new_noise),
                *(level.eq(new) for level, new in zip(
                    (self.lit, self.core, self.dent), new_levels, strict=True))]
