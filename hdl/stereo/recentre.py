"""Centres in a corrected image to undistorted places."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import COORDINATE_BITS, Centre, Undistorted

__all__ = ["Recentre"]


class Recentre(wiring.Component):
    """Takes centres in an image that has been corrected as a whole for undistorted places.

    x and y count from the image centre. A spot whose place leaves +-256 px is rejected; that
    happens only while the table of reciprocals is wrong. A spot leaves one clock after it came;
    one a clock is kept up while ``o`` is ready.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels, 16 to 512 each.

    Members
    -------
    i : :py:`In(stream.Signature(Centre))`
        Spots and end marks.
    o : :py:`Out(stream.Signature(Undistorted))`
        The same, in the same order.
    """

    latency = 1

    def __init__(self, width, height):
        for name, value in [("width", width), ("height", height)]:
            if not isinstance(value, int) or not 16 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 16 to 512, not {value!r}")
        self.width, self.height = width, height
        super().__init__({
            "i": In(stream.Signature(Centre)),
            "o": Out(stream.Signature(Undistorted)),
        })

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p
        undistorted = Signal(Undistorted)
        outside = Signal(2)
        for bit, (centre, size, place) in enumerate((
                (spot.u, self.width, undistorted.x), (spot.v, self.height, undistorted.y))):
            wide = Signal(signed(COORDINATE_BITS + 1), name=f"wide_{bit}")
            m.d.comb += [
                wide.eq(centre - (size - 1) * 256),
                outside[bit].eq(wide[-1] ^ wide[-2]),
                place.eq(Mux(spot.end, 0, wide[:COORDINATE_BITS].as_signed())),
            ]
        m.d.comb += [
            undistorted.end.eq(spot.end),
            undistorted.rejected.eq(spot.rejected | (outside.any() & ~spot.end)),
            undistorted.area.eq(spot.area),
            undistorted.u.eq(spot.u),
            undistorted.v.eq(spot.v),
            self.i.ready.eq(~self.o.valid | self.o.ready),
        ]
        with m.If(self.i.ready):
            m.d.sync += [self.o.valid.eq(self.i.valid), self.o.p.eq(undistorted)]
        return m
