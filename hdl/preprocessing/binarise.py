"""Grey pixels to mask pixels."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel, MaskPixel

__all__ = ["Binarise"]


class Binarise(wiring.Component):
    """Marks each pixel at or above a level as lit.

    One pixel a clock as long as ``o.ready`` stays high. ``level`` and ``enable`` are sampled with
    each pixel. A ``broken`` beat is dark.

    Parameters
    ----------
    pixel_bits : :class:`int`
        Bits of a grey value; 8 for the streams of this design.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Grey pixels, in raster order.
    o : :py:`Out(stream.Signature(MaskPixel))`
        Mask pixels, in the same order; ``core`` is ``lit``.
    level : :py:`In(pixel_bits)`
        Smallest grey value that counts as lit.
    enable : :py:`In(1)`
        Low while no level is known: every pixel is then dark.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to the same at ``o``.
    """

    latency = 1

    def __init__(self, pixel_bits=8):
        if pixel_bits != 8:
            raise ValueError(f"Pixel bits must be 8, not {pixel_bits!r}")
        self.pixel_bits = pixel_bits
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "o": Out(stream.Signature(MaskPixel)),
            "level": In(pixel_bits),
            "enable": In(1),
        })

    def elaborate(self, platform):
        m = Module()

        # One subtraction compares and gives the excess.
        excess = Signal(signed(self.pixel_bits + 1))
        lit = Signal()
        m.d.comb += [
            excess.eq(self.i.p.grey - self.level),
            lit.eq(self.enable & ~excess[-1] & ~self.i.p.marker.broken),
        ]

        # The output register is free when it is empty or being emptied.
        with m.If(~self.o.valid | self.o.ready):
            m.d.comb += self.i.ready.eq(1)
            m.d.sync += [
                self.o.valid.eq(self.i.valid),
                self.o.p.lit.eq(lit),
                self.o.p.core.eq(lit),
                self.o.p.excess.eq(Mux(lit, excess[:-1], 0)),
                self.o.p.marker.eq(self.i.p.marker),
            ]

        return m
