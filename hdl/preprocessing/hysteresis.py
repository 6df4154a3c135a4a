"""Lit and core pixels by two levels."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import CONTRAST_FRACTION_BITS, ContrastPixel, MaskPixel

__all__ = ["Hysteresis"]

_LEVEL_BITS = 8 + CONTRAST_FRACTION_BITS


class Hysteresis(wiring.Component):
    """Marks the pixels whose contrast reaches a level, and those that make a spot of a component.

    A pixel is *lit* if its difference reaches ``lit`` and it is no dent. It is *core* if it is lit,
    no ``border`` pixel, and the difference of the smoothed image reaches ``core``. ``excess`` is
    the whole grey values by which a lit pixel exceeds the level; of dark ones it has no meaning.

    A pixel leaves one clock after it came in; one pixel a clock is kept up for as long as
    ``o.ready`` stays high. Levels are sampled with each pixel. What a ``broken`` beat carries is
    dark.

    Members
    -------
    i : :py:`In(stream.Signature(ContrastPixel))`
        Contrasts.
    o : :py:`Out(stream.Signature(MaskPixel))`
        Mask pixels, in the same order.
    lit, core : :py:`In(12)`
        Levels, unsigned Q8.4.
    enable : :py:`In(1)`
        Low while no level is known: every pixel is then dark.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to the same pixel at ``o``.
    """

    latency = 1

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(ContrastPixel)),
            "o": Out(stream.Signature(MaskPixel)),
            "lit": In(_LEVEL_BITS),
            "core": In(_LEVEL_BITS),
            "enable": In(1),
        })

    def elaborate(self, platform):
        m = Module()
        excess = Signal(signed(10 + CONTRAST_FRACTION_BITS))
        lit, core = Signal(), Signal()
        pixel = self.i.p
        m.d.comb += [
            excess.eq(pixel.difference - self.lit),
            lit.eq(self.enable & ~excess[-1] & ~pixel.dent & ~pixel.marker.broken),
            core.eq(lit & (pixel.smooth >= self.core[1:]) & ~pixel.border),
        ]
        with m.If(~self.o.valid | self.o.ready):
            m.d.comb += self.i.ready.eq(1)
            m.d.sync += [
                self.o.valid.eq(self.i.valid),
                self.o.p.lit.eq(lit),
                self.o.p.core.eq(core),
                self.o.p.saturated.eq(lit & pixel.saturated),
                self.o.p.excess.eq(excess[CONTRAST_FRACTION_BITS:12]),
                self.o.p.marker.eq(pixel.marker),
            ]
        return m
