"""Centres of spots to undistorted positions."""

from types import SimpleNamespace

from amaranth import *
from amaranth.lib import enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from hdl.payloads import Centre, Undistorted
from hdl.ports import register_ports
from hdl.protocol import SENSOR_PIXELS, fraction_bits

__all__ = ["Undistort"]

_WORD_BITS = 18
_SEGMENT_ADDRESS_BITS = 9
_SEGMENT_BITS = 9  # fraction of a segment of the table
_SUM_SHIFT = 12
_ADD_SHIFT = 14
_ESTIMATE_SHIFT = 4


class _Phase(enum.Enum, shape=3):
    """What the multipliers of both axes do in a clock of a round.

    ``position`` is -y or, from APPLY on, the undistorted estimate; P stands for the tangential
    registers.
    """

    SLOPE = 0  # P times position, summed
    TURN = 1  # position times that: onto the offset from the principal point
    SQUARE = 2  # position squared, summed
    SHIFT = 3  # P times that: added, the new position
    RADIUS = 4  # position squared, summed: address of the table
    LOOKUP = 5  # nothing; a word of the table arrives
    INTERPOLATE = 6  # that word times the fraction of the segment, plus the next word
    APPLY = 7  # position times that


class Undistort(wiring.Component):
    """Undoes the lens's distortion (Brown, OpenCV's k1, k2, p1, p2) at the centres of spots.

    The radial part is a table of scales over the squared radius, interpolated; the tangential
    part a fixed-point iteration, ``rounds`` times. The arithmetic, the format of the table and
    the error budget are those of :func:`model.stereo.undistort.undistort`: within 0.01 px of
    float. One spot at a time, on two multipliers, one for each axis; spots follow each other
    every :attr:`period` clocks. A spot is taken in the clock in which ``o`` is, :attr:`latency`
    clocks after it became valid, or later if ``o`` waits. End markers take one clock. Reset forgets
    what is under way; the table stays.

    A spot is rejected where the chip has no answer: x, y or an intermediate position leaves its 18
    bits, or its radius leaves the table. Spots that come in rejected are undistorted too.

    Paper, section on distortion correction, its second form: on the centres only.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels, 16 to 1024 each. They set the image centre and the table's range.
    rounds : :class:`int`
        Rounds of the tangential iteration, 1 to 3.

    Members
    -------
    i : :py:`In(stream.Signature(Centre))`
        Spots and end markers.
    o : :py:`Out(stream.Signature(Undistorted))`
        The same, in the same order; x and y about the image centre.
    principal_u, principal_v : :py:`In(18)`
        Principal point, a coordinate.
    tangential_1, tangential_2 : :py:`In(signed(18))`
        p1 and p2 over the focal length in pixels, times 2**27; with 8 fraction bits, 2**28.
    bank : :py:`In(1)`
        Bank of the table that is looked up. May change while no spot is under way.
    write_bank : :py:`In(1)`
        Bank that is written and read back.
    radial_write_enable : :py:`In(1)`
        Write a word of the table in this clock.
    radial_write_address, radial_write_data : :py:`In(10)`, :py:`In(18)`
        Which, and the word. All words are zero until they are written.
    radial_read_data : :py:`Out(18)`
        The word at that address, one clock later, in every clock; after a write, what was there
        before. Nothing is borrowed: spots may pass meanwhile.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a spot at ``i`` to the same at ``o``: ``8 * rounds + 5``.
    period : :class:`int`
        Clocks from spot to spot while ``o`` is ready: one more.
    """

    registers = register_ports("principal_u", "principal_v", "tangential_1", "tangential_2")

    def __init__(self, width, height, rounds=2):
        for name, value in [("width", width), ("height", height)]:
            if not isinstance(value, int) or not SENSOR_PIXELS[0] <= value <= SENSOR_PIXELS[1]:
                raise ValueError(
                    f"Frame {name} must be an integer from {SENSOR_PIXELS[0]} to "
                    f"{SENSOR_PIXELS[1]}, not {value!r}")
        if not isinstance(rounds, int) or not 1 <= rounds <= 3:
            raise ValueError(f"Rounds must be an integer from 1 to 3, not {rounds!r}")
        self.width = width
        self.height = height
        self.fraction = fraction_bits(width, height)
        self.rounds = rounds
        self.latency = 8 * rounds + 5
        self.period = self.latency + 1
        super().__init__({
            "i": In(stream.Signature(Centre)),
            "o": Out(stream.Signature(Undistorted)),
            **self.registers,
            "bank": In(1),
            "write_bank": In(1),
            "radial_write_enable": In(1),
            "radial_write_address": In(10),
            "radial_write_data": In(_WORD_BITS),
            "radial_read_data": Out(_WORD_BITS),
        })

    @property
    def radius_bits(self):
        """Bits of the squared radius that the table covers: 25 % beyond the corners."""
        need = (self.width**2 + self.height**2) * 5 / 16
        most = 35 - 2 * self.fraction
        return next((bits for bits in range(12, most) if 2**bits >= need), most)

    def elaborate(self, platform):
        m = Module()
        spot = self.i.p
        done = Signal()
        end_waits = Signal()  # an end marker is at `i`
        phase, first, last, next_phase, next_turn = self._schedule(m, done, end_waits)
        steer = self._steer(m, next_phase, next_turn)

        fraction = Signal(_SEGMENT_BITS)
        scalar = Signal(signed(18))
        position_u, product_u, outside_u = self._lane(
            m, steer, end_waits, scalar, "u", self.principal_u, spot.u, self.width,
            self.tangential_2, fraction)
        position_v, product_v, outside_v = self._lane(
            m, steer, end_waits, scalar, "v", self.principal_v, spot.v, self.height,
            self.tangential_1)
        radius = self._across(m, steer, first, product_u, product_v, scalar, fraction)

        bad = Signal()
        with m.If(steer.shifting | (steer.use_half & last)):
            m.d.sync += bad.eq((bad & ~(first & steer.shifting)) | Cat(outside_u, outside_v).any())
        with m.If(steer.in_radius & radius[_SEGMENT_BITS + _SEGMENT_ADDRESS_BITS:].any()):
            m.d.sync += bad.eq(1)

        # The spot stays at `i` until it is taken from `o`.
        m.d.comb += [
            self.o.valid.eq(done),
            self.i.ready.eq(done & self.o.ready),
            self.o.p.end.eq(spot.end),
            self.o.p.rejected.eq(spot.rejected | bad),
            self.o.p.area.eq(spot.area),
            self.o.p.saturated.eq(spot.saturated),
            self.o.p.border.eq(spot.border),
            self.o.p.u.eq(spot.u),
            self.o.p.v.eq(spot.v),
            self.o.p.x.eq(position_u),
            self.o.p.y.eq(position_v),
        ]
        with m.If(done):
            m.d.sync += done.eq(~self.o.ready)
        with m.Elif(end_waits):
            m.d.sync += [done.eq(1), bad.eq(0)]
        with m.Elif(last & (phase == _Phase.APPLY)):
            m.d.sync += done.eq(1)

        return m

    def _schedule(self, m, done, end_waits):
        """The phase, whether the round is the first or the last, and the next phase and round.

        The first round, without a tangential part, skips the phases that it does not need.
        """
        phase = Signal(_Phase, init=_Phase.TURN)
        turn = Signal(range(self.rounds + 1))
        next_phase = Signal(_Phase)
        next_turn = Signal.like(turn)
        first, last, waiting = Signal(), Signal(), Signal()
        m.d.comb += [
            first.eq(turn == 0),
            last.eq(turn == self.rounds),
            waiting.eq(first & (phase == _Phase.TURN)),
            end_waits.eq(waiting & self.i.valid & self.i.p.end & ~done),
            next_phase.eq(phase),
            next_turn.eq(turn),
        ]
        with m.If(~done & ~end_waits & (~waiting | self.i.valid)):
            m.d.comb += next_phase.eq(phase.as_value() + Mux(
                first & ((phase == _Phase.TURN) | (phase == _Phase.LOOKUP)), 2, 1))
            with m.If(phase == _Phase.APPLY):
                m.d.comb += next_turn.eq(turn + 1)
                with m.If(last):
                    m.d.comb += [next_phase.eq(_Phase.TURN), next_turn.eq(0)]
        m.d.sync += [phase.eq(next_phase), turn.eq(next_turn)]
        return phase, first, last, next_phase, next_turn

    def _steer(self, m, next_phase, next_turn):
        """What steers the wide multiplexers: a register each, so that a bit takes one table."""
        def during(name, *phases, turns=None):
            steer = Signal(name=name, init=_Phase.TURN in phases)
            chosen = Cat(next_phase == each for each in phases).any()
            m.d.sync += steer.eq(chosen if turns is None else chosen & turns)
            return steer

        to_first, to_last = next_turn == 0, next_turn == self.rounds
        idle, estimate = Signal(init=1), Signal()
        m.d.sync += [
            idle.eq((next_phase == _Phase.LOOKUP) | (to_first & (
                (next_phase == _Phase.TURN) | (next_phase == _Phase.SHIFT)))),
            estimate.eq((~to_last & (next_phase == _Phase.INTERPOLATE))
                        | (to_first & (next_phase == _Phase.LOOKUP))),
        ]
        return SimpleNamespace(
            idle=idle, estimate=estimate,
            turning=during("turning", _Phase.TURN),
            shifting=during("shifting", _Phase.SHIFT),
            in_radius=during("in_radius", _Phase.RADIUS),
            interpolating=during("interpolating", _Phase.INTERPOLATE),
            use_tangential=during("use_tangential", _Phase.SLOPE, _Phase.SHIFT),
            use_position=during("use_position", _Phase.SLOPE, _Phase.SQUARE, _Phase.RADIUS),
            use_half=during("use_half", _Phase.SHIFT, _Phase.APPLY),
            use_word=during("use_word", _Phase.LOOKUP, _Phase.INTERPOLATE),
            use_offset_of_centre=during("use_offset_of_centre", _Phase.LOOKUP, turns=to_last))

    def _lane(self, m, steer, end_waits, scalar, axis, principal, coordinate, size, tangential,
              fraction=None):
        """One axis: the offset from the principal point, the product, the sum.

        The offset is negative, as every position, so that all steps add. The first of two sums that
        make a position is halved, since its product must count twice.
        """
        position = Signal(signed(18), name=f"position_{axis}")
        half = Signal(signed(20), name=f"half_{axis}")
        left = Signal(signed(18), name=f"left_{axis}")
        right = Signal(signed(18), name=f"right_{axis}")
        product = Signal(signed(36), name=f"product_{axis}")
        offset = Signal(signed(19), name=f"offset_{axis}")
        total = Signal(signed(22), name=f"total_{axis}")
        m.d.comb += [
            left.eq(Mux(steer.use_tangential, tangential, position)),
            right.eq(Mux(steer.idle, 0, Mux(steer.use_position, position, scalar))),
            product.eq(left * right),
            offset.eq(principal - Mux(
                steer.use_offset_of_centre, (size - 1) << self.fraction - 1, coordinate)),
            # The product, plus twice one of the others, plus one, which rounds. Written as a
            # difference, since carry chains want their first operand without logic before
            # it, and yosys does not swap those of a difference.
            total.eq((product >> _ADD_SHIFT) - Mux(
                steer.use_half, Cat(C(1, 1), ~half).as_signed(),
                Cat(C(1, 1), ~offset).as_signed())),
        ]
        if fraction is not None:
            with m.If(steer.interpolating):
                m.d.comb += left.eq(fraction << (_SUM_SHIFT - _SEGMENT_BITS))
        with m.If(steer.use_half):
            m.d.sync += position.eq(total >> 2)
        with m.If(end_waits):
            m.d.sync += position.eq(0)
        with m.If(steer.turning | steer.use_offset_of_centre):
            m.d.sync += half.eq(total)
        with m.If(steer.shifting):
            m.d.sync += half.eq(0)
        return position, product, total[19:].any() & ~total[19:].all()

    def _across(self, m, steer, first, product_u, product_v, scalar, fraction):
        """Both axes: a sum of two products, or a product and a word of the table."""
        m.submodules.scales = scales = Memory(shape=signed(_WORD_BITS), depth=2048, init=[])
        write = scales.write_port()
        read = scales.read_port()
        read_back = scales.read_port()
        across = Signal(signed(25))
        m.d.comb += across.eq((product_u >> _SUM_SHIFT) + Mux(
            steer.use_word, read.data, product_v >> _SUM_SHIFT))
        # What makes an estimate is cut, to make room above for the tangential products.
        m.d.sync += scalar.eq(Mux(steer.estimate, across >> _ESTIMATE_SHIFT, across))

        radius = across[self.radius_bits + 2 * self.fraction - 18 - _SUM_SHIFT:]
        segment = Signal(_SEGMENT_ADDRESS_BITS)
        looked_up = Signal(_SEGMENT_ADDRESS_BITS)
        host_address = Signal(11)
        m.d.comb += [
            looked_up.eq(Mux(steer.in_radius, radius[_SEGMENT_BITS:], segment)),
            host_address.eq(Cat(self.radial_write_address, self.write_bank)),
            read.en.eq(1),
            # The slope, and then the value; the first time only that.
            read.addr.eq(Cat(steer.in_radius & ~first, looked_up, self.bank)),
            write.en.eq(self.radial_write_enable),
            write.addr.eq(host_address),
            write.data.eq(self.radial_write_data),
            read_back.en.eq(1),
            read_back.addr.eq(host_address),
            self.radial_read_data.eq(read_back.data),
        ]
        with m.If(steer.in_radius):
            m.d.sync += [segment.eq(radius[_SEGMENT_BITS:]), fraction.eq(radius)]
        return radius
