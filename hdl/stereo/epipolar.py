"""Undistorted spots to spots with the beam that made them."""

from functools import reduce
from operator import xor

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import bits_for

from hdl.payloads import BEAM_BITS, COORDINATE_BITS, Match, Status, Undistorted
from hdl.protocol import MOST_BEAMS

__all__ = ["Epipolar"]

_WORD_BITS = 36
#: Clocks from the last group of a spot to its result.
_DEPTH = 4


class Epipolar(wiring.Component):
    """Tries every epipolar line on a spot (estimation, comparison, encoding).

    ``lanes`` lines are tried a clock, so a spot takes ``ceil(beams / lanes)`` clocks and spots
    follow each other without a pause. While ``o`` stalls, the whole block stalls.

    The estimate of line k is ``((slope * x + 2**16) >> 17) + offset``. A spot is on the line if it
    is closer to the estimate than the tolerance, and hits beam k if also ``u_min <= x <= u_max``,
    both limits included, x truncated to 32 LSBs. One hit gives the beam, more make the spot
    ambiguous. Without a hit it is rejected if it is on some line, else noise. Spots that come in
    rejected, and end markers, take the same time and pass unchanged.

    A tolerance of zero disables a beam; all are disabled until they are written. The words lie in
    two banks. A word may be written or read back at any time, but a spot that is being matched in
    that clock may be matched wrongly. Reset discards the spots under way, not the words.

    Paper, section on the 3-D unit: estimation block, comparison block, encoder; all K lines at
    once there, here on P lanes. The window is ours.

    Parameters
    ----------
    beams : :class:`int`
        The paper's K, 1 to :data:`hdl.protocol.MOST_BEAMS`.
    lanes : :class:`int`
        The paper's processing elements, P, 1 to ``beams``. Two lanes share the two read ports of
        one line and one window memory; every memory holds all beams.

    Members
    -------
    i : :py:`In(stream.Signature(Undistorted))`
        Spots and end markers.
    o : :py:`Out(stream.Signature(Match))`
        The same, in the same order.
    bank : :py:`In(1)`
        Bank of the words that spots are tried on. May change while no spot is under way.
    write_bank : :py:`In(1)`
        Bank that is written and read back.
    write_enable, read_enable : :py:`In(1)`
        Write the two words below, or read them back.
    write_address : :py:`In(9)`
        Beam whose words are written or read, below ``beams``.
    write_line : :py:`In(36)`
        Slope (signed 18 bits, Q0.17) and offset (signed 18 bits, a coordinate), slope in the low
        bits.
    write_window : :py:`In(36)`
        Tolerance (unsigned 9 bits, in 16 LSBs of a coordinate), ``u_min`` and ``u_max`` (signed 13
        bits each, in 32 LSBs), in this order from the low bits.
    read_line, read_window : :py:`Out(36)`
        Such words, in the clock after ``read_enable``. With more than two lanes there are several
        copies of each: if one has a fault, what is read is not what was written.

    Attributes
    ----------
    groups : :class:`int`
        Clocks that a spot takes.
    latency : :class:`int`
        Clocks from a spot's first clock at ``i`` to its first one at ``o``: ``groups + 3``.
    """

    def __init__(self, beams, lanes):
        if not isinstance(beams, int) or not 1 <= beams <= MOST_BEAMS:
            raise ValueError(f"Beams must be an integer from 1 to {MOST_BEAMS}, not {beams!r}")
        if not isinstance(lanes, int) or not 1 <= lanes <= beams:
            raise ValueError(f"Lanes must be an integer from 1 to {beams}, not {lanes!r}")
        self.beams = beams
        self.lanes = lanes
        self.groups = -(-beams // lanes)
        self._index_bits = max(1, bits_for(beams - 1))
        self.latency = self.groups - 1 + _DEPTH
        super().__init__({
            "i": In(stream.Signature(Undistorted)),
            "o": Out(stream.Signature(Match)),
            "bank": In(1),
            "write_bank": In(1),
            "write_enable": In(1),
            "read_enable": In(1),
            "write_address": In(BEAM_BITS),
            "write_line": In(_WORD_BITS),
            "write_window": In(_WORD_BITS),
            "read_line": Out(_WORD_BITS),
            "read_window": Out(_WORD_BITS),
        })

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p

        # Everything advances, unless a result waits to be taken.
        run = Signal()
        m.d.comb += run.eq(~self.o.valid | self.o.ready)

        # Lines are tried in groups; the spot is taken with the last one. `base` is the first beam
        # of the group.
        group = Signal(range(max(2, self.groups)))
        base = Signal(self._index_bits)
        first = Signal()
        last = Signal()
        m.d.comb += [
            base.eq(group * self.lanes),
            first.eq(group == 0),
            last.eq(group == self.groups - 1),
            self.i.ready.eq(run & last),
        ]
        with m.If(run & self.i.valid):
            m.d.sync += group.eq(Mux(last, 0, group + 1))

        # The spot's other fields wait here while the last of its groups is in the pipeline. They
        # take one slot, or as many as there can be spots in the pipeline.
        slots = -(-_DEPTH // self.groups)
        carried = Signal(Match)
        m.d.comb += [
            carried.end.eq(spot.end),
            carried.area.eq(spot.area),
            carried.saturated.eq(spot.saturated),
            carried.border.eq(spot.border),
            carried.u.eq(spot.u),
            carried.v.eq(spot.v),
            carried.x.eq(spot.x),
            carried.status.eq(Mux(spot.rejected, Status.REJECTED, Status.OK)),
        ]
        waiting = Array(Signal(Match, name=f"waiting_{n}") for n in range(slots))
        put = Signal(range(max(2, slots)))
        get = Signal(range(max(2, slots)))
        oldest = Signal(Match)
        m.d.comb += oldest.eq(waiting[get])
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [waiting[put].eq(carried), put.eq(Mux(put == slots - 1, 0, put + 1))]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += get.eq(Mux(get == slots - 1, 0, get + 1))

        # Clock 1: the words of the group's beams have been read.
        valid_1, first_1, last_1 = Signal(), Signal(), Signal()
        base_1 = Signal.like(base)
        x_1 = Signal(signed(COORDINATE_BITS))
        y_1 = Signal(signed(COORDINATE_BITS))
        # Clock 2: product, distance from the offset, window.
        valid_2, first_2, last_2 = Signal(), Signal(), Signal()
        base_2 = Signal.like(base)
        # Clock 3: compared.
        valid_3, first_3, last_3 = Signal(), Signal(), Signal()
        base_3 = Signal.like(base)
        with m.If(run):
            m.d.sync += [
                valid_1.eq(self.i.valid), first_1.eq(first), last_1.eq(last), base_1.eq(base),
                x_1.eq(spot.x), y_1.eq(spot.y),
                valid_2.eq(valid_1), first_2.eq(first_1), last_2.eq(last_1), base_2.eq(base_1),
                valid_3.eq(valid_2), first_3.eq(first_2), last_3.eq(last_2), base_3.eq(base_2),
            ]

        on_line = Signal(self.lanes)
        hit = Signal(self.lanes)
        words = self._read(m, run, base)
        for lane in range(self.lanes):
            line, window = words[lane]
            slope = line[:18].as_signed()
            offset = line[18:].as_signed()
            u_min = window[9:22].as_signed()
            u_max = window[22:35].as_signed()

            product = Signal(signed(36), name=f"product_{lane}")
            distance = Signal(signed(19), name=f"distance_{lane}")
            tolerance = Signal(9, name=f"tolerance_{lane}")
            inside = Signal(name=f"inside_{lane}")
            column = x_1 >> 5
            with m.If(run):
                m.d.sync += [
                    product.eq(slope * x_1),
                    distance.eq(y_1 - offset),
                    tolerance.eq(window[:9]),
                    inside.eq((column >= u_min) & (column <= u_max)),
                ]

            # A lane without a beam in the last group never hits.
            used = Signal(name=f"used_{lane}")
            m.d.comb += used.eq(1)
            if (self.groups - 1) * self.lanes + lane >= self.beams:
                m.d.comb += used.eq(~last_2)

            # The product's bit 16 rounds it: it is subtracted at half a weight, and the sum cut.
            # The error needs 20 bits.
            error = Signal(signed(20), name=f"error_{lane}")
            near = Signal(name=f"near_{lane}")
            m.d.comb += [
                error.eq(((distance << 1) - (product >> 16)) >> 1),
                near.eq(self._is_closer(m, error, tolerance, lane)),
            ]
            with m.If(run):
                m.d.sync += [
                    on_line[lane].eq(near & used),
                    hit[lane].eq(near & used & inside),
                ]

        # All beams that hit are or-ed together: the result counts only if there was just one.
        aligned = self.lanes & (self.lanes - 1) == 0  # `base` leaves the low bits free
        some, several, beam = 0, 0, 0
        for lane in range(self.lanes):
            several |= some & hit[lane]
            some |= hit[lane]
            beam |= Mux(hit[lane], base_3 | lane if aligned else (base_3 + lane)[:len(base)], 0)

        hit_before, several_before, on_line_before = Signal(), Signal(), Signal()
        beam_before = Signal.like(base)
        one_hit, many_hits, one_line = Signal(), Signal(), Signal()
        beams_hit = Signal.like(base)
        m.d.comb += [
            hit_before.eq(one_hit & ~first_3),
            several_before.eq(many_hits & ~first_3),
            on_line_before.eq(one_line & ~first_3),
            beam_before.eq(Mux(first_3, 0, beams_hit)),
        ]
        with m.If(run):
            m.d.sync += self.o.valid.eq(valid_3 & last_3)
            with m.If(valid_3):
                m.d.sync += [
                    one_hit.eq(some | hit_before),
                    many_hits.eq(several | several_before | (some & hit_before)),
                    one_line.eq(on_line.any() | on_line_before),
                    beams_hit.eq(beam | beam_before),
                ]

        m.d.comb += self.o.p.eq(oldest)
        with m.If(~oldest.end & (oldest.status == Status.OK)):
            with m.If(many_hits):
                m.d.comb += self.o.p.status.eq(Status.AMBIGUOUS)
            with m.Elif(one_hit):
                m.d.comb += self.o.p.beam.eq(beams_hit)
            with m.Elif(one_line):
                m.d.comb += self.o.p.status.eq(Status.REJECTED)
            with m.Else():
                m.d.comb += self.o.p.status.eq(Status.NOISE)

        return m

    def _is_closer(self, m, error, tolerance, lane):
        """``abs(error) < tolerance << 4``, for a signed error of 20 bits."""
        # Without negating: a negative error is complemented, which makes it one too small. Above
        # the tolerance's last bit that matters only if the four bits below are all zero; then
        # the magnitude is one more, and must not reach the tolerance either.
        negative = error[19]
        spare = Signal(10, name=f"spare_{lane}")  # tolerance - magnitude - 1, bit 9: not negative
        m.d.comb += spare.eq(tolerance + (~error[4:13] ^ negative.replicate(9)))
        one_more = negative & (error[:4] == 0)
        small = (error[13:19] ^ negative.replicate(6)) == 0
        return small & spare[9] & ((spare[:9] != 0) | ~one_more)

    def _read(self, m, run, base):
        """Line and window word of each lane, a clock after ``base``."""
        words = []
        host = Signal()
        m.d.comb += host.eq(self.write_enable | self.read_enable)
        for pair in range(0, self.lanes, 2):
            # The host borrows the address of the first read port: with two ports in all, a memory
            # fits into one dual-port block RAM.
            address = Signal(self._index_bits + 1, name=f"address_{pair}")
            m.d.comb += address.eq(Mux(
                host, Cat(self.write_address[:self._index_bits], self.write_bank),
                Cat((base + pair)[:len(base)], self.bank)))
            ports = {}
            for name, data in [("lines", self.write_line), ("windows", self.write_window)]:
                memory = Memory(shape=_WORD_BITS, depth=2 << self._index_bits, init=[])
                m.submodules[f"{name}_{pair}"] = memory
                write = memory.write_port()
                read = memory.read_port()
                m.d.comb += [
                    write.addr.eq(address), write.data.eq(data), write.en.eq(self.write_enable),
                    read.addr.eq(address), read.en.eq(run | host),
                ]
                ports[name] = [read]
                if pair + 1 < self.lanes:
                    second = memory.read_port()
                    m.d.comb += [
                        second.addr.eq(Cat((base + pair + 1)[:len(base)], self.bank)),
                        second.en.eq(run)]
                    ports[name].append(second)
            words += [(line.data, window.data)
                      for line, window in zip(ports["lines"], ports["windows"], strict=True)]
        copies = [Cat(*words[pair]) for pair in range(0, self.lanes, 2)]
        # The sum of an even number of copies is zero. If there is an odd number the first one is
        # left out: it is what is read, and its faults show by themselves.
        differ = reduce(xor, copies[len(copies) % 2:], C(0, 1)) != 0
        m.d.comb += Cat(self.read_line, self.read_window).eq(
            copies[0] | differ.replicate(len(copies[0])))
        return words
