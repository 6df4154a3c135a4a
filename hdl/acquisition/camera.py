"""A parallel camera port to a stream of pixels."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import AsyncFIFO
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel
from ..protocol import SENSOR_PIXELS

__all__ = ["Camera"]

_QUEUE = 16
_BAD_SYNC, _OVERRUN = 1, 2


class Camera(wiring.Component):
    """Receives frames at an imager's pins and brings them into the system's clock.

    A frame begins when ``frame_valid`` rises; each pixel clock with ``line_valid`` high brings a
    pixel. ``line_valid`` may fall between lines for any time, or not at all; ``frame_valid`` must
    be low for a pixel clock or more between frames. The output is frames of exactly ``width`` x
    ``height`` pixels, or the beginning of one that ends with a ``broken`` beat:

    - a line is short or long (``line_valid`` falls elsewhere than at a line's end), or the frame
      is short (``frame_valid`` falls before its last pixel): bad sync;
    - pixels come after the frame's last one: bad sync, but the frame itself is good, and the
      ``broken`` beat follows it;
    - the queue between the clocks is full: overrun. It lasts until there is room for the
      ``broken`` beat, and counts once; frames that begin before that leave no trace.

    After that the camera waits for the beginning of the next frame, as it does after reset. So a
    ``broken`` beat may come without any pixel before it. The queue holds 16 pixels: the reader may
    fall behind the imager by no more than that.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        The imager's pins, sampled at the rising edge of the domain ``pixel``.
    o : :py:`Out(stream.Signature(GreyPixel))`
        Pixels. The ``grey`` of a ``broken`` beat gives the reason: bit 0 bad sync, bit 1 overrun;
        its other bits mean nothing.
    bad_sync, overrun : :py:`Out(8)`
        How often, since reset; they stop at 255.

    Attributes
    ----------
    latency : :class:`int`
        Clocks of ``sync``, and one of ``pixel``, from a pixel at the pins to the same at ``o``, at
        most.
    """

    latency = 3

    def __init__(self, width, height):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 2 <= value <= SENSOR_PIXELS[1]:
                raise ValueError(
                    f"Frame {name} must be an integer from 2 to {SENSOR_PIXELS[1]}, not {value!r}")
        self.width, self.height = width, height
        super().__init__({
            "frame_valid": In(1),
            "line_valid": In(1),
            "data": In(8),
            "o": Out(stream.Signature(GreyPixel)),
            "bad_sync": Out(8),
            "overrun": Out(8),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = AsyncFIFO(
            width=Shape.cast(GreyPixel).width, depth=_QUEUE, w_domain="pixel", r_domain="sync")

        # The pins, and their values a clock before. Out of reset, a frame seems to be under way:
        # one that has already begun must not count as a new one.
        frame, line, grey = Signal(init=1), Signal(), Signal(8)
        frame_before, line_before = Signal(init=1), Signal()
        m.d.pixel += [
            frame.eq(self.frame_valid), line.eq(self.line_valid), grey.eq(self.data),
            frame_before.eq(frame), line_before.eq(line & frame),
        ]

        inside = Signal()  # in a frame whose last pixel has not come
        over = Signal()  # its last pixel has come; nothing may follow
        column = Signal(range(self.width))
        row = Signal(range(self.height))
        begins, takes, line_end, frame_end = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [
            begins.eq(frame & ~frame_before),
            takes.eq(frame & line & (inside | begins)),
            line_end.eq(column == self.width - 1),
            frame_end.eq(line_end & (row == self.height - 1)),
        ]

        # Bad sync is reported at once, as no pixel comes with it. An overrun waits until the queue
        # has room again, and the frames until then are lost too.
        overrun_pending = Signal()
        out_of_sync, overrun = Signal(), Signal()
        breaks = Signal()
        word = Signal(GreyPixel)
        m.d.comb += [
            out_of_sync.eq(over & ~begins & frame & line
                           | inside & (~frame | (line_before & ~line & (column != 0)))),
            overrun.eq(takes & (overrun_pending | ~queue.w_rdy) | out_of_sync & ~queue.w_rdy),
            breaks.eq(out_of_sync | overrun_pending),
            word.grey.eq(grey),
            word.marker.line_end.eq(line_end | breaks),
            word.marker.frame_end.eq(frame_end | breaks),
            word.marker.broken.eq(breaks),
            queue.w_data.eq(word),
            queue.w_en.eq(takes | breaks),
        ]
        with m.If(breaks):
            m.d.comb += word.grey[:2].eq(Mux(overrun_pending, _OVERRUN, _BAD_SYNC))

        with m.If(begins):
            m.d.pixel += [inside.eq(1), over.eq(0)]
        with m.If(takes & frame_end):
            m.d.pixel += [inside.eq(0), over.eq(1)]
        with m.If(out_of_sync | overrun):
            m.d.pixel += [inside.eq(0), over.eq(0)]
        with m.If(out_of_sync | overrun | (takes & line_end)):
            m.d.pixel += column.eq(0)
        with m.Elif(takes):
            m.d.pixel += column.eq(column + 1)
        with m.If(out_of_sync | overrun | (takes & frame_end)):
            m.d.pixel += row.eq(0)
        with m.Elif(takes & line_end):
            m.d.pixel += row.eq(row + 1)
        with m.If(overrun):
            m.d.pixel += overrun_pending.eq(1)
        with m.Elif(queue.w_rdy):
            m.d.pixel += overrun_pending.eq(0)

        # In the system's clock.
        m.d.comb += [
            self.o.valid.eq(queue.r_rdy),
            self.o.payload.eq(queue.r_data),
            queue.r_en.eq(self.o.ready),
        ]
        with m.If(self.o.valid & self.o.ready & self.o.p.marker.broken):
            for bit, counter in enumerate((self.bad_sync, self.overrun)):
                m.d.sync += counter.eq(counter + (self.o.p.grey[bit] & ~counter.all()))

        return m
