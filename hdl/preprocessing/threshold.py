"""Threshold from a histogram."""

from amaranth import *
from amaranth.lib import enum, wiring
from amaranth.lib.wiring import In, Out

__all__ = ["Threshold"]

_BIN_BITS = 17
_SIGNIFICANT = 64  # a mode's smoothed peak holds at least one pixel in so many


class _State(enum.Enum):
    IDLE = 0
    FIND = 1  # the first mode
    FOUND = 2
    SUM = 3  # over the mode
    DIVIDE = 4
    KNOWN = 5


class Threshold(wiring.Component):
    """T = mean + alpha sigma of the background, learnt on the frame before.

    Reads the bins twice once a frame's histogram is closed: from black to find the first mode,
    then from its peak outwards, up and down, to sum it. T = 1 + peak + sum / count by counting
    subtractions; the definitions are those of ``model/preprocessing/threshold.py`` (the paper's
    Section VI, equation 5).

    The result is ready :attr:`latency` clocks after ``closed`` at the latest, and comes into force
    with ``done``, so that the next frame's first pixel meets it. After ``lost`` the old one stays:
    a lost frame does not cost the next one.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    closed, done, lost, address, count
        From and to :class:`hdl.preprocessing.histogram.Histogram`.
    alpha : :py:`In(8)`
        Standard deviations, unsigned Q4.4.
    fixed : :py:`In(1)`
        Use ``fixed_level`` instead.
    fixed_level : :py:`In(8)`
        Level to be used then.
    level : :py:`Out(8)`
        Smallest grey value that is lit.
    learnt : :py:`Out(1)`
        Low until a level is known.
    """

    #: Clocks from ``closed`` to the result at most: two scans and a division.
    latency = 832

    def __init__(self, width, height):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 1 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 1 to 512, not {value!r}")
        first = -(-260 // width)
        stop = height - -(-self.latency // width)
        self.pixels = max(0, stop - first) * width
        super().__init__({
            "closed": In(1),
            "done": In(1),
            "lost": In(1),
            "address": Out(8),
            "count": In(_BIN_BITS),
            "alpha": In(8),
            "fixed": In(1),
            "fixed_level": In(8),
            "level": Out(8),
            "learnt": Out(1),
        })

    def elaborate(self, platform):
        m = Module()

        # A scan brings the bins in one after the other, up or down; of three that follow each
        # other the middle one is smoothed. Black and white are not part of any mode.
        at = Signal(8)  # bin whose count is asked for
        came = Signal(8)  # bin whose count is here
        down = Signal()
        age = Signal(4)  # clocks since the scan began, as ones
        count = Signal(_BIN_BITS)
        old, middle, value = Signal(_BIN_BITS), Signal(_BIN_BITS), Signal(_BIN_BITS)
        smooth = Signal(_BIN_BITS + 2)
        middle_number, number = Signal(8), Signal(8)  # bins of `middle`, of `smooth` and `value`
        begin = Signal()
        m.d.comb += [
            self.address.eq(at),
            count.eq(Mux((came == 0) | (came == 255) | ~age[0], 0, self.count)),
        ]
        m.d.sync += [
            at.eq(at + Cat(C(1, 1), down.replicate(7))),
            came.eq(at),
            old.eq(middle),
            middle.eq(count),
            middle_number.eq(came),
            smooth.eq(old + (middle << 1) + count),
            value.eq(middle),
            number.eq(middle_number),
            age.eq(Mux(begin, 0, Cat(C(1, 1), age[:-1]))),
        ]
        # A scan begins with its first bin as `old`'s predecessor: nothing beside it is smoothed.
        with m.If(begin):
            m.d.sync += [old.eq(0), middle.eq(0)]

        peak = Signal(_BIN_BITS + 2)
        place = Signal(8)
        significant, faint = Signal(), Signal()
        gain = Signal(signed(11))  # of a bin's weight over its neighbour's, Q4.4
        scaled = Signal(9)
        weight = Signal(signed(18))
        factor = Signal(_BIN_BITS)
        product = Signal(signed(36))
        total = Signal(signed(36))
        pixels = Signal(19)
        adding = Signal(2)
        dividing, divided = Signal(), Signal()  # a step now, one before
        m.d.comb += [
            significant.eq(peak >= -(-self.pixels // _SIGNIFICANT)),
            faint.eq((smooth << 2) < peak),
            # 3/2 alpha for the deviation; 16 more for the mean's own distance from the peak.
            scaled.eq(self.alpha + (self.alpha >> 1)),
            gain.eq(scaled + Mux(down, -16, 16)),
        ]
        m.d.sync += [
            adding.eq(Cat(C(0, 1), adding[0])),
            factor.eq(value),
            product.eq(weight * factor),
        ]
        # One adder sums, and divides by counting how often 16 times the pixels can be taken off.
        with m.If(adding[1] | dividing):
            m.d.sync += total.eq(total + Mux(dividing, ~Cat(C(0, 4), pixels, C(0, 1)).as_signed(), product) + dividing)

        learnt = Signal()
        level = Signal(8)
        m.d.comb += [
            self.level.eq(Mux(self.fixed, self.fixed_level, level)),
            self.learnt.eq(self.fixed | learnt),
        ]

        state = Signal(_State)
        with m.Switch(state):
            with m.Case(_State.IDLE):
                m.d.sync += [at.eq(0), down.eq(0), peak.eq(0), place.eq(0)]
                with m.If(self.closed):
                    m.d.comb += begin.eq(1)
                    m.d.sync += state.eq(_State.FIND)
            with m.Case(_State.FIND):
                with m.If(age[2]):
                    with m.If(smooth > peak):
                        m.d.sync += [peak.eq(smooth), place.eq(number)]
                    with m.If((number == 254) | (significant & faint)):
                        m.d.sync += state.eq(_State.FOUND)
            with m.Case(_State.FOUND):
                m.d.sync += [at.eq(place), weight.eq(0), total.eq(0), divided.eq(0)]
                with m.If(significant):
                    m.d.comb += begin.eq(1)
                    m.d.sync += state.eq(_State.SUM)
                with m.Else():
                    m.d.sync += [place.eq(1), state.eq(_State.KNOWN)]
            with m.Case(_State.SUM):
                with m.If(age[1] & ~age[2] & ~down):
                    m.d.sync += pixels.eq(middle)
                with m.If(age[3]):
                    with m.If(~faint & (number != 255) & (number != 0)):
                        m.d.sync += [
                            weight.eq(weight + gain),
                            pixels.eq(pixels + value),
                            adding[0].eq(1),
                        ]
                    with m.Elif(~down):
                        m.d.sync += [at.eq(place), weight.eq(0), down.eq(1)]
                        m.d.comb += begin.eq(1)
                    with m.Else():
                        m.d.sync += state.eq(_State.DIVIDE)
            with m.Case(_State.DIVIDE):
                # The last step takes the sum below zero: it stands for the one in T's formula.
                with m.If(~adding.any()):
                    m.d.comb += dividing.eq(1)
                    m.d.sync += [place.eq(place + 1), divided.eq(1)]
                    with m.If(divided & (total < 0) | (place == 255)):
                        m.d.sync += [place.eq(place), state.eq(_State.KNOWN)]
            with m.Case(_State.KNOWN):
                with m.If(self.done):
                    m.d.sync += [level.eq(place), learnt.eq(1)]
        # Whatever the scan has come to, the end of the frame ends it.
        with m.If(self.done | self.lost):
            m.d.sync += state.eq(_State.IDLE)

        return m
