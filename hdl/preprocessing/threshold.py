"""Threshold from a histogram."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

__all__ = ["BIN_BITS", "CLEAR_CLOCKS", "Threshold", "counted_rows"]

#: Bits of a bin.
BIN_BITS = 17
#: Clocks in which the bins are cleared.
CLEAR_CLOCKS = 260
_LATENCY = 832
_SIGNIFICANT = 64  # a mode's smoothed peak holds more than one pixel in so many


def counted_rows(width, height, whole=False):
    """First row of a frame that is counted, and the first one after: as many as no bin overflows.

    Unless the ``whole`` frame counts, the bins take the time of its first rows to be cleared and
    of its last rows to be read.

    Raises
    ------
    ValueError
        If the size is out of range, or no row is left.
    """
    for name, value in (("width", width), ("height", height)):
        if not isinstance(value, int) or not 1 <= value <= 512:
            raise ValueError(f"Frame {name} must be an integer from 1 to 512, not {value!r}")
    first, stop = 0, height
    if not whole:
        first, stop = -(-CLEAR_CLOCKS // width), height - -(-_LATENCY // width)
    if stop <= first:
        raise ValueError(f"A frame of {width} x {height} pixels is too small to learn a "
                         f"threshold from: it must have more than {first + height - stop} rows")
    spare = max(0, stop - first - (2**BIN_BITS - 1) // width)
    return first + spare // 2, stop - (spare + 1) // 2


class Threshold(wiring.Component):
    """T = mean + alpha sigma of the background, of the frame before or of a whole frame.

    Reads the bins twice once a frame's histogram is closed: from black to find the first mode,
    then from its peak outwards, up and down, to sum it. T = 1 + peak + sum / pixels by counting
    subtractions; the definitions are those of ``model/preprocessing/threshold.py`` (the paper's
    Section VI).

    ``known`` rises when the result is ready, and the result takes effect with ``done``, so that it
    is valid for the next frame's first pixel. After ``lost`` the old one stays: a lost frame does
    not spoil the next one.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    whole : :class:`bool`
        The histogram is that of a whole frame, which waits for its own level: ``done`` is then
        driven by ``known``.

    Members
    -------
    closed, done, lost, address, count
        From and to :class:`hdl.preprocessing.histogram.Histogram`.
    threshold_alpha : :py:`In(8)`
        Standard deviations, unsigned Q4.4.
    fixed : :py:`In(1)`
        Use ``fixed_level`` instead.
    fixed_level : :py:`In(8)`
        Level to be used then.
    known : :py:`Out(1)`
        The result is there, until ``done`` or ``lost``.
    level : :py:`Out(8)`
        Smallest grey value that is lit.
    threshold_valid : :py:`Out(1)`
        Low until a threshold is known.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``closed`` to ``known``, at most: two scans and a division.
    """

    latency = _LATENCY

    def __init__(self, width, height, whole=False):
        first, stop = counted_rows(width, height, whole)
        self.pixels = (stop - first) * width
        super().__init__({
            "closed": In(1),
            "done": In(1),
            "lost": In(1),
            "address": Out(8),
            "count": In(BIN_BITS),
            "threshold_alpha": In(8),
            "fixed": In(1),
            "fixed_level": In(8),
            "known": Out(1),
            "level": Out(8),
            "threshold_valid": Out(1),
        })

    def elaborate(self, platform):
        m = Module()

        # The state, one bit each, and `start`, from which a scan goes. Everything that selects an
        # operand comes straight from a register: what is decided late only enables.
        idle, start = Signal(init=1), Signal(init=1)
        finding, summing, dividing, known = Signal(), Signal(), Signal(), self.known
        down = Signal()

        # A scan reads the bins one after the other, up or down, from `position`; `age` counts the
        # clocks since it began, as ones. Bins 0 and 255 are no part of a mode and count as empty.
        # Three clocks after its address, `value` and `smooth` (by 1 2 1) of the bin `number` are
        # valid. A scan's first bin is smoothed wrongly, and not judged by it.
        position = Signal(8)
        at, came, passed, number = Signal(8), Signal(8), Signal(8), Signal(8)
        empty, edge_next, edge = Signal(), Signal(), Signal()
        age = Signal(4)
        middle, value = Signal(BIN_BITS), Signal(BIN_BITS)
        pair, pair_before = Signal(BIN_BITS + 1), Signal(BIN_BITS + 1)
        smooth = Signal(BIN_BITS + 2)
        m.d.comb += [
            self.address.eq(at),
            pair.eq(middle + Mux(empty, 0, self.count)),
        ]
        m.d.sync += [
            # One adder gives position, at + 1 or at - 1; its lowest bit brings the carry in.
            at.eq((Cat(C(1, 1), Mux(start, position, at))
                   + Cat(~start & ~down, (~start & down).replicate(8)))[1:]),
            came.eq(at),
            passed.eq(came),
            number.eq(passed),
            empty.eq((at == 0) | (at == 255)),
            edge_next.eq(empty),
            edge.eq(edge_next),
            middle.eq(Mux(empty, 0, self.count)),
            value.eq(middle),
            pair_before.eq(pair),
            smooth.eq(pair_before + pair),
            age.eq(Mux(start, 0, Cat(C(1, 1), age[:-1]))),
        ]
        here, first = Signal(), Signal()  # a bin; the scan's first one
        m.d.comb += [here.eq(age[2] & ~start), first.eq(~age[3])]

        # The first mode is looked for from where half of the pixels are at or below a bin.
        # Without one the image is black, and any number of pixels makes T 1; or white, and none
        # makes T 255.
        pixels = Signal(BIN_BITS)
        half, found = Signal(), Signal()
        peak = Signal(BIN_BITS + 2)
        brighter, faint = Signal(), Signal()
        higher, searched = Signal(), Signal()
        m.d.comb += [
            brighter.eq(smooth > peak),
            faint.eq((smooth << 2) < peak),
            higher.eq(finding & here & half & brighter & ~edge),
            searched.eq(finding & here & ((found & faint) | edge_next)),
        ]
        m.d.sync += half.eq(pixels >= (self.pixels + 1) // 2)
        with m.If(idle):
            m.d.sync += [peak.eq(self.pixels // _SIGNIFICANT), found.eq(0)]
        with m.Elif(higher):
            m.d.sync += [peak.eq(smooth), found.eq(1)]

        # The mode's sum. Every bin weighs 3/2 alpha more than its neighbour towards the peak, for
        # the deviation, and 1 more or less, for the mean's distance from the peak.
        accepts, summed, adding = Signal(), Signal(), Signal()
        gain = Signal(signed(11))  # Q4.4
        weight = Signal(signed(18))
        product = Signal(signed(35))
        m.d.comb += [
            accepts.eq(summing & here & (first | ~(faint | edge))),
            summed.eq(summing & here & ~first & (faint | edge)),
        ]
        m.d.sync += [
            gain.eq(self.threshold_alpha + (self.threshold_alpha >> 1) + Mux(down, -16, 16)),
            product.eq(weight * value),
            adding.eq(accepts),
        ]
        with m.If(start):
            m.d.sync += weight.eq(0)
        with m.Elif(accepts):
            m.d.sync += weight.eq(weight + gain)
        with m.If(idle | (searched & (found | ~half))):
            m.d.sync += pixels.eq(0)
        with m.Elif((finding & age[0]) | (accepts & ~(first & down))):
            m.d.sync += pixels.eq(pixels + Mux(finding, self.count, value))

        # One adder sums, and then takes off 16 times the pixels until nothing is left; its lowest
        # bit carries in. The last step takes the sum below zero: it is the one in T's formula.
        total = Signal(signed(35))
        addend = Signal(35)
        divided, divides = Signal(), Signal()
        m.d.comb += [
            addend.eq(Mux(dividing, ~Cat(C(0, 4), pixels, C(0, 14)), product)),
            divides.eq(dividing & ~(divided & total[-1]) & (position != 255)),
        ]
        m.d.sync += divided.eq(dividing)
        with m.If(finding):
            m.d.sync += total.eq(0)
        with m.Elif(adding | divides):
            m.d.sync += total.eq((Cat(C(1, 1), total) + Cat(dividing, addend))[1:])
        with m.If(idle):
            m.d.sync += position.eq(0)
        with m.Elif(higher | divides):
            m.d.sync += position.eq((Cat(C(1, 1), Mux(dividing, position, number))
                                  + Cat(dividing, C(0, 8)))[1:])

        level_valid = Signal()
        level = Signal(8)
        m.d.comb += [
            self.level.eq(Mux(self.fixed, self.fixed_level, level)),
            self.threshold_valid.eq(self.fixed | level_valid),
        ]
        with m.If(known & self.done):
            m.d.sync += [level.eq(position), level_valid.eq(1)]

        # The end of the frame ends every state.
        m.d.sync += start.eq(searched | summed | (idle & ~self.closed))
        with m.If(idle):
            m.d.sync += [idle.eq(~self.closed), finding.eq(self.closed), down.eq(0)]
        with m.If(searched):
            m.d.sync += [finding.eq(0), summing.eq(found), dividing.eq(~found)]
        with m.If(summed):
            m.d.sync += [down.eq(1), summing.eq(~down), dividing.eq(down)]
        with m.If(dividing & ~divides):
            m.d.sync += [dividing.eq(0), known.eq(1)]
        with m.If(self.done | self.lost):
            m.d.sync += [
                idle.eq(1), start.eq(1),
                finding.eq(0), summing.eq(0), dividing.eq(0), known.eq(0),
            ]

        return m
