"""Components to spots that wait for their centres."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import AREA_LIMIT, Counts, QueuedSpot, Spot
from hdl.ports import register_ports

__all__ = ["SpotQueue"]

_WORD_BITS = 36
#: Places that only end markers may take: as many frames as may be on their way at once.
_END_PLACES = 4


class SpotQueue(wiring.Component):
    """Screens components by area and core, and queues them without ever making them wait.

    A component is rejected if its area lies outside ``area_min`` to ``area_max`` or if no pixel
    of it survived the erosion. Rejected ones are counted, and queued only with
    ``report_rejected``, an area of at most 255 and while less than half of the places are taken.
    The others are queued while there is room, else counted as dropped. Four places are kept for
    end markers; there may be no more than four frames between labelling and the taker of
    ``counts``, or an end marker overwrites what waits.

    ``i.ready`` is always high. A component comes out two clocks after it went in, or later: the
    memory is read only in clocks in which nothing is written, so a word a clock in means none out.
    The word at ``o`` has left the memory and its place is free.

    The counters of a frame, saturated at 65,535, travel with its end marker. They are valid at
    ``counts`` from the clock on in which the end marker is valid at ``o``; the next end marker
    waits for them to be taken. ``spots`` counts all components of the frame, ``rejected``
    and ``dropped`` those that were not queued; the rest comes out at ``o``.

    Parameters
    ----------
    depth : :class:`int`
        Places, 8 to 512.

    Members
    -------
    i : :py:`In(stream.Signature(Spot))`
        Components and end markers; ``ready`` is constant.
    o : :py:`Out(stream.Signature(QueuedSpot))`
        Spots and end markers, in the same order.
    counts : :py:`Out(stream.Signature(Counts))`
        One word for each end marker.
    area_min, area_max : :py:`In(8)`
        Areas of spots, both included.
    report_rejected : :py:`In(1)`
        Queue rejected spots too.
    """

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
        m.d.comb += self.i.ready.eq(1)

        # Screening.
        too_large = Signal()
        rejected = Signal()
        m.d.comb += [
            too_large.eq(spot.area >= AREA_LIMIT),
            rejected.eq(~spot.core | too_large | (spot.area[:8] < self.area_min)
                        | (spot.area[:8] > self.area_max)),
        ]

        # `level` counts what is in the memory.
        level = Signal(range(self.depth + 1))
        room = Signal()
        half = Signal()
        wanted = Signal()
        is_spot = Signal()
        push = Signal()
        m.d.comb += [
            room.eq(level < self.depth - _END_PLACES),
            half.eq(level >= self.depth // 2),
            wanted.eq(Mux(rejected, self.report_rejected & ~too_large & ~half, room)),
            is_spot.eq(self.i.valid & ~spot.end),
            push.eq(self.i.valid & (spot.end | wanted)),
        ]

        # Counters of the frame. They show what they are at the end marker, which clears them.
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

        # A place is four words: a spot and the counters would fill 125 bits. Two memories with
        # two ports each take them in one clock, so reading has to step back for writing.
        places = 1 << (self.depth - 1).bit_length()
        write_place = Signal(range(places))
        read_place = Signal(range(places))
        place = Signal(range(places))
        fetch = Signal()
        held = Signal()
        written = Signal(QueuedSpot)
        m.d.comb += [
            place.eq(Mux(push, write_place, read_place)),
            written.end.eq(spot.end),
            written.rejected.eq(~spot.end & rejected),
            written.area.eq(spot.area),
            written.weight.eq(spot.weight),
            written.sum_u.eq(spot.sum_u),
            written.sum_v.eq(spot.sum_v),
        ]
        inward = Cat(written, counters)
        outward = []
        for half_name, start in [("spots", 0), ("counters", 2 * _WORD_BITS)]:
            memory = Memory(shape=_WORD_BITS, depth=2 * places, init=[])
            m.submodules[f"{half_name}_memory"] = memory
            for bank in range(2):
                write = memory.write_port()
                read = memory.read_port()
                first = start + bank * _WORD_BITS
                m.d.comb += [
                    write.addr.eq(Cat(place, C(bank, 1))),
                    write.data.eq(inward[first:first + _WORD_BITS]),
                    write.en.eq(push),
                    read.addr.eq(Cat(place, C(bank, 1))),
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
            m.d.sync += [write_place.eq(write_place + 1), level.eq(level + 1)]
        with m.If(fetch):
            m.d.sync += [read_place.eq(read_place + 1), level.eq(level - 1), held.eq(1)]
        with m.Elif(self.o.valid & self.o.ready):
            m.d.sync += held.eq(0)

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
