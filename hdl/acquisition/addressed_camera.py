"""An imager with addressed pixels and an external converter, to a stream of pixels."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel
from ..protocol import SENSOR_PIXELS

__all__ = ["AddressedCamera"]

_ABORTED = 1  # the reason of a broken beat, as in `Camera`: bad sync


class AddressedCamera(wiring.Component):
    """Addresses an imager's pixels one by one, has each converted, and streams them.

    ``sensor_read`` begins a frame: rows from top to bottom, each from left to right. A pixel's
    address is held for ``interval`` clocks, and ``convert`` is high in the last of them, when the
    pixel's signal has settled. The converter's ``data`` is sampled ``converter_latency`` clocks
    later, and need be stable in that clock only; several conversions may be under way. A frame
    takes width x height x interval clocks if ``o`` keeps up; if not, the next conversion waits
    until there is room for its pixel, so nothing is ever lost.

    If ``sensor_read`` rises during a frame, that frame ends with a ``broken`` beat, whose ``grey``
    is 1, and the new one follows. Reset discards the frame without a ``broken`` beat.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    converter_latency : :class:`int`
        Clocks from ``convert`` to ``data``, 1 to 64.
    interval : :class:`int`
        Clocks of a pixel, 2 to 64.

    Members
    -------
    sensor_read : :py:`In(1)`
        A rise begins the read-out.
    row, column : :py:`Out`
        Address of a pixel, of as many bits as it needs.
    convert : :py:`Out(1)`
        Conversion strobe.
    data : :py:`In(8)`
        The converter's output.
    o : :py:`Out(stream.Signature(GreyPixel))`
        Pixels.
    sending : :py:`Out(1)`
        High from the beginning of a frame until its last pixel has left.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``convert`` to the pixel at ``o``, which is one more than the converter takes.
    """

    def __init__(self, width, height, converter_latency=4, interval=2):
        for name, value, low, high in (
                ("Frame width", width, 2, SENSOR_PIXELS[1]),
                ("Frame height", height, 2, SENSOR_PIXELS[1]),
                ("The converter's latency", converter_latency, 1, 64),
                ("The clocks of a pixel", interval, 2, 64)):
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(f"{name} must be an integer from {low} to {high}, not {value!r}")
        self.width, self.height = width, height
        self.converter_latency, self.interval = converter_latency, interval
        self.latency = converter_latency + 1
        # Room for all conversions that may be under way, and for a few clocks in the queue, so that
        # a reader that takes every pixel at once never stalls it.
        self.depth = 1 << (converter_latency // interval + 2).bit_length()
        super().__init__({
            "sensor_read": In(1),
            "row": Out(range(height)),
            "column": Out(range(width)),
            "convert": Out(1),
            "data": In(8),
            "o": Out(stream.Signature(GreyPixel)),
            "sending": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        depth = self.depth
        m.submodules.queue = queue = SyncFIFO(width=Shape.cast(GreyPixel).width, depth=depth)
        room = Signal(range(depth + 1), init=depth)

        before, begins = Signal(), Signal()
        m.d.sync += before.eq(self.sensor_read)
        m.d.comb += begins.eq(self.sensor_read & ~before)

        # The address, and what goes into the pipeline beside the converter.
        active = Signal()
        aborted = Signal()  # the broken beat comes first
        phase = Signal(range(self.interval))
        line_end, frame_end = Signal(), Signal()
        asks, breaks = Signal(), Signal()
        last = self.interval - 1
        m.d.comb += [
            line_end.eq(self.column == self.width - 1),
            frame_end.eq(line_end & (self.row == self.height - 1)),
            self.convert.eq(active & ~aborted & (phase == last) & room.any()),
            asks.eq(self.convert),
            breaks.eq(aborted & room.any()),
        ]
        with m.If(phase != last):
            m.d.sync += phase.eq(phase + 1)
        with m.If(asks):
            m.d.sync += [phase.eq(0), self.column.eq(Mux(line_end, 0, self.column + 1))]
            with m.If(line_end):
                m.d.sync += self.row.eq(Mux(frame_end, 0, self.row + 1))
            with m.If(frame_end):
                m.d.sync += active.eq(0)
        with m.If(breaks):
            m.d.sync += aborted.eq(0)
        with m.If(begins):
            m.d.sync += [
                active.eq(1), aborted.eq(active & ~(asks & frame_end)), phase.eq(0),
                self.row.eq(0), self.column.eq(0),
            ]

        # A word beside each conversion; one without is the broken beat.
        words = [Signal(4, name=f"word_{stage}") for stage in range(self.latency)]
        valid, ends_line, ends_frame, broken = words[-1]
        m.d.comb += words[0].eq(Cat(
            asks | breaks, line_end | breaks, frame_end | breaks, breaks))
        m.d.sync += [after.eq(word) for word, after in zip(words, words[1:], strict=False)]
        pixel = Signal(GreyPixel)
        m.d.comb += [
            pixel.grey.eq(Mux(broken, _ABORTED, self.data)),
            pixel.marker.line_end.eq(ends_line),
            pixel.marker.frame_end.eq(ends_frame),
            pixel.marker.broken.eq(broken),
            queue.w_en.eq(valid),
            queue.w_data.eq(pixel),
            self.o.valid.eq(queue.r_rdy),
            self.o.payload.eq(queue.r_data),
            queue.r_en.eq(self.o.ready),
        ]
        takes = Signal()
        m.d.comb += takes.eq(self.o.valid & self.o.ready)
        m.d.sync += room.eq(room + takes - words[0][0])
        m.d.sync += self.sending.eq(active | (room != depth) | begins)
        return m
