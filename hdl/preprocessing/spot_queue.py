"""Components to spots that wait for their centres."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import AREA_CODE_BITS, AREA_LIMIT, Counts, QueuedSpot, Spot
from hdl.ports import register_ports

__all__ = ["SpotQueue"]

_WORD_BITS = 36
#: Slots that only end markers may take: as many frames as may be under way at once.
_END_SLOTS = 4


class SpotQueue(wiring.Component):
    """Filters components by area and core, and queues them without ever stalling labelling.

    A component is rejected if its area lies outside ``area_min`` to ``area_max`` or if it failed
    the erosion, that is, none of its pixels survived. Rejected ones are counted; they are queued
    only with ``report_rejected``, an area of at most 1,023 and while less than half of the slots
    are taken. The others are queued while there is room; when the queue is full they are dropped
    and counted. Four slots are reserved for end markers: there may be no more than four frames
    between labelling and the reader of ``counts``, or an end marker overwrites a waiting word.

    Areas leave as codes, see :data:`hdl.payloads.AREA_CODE_BITS`.

    ``i.ready`` is always high. The memory is read only in clocks in which nothing is written, so a
    word a clock in means none out. The word at ``o`` has left the memory and its slot is free.

    The counters of a frame, saturated at 65,535, travel with its end marker. They are valid at
    ``counts`` from the clock on in which the end marker is valid at ``o``; the next end marker
    waits for them to be taken. ``spots`` counts all components of the frame, ``rejected`` and
    ``dropped`` those that were not queued; the rest comes out at ``o``.

    Parameters
    ----------
    depth : :class:`int`
        Slots, 8 to 512.

    Members
    -------
    i : :py:`In(stream.Signature(Spot))`
        Components and end markers; ``ready`` is constant.
    o : :py:`Out(stream.Signature(QueuedSpot))`
        Spots and end markers, in the same order.
    counts : :py:`Out(stream.Signature(Counts))`
        One word for each end marker.
    area_min, area_max : :py:`In(10)`
        Areas of spots, both included.
    report_rejected : :py:`In(1)`
        Queue rejected spots too.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a component at ``i`` to the spot at ``o``, if the queue is empty and no other
        component follows at once. An end marker takes one more, for its counters.
    """

    latency = 2

    registers = register_ports("area_min", "area_max", "report_rejected")

    def __init__(self, depth=64):
        if not isinstance(depth, int) or not 8 <= depth <= 512:
            raise ValueError(f"Depth must be an integer from 8 to 512, not {depth!r}")
        self.depth = depth
        super().__init__({
            "i": In(stream.Signature(Spot)),
            "o": Out(stream.Signature(QueuedSpot)),
            "counts": Out(stream.Signature(Counts)),
            **self.registers,
        })

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p
        level = Signal(range(self.depth + 1))  # words in the memory
        room = Signal()
        rejected, wanted = self._filter(m, level, room)
        counters = self._count(m, rejected, wanted, room)
        push = Signal()
        written = Signal(QueuedSpot)
        m.d.comb += [
            self.i.ready.eq(1),
            push.eq(self.i.valid & (spot.end | wanted)),
            written.end.eq(spot.end),
            written.rejected.eq(~spot.end & rejected),
            written.area.eq(self._area_code(spot.area)),
            written.saturated.eq(spot.saturated),
            written.border.eq(spot.border),
            written.weight.eq(spot.weight),
            written.sum_u.eq(spot.sum_u),
            written.sum_v.eq(spot.sum_v),
        ]
        held = Signal()
        shown, shown_counters = self._store(m, level, push, Cat(written, counters), held)

        # An end marker shows once its counters are in their register.
        counted = Signal()
        m.d.comb += [
            self.o.valid.eq(held & (~shown.end | counted)),
            self.o.p.eq(shown),
        ]
        with m.If(self.counts.ready):
            m.d.sync += self.counts.valid.eq(0)
        with m.If(held & shown.end & ~counted & (~self.counts.valid | self.counts.ready)):
            m.d.sync += [
                counted.eq(1), self.counts.valid.eq(1), self.counts.p.eq(shown_counters)]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += counted.eq(0)

        return m

    @staticmethod
    def _area_code(area):
        """The code of an area that has one."""
        return Mux(area[9], Cat(area[2:9], C(3, 2)), Mux(
            area[8], Cat(area[1:8], C(2, 2)), area[:8]))[:AREA_CODE_BITS]

    def _filter(self, m, level, room):
        """Whether the component is rejected, and whether it is queued."""
        spot = self.i.p
        too_large, half_full = Signal(), Signal()
        rejected, wanted = Signal(), Signal()
        m.d.comb += [
            too_large.eq(spot.area >= AREA_LIMIT),
            rejected.eq(~spot.core | too_large | (spot.area[:-1] < self.area_min)
                        | (spot.area[:-1] > self.area_max)),
            room.eq(level < self.depth - _END_SLOTS),
            half_full.eq(level >= self.depth // 2),
            wanted.eq(Mux(rejected, self.report_rejected & ~too_large & ~half_full, room)),
        ]
        return rejected, wanted

    def _count(self, m, rejected, wanted, room):
        """Counters of the frame; its end marker reads them and clears them."""
        spot = self.i.p
        is_spot = Signal()
        m.d.comb += is_spot.eq(self.i.valid & ~spot.end)
        counters = Signal(Counts)
        for name, event in [("spots", 1), ("rejected", rejected & ~wanted),
                            ("dropped", ~rejected & ~room)]:
            counter = Signal(16, name=name)
            following = Signal(17, name=f"following_{name}")
            m.d.comb += [counters[name].eq(counter), following.eq(counter + 1)]
            with m.If(is_spot & event & ~following[-1]):
                m.d.sync += counter.eq(following)
            with m.If(self.i.valid & spot.end):
                m.d.sync += counter.eq(0)
        m.d.comb += counters.broken.eq(spot.broken)
        return counters

    def _store(self, m, level, push, inward, held):
        """The memory; returns the word that was read last.

        A slot is four words: a spot and the counters fill 135 bits. Two memories with two
        ports each take them in one clock, so reading has to give way to writing.
        """
        slots = 1 << (self.depth - 1).bit_length()
        write_index = Signal(range(slots))
        read_index = Signal(range(slots))
        index = Signal(range(slots))
        fetch = Signal()
        m.d.comb += index.eq(Mux(push, write_index, read_index))
        outward = []
        for half_name, start in [("spots", 0), ("counters", 2 * _WORD_BITS)]:
            memory = Memory(shape=_WORD_BITS, depth=2 * slots, init=[])
            m.submodules[f"{half_name}_memory"] = memory
            for bank in range(2):
                write = memory.write_port()
                read = memory.read_port()
                first = start + bank * _WORD_BITS
                m.d.comb += [
                    write.addr.eq(Cat(index, C(bank, 1))),
                    write.data.eq(inward[first:first + _WORD_BITS]),
                    write.en.eq(push),
                    read.addr.eq(Cat(index, C(bank, 1))),
                    read.en.eq(fetch),
                ]
                outward.append(read.data)
        shown = Signal(QueuedSpot)
        shown_counters = Signal(Counts)
        m.d.comb += [
            Cat(shown, shown_counters).eq(Cat(outward)),
            fetch.eq(~push & (level != 0) & (~held | (self.o.valid & self.o.ready))),
        ]
        with m.If(push):
            m.d.sync += [write_index.eq(write_index + 1), level.eq(level + 1)]
        with m.If(fetch):
            m.d.sync += [read_index.eq(read_index + 1), level.eq(level - 1), held.eq(1)]
        with m.Elif(self.o.valid & self.o.ready):
            m.d.sync += held.eq(0)
        return shown, shown_counters
