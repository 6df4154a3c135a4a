"""Frames between two clocks, in memory blocks of the chip."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import StoredFrame
from .frame_banks import FrameBanks, check_store, store_members

__all__ = ["FrameMemory"]

#: Pixels of the largest memory block of the Virtex-II Pro, one bit wide.
_PAGE = 1 << 14


class FrameMemory(wiring.Component):
    """Stores frames in the domain ``sync``; they are read, whole, in the domain ``display``.

    Takes a pixel in every clock and never stalls the camera. The reader keeps a bank for any time
    and reads it in any order; meanwhile frames go to the others. No bank is written while the
    reader holds it, whatever the clocks, see :class:`.FrameBanks`; nor are frames kept that nobody
    requests. A broken frame, or one of another size, is discarded and counted; its bank takes the
    next one.

    The memory is cut into pages of 16,384 pixels, so that it needs no more blocks than its bits do:
    50 RAMB16 for each bank of 352 x 288. Its content is undefined until a frame has been stored.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    banks : :class:`int`
        2, or 3 so that no frame is ever skipped.
    shape : shape-like
        Information that is kept with a frame.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel, always_ready=True))`
        Frames.
    info : :py:`In(shape)`
        A frame's information, sampled with its first pixel.
    broken, skipped, unread : :py:`Out(8)`
        Frames that broke off, for which no bank was free, and that a newer one replaced before the
        reader requested them; frames = broken + skipped + unread + the reader's fresh ones, except
        for the last whole one. They stop at 255.
    acquire, give_back, idle, held, fresh, frame
        The reader's side of :class:`.FrameBanks`, in ``display``.
    address : :py:`In(range(width * height))`
        Pixel of the held frame, row after row (``display``).
    data : :py:`Out(8)`
        Its grey value, two clocks later. The address of the clock of ``acquire`` or ``give_back``
        is the last one that is answered.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``address`` to ``data``.
    """

    latency = 2

    def __init__(self, width, height, banks=2, shape=StoredFrame):
        check_store(width, height, banks)
        self.width, self.height, self.banks, self.shape = width, height, banks, shape
        super().__init__({
            **store_members(shape),
            "address": In(range(width * height)),
            "data": Out(8),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.banks = banks = FrameBanks(self.banks, self.shape)
        pixels = self.width * self.height

        # Writing. `inside` a frame, `taking` it; a frame that is too long wraps around in its bank.
        info = Signal(self.shape)
        inside = Signal()
        taking = Signal()
        position = Signal(range(pixels))
        too_long = Signal()
        first = Signal()
        writes = Signal()
        ends = Signal()
        whole = Signal()
        marker = self.i.p.marker
        m.d.comb += [
            first.eq(self.i.valid & ~inside & ~marker.broken),
            writes.eq(self.i.valid & Mux(inside, taking, banks.free)),
            ends.eq(self.i.valid & marker.frame_end),
            whole.eq(~marker.broken & ~too_long & (position == pixels - 1)),
            banks.opens.eq(first),
            banks.info.eq(info),
            banks.closes.eq(ends & writes & whole),
            self.skipped.eq(banks.skipped),
            self.unread.eq(banks.unread),
        ]
        with m.If(first):
            m.d.sync += [inside.eq(1), taking.eq(banks.free), info.eq(self.info)]
        with m.If(self.i.valid):
            m.d.sync += position.eq(Mux(position == pixels - 1, 0, position + 1))
            m.d.sync += too_long.eq(too_long | (position == pixels - 1))
        with m.If(ends):
            m.d.sync += [inside.eq(0), position.eq(0), too_long.eq(0)]
            with m.If(~whole & Mux(inside, taking, first & banks.free)):
                m.d.sync += self.broken.eq(self.broken + ~self.broken.all())

        # Reading.
        m.d.comb += [
            banks.acquire.eq(self.acquire), banks.give_back.eq(self.give_back),
            self.idle.eq(banks.idle), self.held.eq(banks.held), self.fresh.eq(banks.fresh),
            self.frame.eq(banks.frame),
        ]
        page_bits = (_PAGE - 1).bit_length()
        words = {}
        for bank in range(self.banks):
            for page in range(-(-pixels // _PAGE)):
                memory = Memory(shape=8, depth=min(_PAGE, pixels - page * _PAGE), init=[])
                m.submodules[f"bank_{bank}_page_{page}"] = memory
                write, read = memory.write_port(), memory.read_port(domain="display")
                m.d.comb += [
                    write.addr.eq(position[:page_bits]),
                    write.data.eq(self.i.p.grey),
                    write.en.eq(writes & (banks.write_bank == bank)
                                & (position[page_bits:] == page)),
                    read.addr.eq(self.address[:page_bits]),
                    read.en.eq(1),
                ]
                words[bank, page] = read.data
        chosen = Signal(len(banks.read_bank) + len(self.address[page_bits:]))
        m.d.display += chosen.eq(Cat(banks.read_bank, self.address[page_bits:]))
        with m.Switch(chosen):
            for (bank, page), word in words.items():
                with m.Case(bank | page << len(banks.read_bank)):
                    m.d.display += self.data.eq(word)
        return m
