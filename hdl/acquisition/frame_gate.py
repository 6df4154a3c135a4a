"""Whole frames, or none of a frame."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, FrameTag, GreyPixel
from ..ports import register_ports

__all__ = ["FrameGate"]


class FrameGate(wiring.Component):
    """Numbers frames, announces each, separates texture from patterns, leaves pattern frames out as
    the host asks, and skips frames whose announcement finds no room.

    Frames whose ``tag`` says texture leave by ``texture`` and ``texture_info``, the others by ``o``
    and ``info``. All are numbered together. If a frame's announcement is not ready at its first
    pixel, the whole frame is discarded and counted; the next announcement, of either kind, says how
    many were skipped. One pattern frame in ``pattern_every`` passes; those between are left out:
    numbered, but neither announced nor counted as skipped. In place of one that should have passed
    and was skipped, the next one passes. Pixels pass combinationally and wait only for the stream
    that they go to. A ``broken`` beat before any pixel of its frame is discarded. Reset restarts
    the numbers, and the next pattern frame passes.

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
    pattern_every : :py:`In(4)`
        As above, also for the announcement; 0 is as 1. Sampled with a frame's first pixel.
    lost : :py:`Out(8)`
        Frames that were discarded since reset; stops at 255.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to the same at ``o`` or ``texture``.
    """

    latency = 0

    registers = register_ports("pattern_every")

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
            **self.registers,
            "lost": Out(8),
        })

    def elaborate(self, platform):
        m = Module()

        inside = Signal()  # the frame's first pixel has been taken
        passing = Signal()  # ... and the frame passes
        was_texture = Signal()
        number = Signal(16)
        skipped = Signal(8)
        since = Signal(4)  # pattern frames since the last that passed, itself included; 0 for none

        marker = self.i.p.marker
        is_texture = Signal()
        begins = Signal()
        left_out = Signal()
        passes = Signal()
        ready = Signal()
        m.d.comb += [
            is_texture.eq(Mux(inside, was_texture, self.tag.texture)),
            begins.eq(~inside & ~marker.broken),
            left_out.eq(begins & ~is_texture & (since != 0) & (since < self.pattern_every)),
            passes.eq(Mux(inside, passing, begins & ~left_out & Mux(
                is_texture, self.texture_info.ready, self.info.ready))),
            ready.eq(Mux(is_texture, self.texture.ready, self.o.ready)),
            self.i.ready.eq(ready | ~passes),
        ]
        for pixels, info, mine in ((self.o, self.info, ~is_texture),
                                   (self.texture, self.texture_info, is_texture)):
            m.d.comb += [
                pixels.payload.eq(self.i.payload),
                pixels.valid.eq(self.i.valid & passes & mine),
                info.valid.eq(self.i.valid & begins & ~left_out & pixels.ready & mine),
                info.p.number.eq(number),
                info.p.skipped.eq(skipped),
                info.p.tag.eq(self.tag),
                info.p.tripped.eq(self.tripped),
                info.p.tables_valid.eq(self.tables_valid),
                info.p.every.eq(self.pattern_every),
            ]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [
                inside.eq(~marker.frame_end), passing.eq(passes), was_texture.eq(is_texture)]
            with m.If(begins):
                m.d.sync += number.eq(number + 1)
                with m.If(left_out):
                    m.d.sync += since.eq(since + 1)
                with m.Elif(passes):
                    m.d.sync += skipped.eq(0)
                    with m.If(~is_texture):
                        m.d.sync += since.eq(1)
                with m.Else():
                    with m.If(skipped != 255):
                        m.d.sync += skipped.eq(skipped + 1)
                    with m.If(self.lost != 255):
                        m.d.sync += self.lost.eq(self.lost + 1)

        return m
