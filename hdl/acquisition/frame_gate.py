"""Whole frames, or none of a frame."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, FrameTag, GreyPixel

__all__ = ["FrameGate"]


class FrameGate(wiring.Component):
    """Numbers frames, announces each, separates texture from patterns, and skips frames whose
    announcement finds no room.

    Frames whose ``tag`` says texture leave by ``texture`` and ``texture_info``, the others by ``o``
    and ``info``. All are numbered together. If a frame's announcement is not ready at its first
    pixel, the whole frame is discarded and counted; the next announcement, of either kind, says how
    many were skipped. Pixels pass combinationally and wait only for the stream that they go to. A
    ``broken`` beat before any pixel of its frame is discarded. Reset restarts the numbers.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Frames.
    o : :py:`Out(stream.Signature(GreyPixel))`
        Pattern frames that pass.
    info : :py:`Out(stream.Signature(FrameInfo))`
        One for each of them, with its first pixel. ``valid`` does not wait for ``ready``, but is
        high in that clock only: this stream is for a queue that takes a word at once or not at all.
    texture, texture_info
        The same two for texture frames.
    tag : :py:`In(FrameTag)`
        How the frame was exposed; sampled with its first pixel.
    tripped, tables_valid : :py:`In(1)`
        State of the laser guard and of the tables, for the announcement.
    lost : :py:`Out(8)`
        Frames that were discarded since reset; stops at 255.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to the same at ``o`` or ``texture``.
    """

    latency = 0

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "o": Out(stream.Signature(GreyPixel)),
            "info": Out(stream.Signature(FrameInfo)),
            "texture": Out(stream.Signature(GreyPixel)),
            "texture_info": Out(stream.Signature(FrameInfo)),
            "tag": In(FrameTag),
            "tripped": In(1),
            "tables_valid": In(1),
            "lost": Out(8),
        })

    def elaborate(self, platform):
        m = Module()

        inside = Signal()  # the frame's first pixel has been taken
        passing = Signal()  # ... and the frame passes
        was_texture = Signal()
        number = Signal(16)
        skipped = Signal(8)

        marker = self.i.p.marker
        is_texture = Signal()
        begins = Signal()
        passes = Signal()
        ready = Signal()
        m.d.comb += [
            is_texture.eq(Mux(inside, was_texture, self.tag.texture)),
            begins.eq(~inside & ~marker.broken),
            passes.eq(Mux(inside, passing, begins & Mux(
                is_texture, self.texture_info.ready, self.info.ready))),
            ready.eq(Mux(is_texture, self.texture.ready, self.o.ready)),
            self.i.ready.eq(ready | ~passes),
        ]
        for pixels, info, mine in ((self.o, self.info, ~is_texture),
                                   (self.texture, self.texture_info, is_texture)):
            m.d.comb += [
                pixels.payload.eq(self.i.payload),
                pixels.valid.eq(self.i.valid & passes & mine),
                info.valid.eq(self.i.valid & begins & pixels.ready & mine),
                info.p.number.eq(number),
                info.p.skipped.eq(skipped),
                info.p.tag.eq(self.tag),
                info.p.tripped.eq(self.tripped),
                info.p.tables_valid.eq(self.tables_valid),
            ]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [
                inside.eq(~marker.frame_end), passing.eq(passes), was_texture.eq(is_texture)]
            with m.If(begins):
                m.d.sync += number.eq(number + 1)
                with m.If(passes):
                    m.d.sync += skipped.eq(0)
                with m.Elif(skipped != 255):
                    m.d.sync += skipped.eq(skipped + 1)
                with m.If(~passes & (self.lost != 255)):
                    m.d.sync += self.lost.eq(self.lost + 1)

        return m
