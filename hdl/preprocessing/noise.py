"""Noise of a frame from its pixels below the local mean, and the levels that follow from it."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import CONTRAST_FRACTION_BITS, NOISE_BITS, ContrastPixel
from ..ports import register_ports

__all__ = ["Noise"]

_LEVEL_BITS = 8 + CONTRAST_FRACTION_BITS
_DENT_BITS = 10
_LEAST_NOISE = 8  # in eighths of a grey value
_SQUARE_BITS = 2 * NOISE_BITS
#: Pixels that follow those that teach the noise, at least: as many as it takes clocks to find root
#: and products.
_FOLLOWING_PIXELS = 48
_GAIN_BITS = 6


class Noise(wiring.Component):
    """Learns the levels for the next frame from the pixels that lie below their local mean.

    Spots and highlights stand above their surroundings, never below; so the root mean square of
    the differences below zero is the noise of what is no spot. Each level is a multiple of it.
    With ``fixed_noise`` the levels are the same multiples of that, and valid before any frame.

    The sum of squares takes the rows in the middle of the frame, as many as make their pixels as
    nearly as possible a power of two and leave 48 pixels behind them. Then the root is found bit by
    bit, with the multiplier that squared the pixels, and multiplied by each gain, a bit a clock: 44
    clocks in all. New levels are there with the pixel after the frame's last one. A ``broken``
    frame teaches nothing.

    Only listens: a pixel counts in the clock in which ``i.valid`` is high.

    Parameters
    ----------
    width, height : :class:`int`
        Pixels of a row, 16 to 512, and rows of a frame, 8 to 512.

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

    latency = 44

    registers = register_ports("fixed_noise", "lit_gain", "core_gain", "dent_gain")

    def __init__(self, width, height):
        for name, size, least in (("width", width, 16), ("height", height, 8)):
            if not isinstance(size, int) or not least <= size <= 512:
                raise ValueError(
                    f"Frame {name} must be an integer from {least} to 512, not {size!r}")
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
        self._frame_end, self._between = Signal(), Signal(init=1)
        m.d.comb += self._frame_end.eq(self.i.valid & self.i.p.marker.frame_end)
        with m.If(self.i.valid):
            m.d.sync += self._between.eq(self._frame_end)
        self._root_noise(m)
        self._levels(m)
        return m

    def _root_noise(self, m):
        """Sum of the squares of the pixels below zero, and the root of their mean."""
        following = -(-_FOLLOWING_PIXELS // self.width)
        pixel_bits = (self.width * (self.height - 2 * following + 1)).bit_length() - 1
        rows = round((1 << pixel_bits) / self.width)
        row = Signal(range(self.height))
        summing, ends = Signal(), Signal()
        with m.If(self.i.valid & self.i.p.marker.line_end):
            m.d.sync += row.eq(Mux(self._frame_end, 0, row + 1))
        first = (self.height - rows) // 2
        m.d.comb += [
            summing.eq((row >= first) & (row < first + rows)),
            ends.eq(self.i.valid & self.i.p.marker.line_end & (row == first + rows - 1)),
        ]

        below = Signal()
        magnitude, square = Signal(NOISE_BITS), Signal(_SQUARE_BITS)
        total = Signal(pixel_bits + _SQUARE_BITS + 1)  # the rows may hold a few pixels more
        depth = Signal(CONTRAST_FRACTION_BITS + 8)
        m.d.comb += [depth.eq(~self.i.p.difference), square.eq(magnitude * magnitude)]
        m.d.sync += below.eq(self.i.valid & summing & self.i.p.difference[-1])
        with m.If(below):
            m.d.sync += total.eq(total + square)
        with m.If(self._frame_end):
            m.d.sync += total.eq(0)

        # The root: the largest number whose square is not more than the mean, found from its upper
        # bit on.
        mean_square, fits = Signal(_SQUARE_BITS + 2), Signal()
        self._root, bit = Signal(NOISE_BITS), Signal(NOISE_BITS)
        self._rooted = Signal()
        m.d.comb += [
            mean_square.eq(total >> pixel_bits - 1), fits.eq(square <= mean_square)]
        limit = (1 << NOISE_BITS) - 1
        m.d.sync += magnitude.eq(Mux(depth[1 + NOISE_BITS:].any(), limit, depth >> 1))
        with m.FSM():
            with m.State("SUM"), m.If(ends):
                m.next = "SETTLE"
            with m.State("SETTLE"):
                m.d.sync += [self._root.eq(0), bit.eq(1 << NOISE_BITS - 1)]
                m.next = "TRY"
            with m.State("TRY"):
                m.d.sync += magnitude.eq(self._root | bit)
                m.next = "KEEP"
            with m.State("KEEP"):
                m.d.sync += bit.eq(bit >> 1)
                with m.If(fits):
                    m.d.sync += self._root.eq(magnitude)
                m.next = "TRY"
                with m.If(bit[0]):
                    m.next = "DONE"
            with m.State("DONE"):
                m.d.comb += self._rooted.eq(1)
                m.d.sync += self._root.eq(
                    Mux(self._root[3:].any(), self._root, _LEAST_NOISE))
                m.next = "SUM"

    def _levels(self, m):
        """Products of the noise with the three gains, a bit of a gain a clock, the lowest first."""
        applied = Signal(NOISE_BITS)
        product = Signal(NOISE_BITS + _GAIN_BITS)
        gain = Signal(_GAIN_BITS)
        left = Signal(_GAIN_BITS)
        upper = Signal(NOISE_BITS + 1)
        fixed, learnt = Signal(), Signal()
        m.d.comb += [
            fixed.eq(self.fixed_noise.any()),
            applied.eq(Mux(fixed, self.fixed_noise, self._root)),
            upper.eq(product[_GAIN_BITS:] + Mux(gain[0], applied, 0)),
        ]
        new = {name: Signal(shape, name=f"new_{name}") for name, shape in (
            ("lit", _LEVEL_BITS), ("core", _LEVEL_BITS), ("dent", _DENT_BITS))}
        following = {"lit": ("core", self.core_gain), "core": ("dent", self.dent_gain),
                     "dent": ("IDLE", self.lit_gain)}
        with m.FSM():
            with m.State("IDLE"):
                m.d.sync += [product.eq(0), gain.eq(self.lit_gain),
                             left.eq((1 << _GAIN_BITS) - 1)]
                with m.If(self._rooted | (fixed & self._between)):
                    m.next = "lit"
            for name, level in new.items():
                then, gain_of_next = following[name]
                with m.State(name):
                    m.d.sync += [product.eq(Cat(product[1:_GAIN_BITS], upper)),
                                 gain.eq(gain >> 1), left.eq(left >> 1)]
                    with m.If(~left[0]):
                        m.d.sync += [
                            level.eq(product >> (5 if name == "dent" else 3)), product.eq(0),
                            gain.eq(gain_of_next), left.eq((1 << _GAIN_BITS) - 1)]
                        m.next = then

        # A whole frame's products are there before its end, see the class.
        apply = Signal()
        m.d.comb += [
            apply.eq(Mux(fixed, self._between, self._frame_end & ~self.i.p.marker.broken)),
            self.valid.eq(learnt | fixed),
        ]
        with m.If(apply):
            m.d.sync += [learnt.eq(~fixed), self.grey_noise.eq(applied), self.lit.eq(new["lit"]),
                         self.core.eq(new["core"]), self.dent.eq(new["dent"])]
