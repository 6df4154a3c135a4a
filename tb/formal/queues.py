"""Queues keep order, lose nothing and make nothing up.

Of all words that go in, one is picked at a free moment; the proof follows it. When those that were
ahead of it have come out, it must be the next, unchanged; and never does more come out than went
in. As the moment is free, this holds for every word.
"""

from dataclasses import dataclass

from amaranth.hdl import (
    Cat,
    Const,
    DomainRenamer,
    Elaboratable,
    EnableInserter,
    Fragment,
    Module,
    Mux,
    ResetSignal,
    Shape,
    Signal,
    Value,
)
from amaranth.lib import fifo

from hdl.common.point_fifo import PointFIFO
from hdl.common.stage import Stage
from hdl.payloads import Counts, Detection, FrameInfo, GreyPixel
from hdl.preprocessing.spot_queue import SpotQueue
from tb.formal import symbiyosys as formal
from tb.formal.streams import async_queue, free_inputs

__all__ = ["QUEUES", "Queue", "QueueProof"]


class _Token:
    """The picked word: ``held`` while it is in the queue, ``ahead`` how many come out first."""

    def __init__(self, m, pick, puts, word, takes, most):
        def register(shape, name):
            return Signal(shape, name=f"token_{name}", reset_less=True)

        self.word, self.ahead = register(len(word), "word"), register(range(most + 1), "ahead")
        self.held, self.inside = register(1, "held"), register(range(most + 2), "inside")
        m.d.sync += self.inside.eq(self.inside + puts - takes)
        with m.If(self.held & takes):
            m.d.sync += self.ahead.eq(self.ahead - 1)
            with m.If(self.ahead == 0):
                m.d.sync += self.held.eq(0)
        with m.If(~self.held & puts & pick):
            m.d.sync += [self.held.eq(1), self.word.eq(word), self.ahead.eq(self.inside - takes)]
        with m.If(ResetSignal()):
            m.d.sync += [self.held.eq(0), self.inside.eq(0)]


class QueueProof(Elaboratable):
    """``queue``, followed as its entry in :data:`QUEUES` says."""

    def __init__(self, queue, follow, clocks=()):
        self.queue, self.follow, self.clocks = queue, follow, clocks
        self.pick = Signal()
        self.ticks = {domain: Signal(name=f"{domain}_tick") for domain in clocks}

    @property
    def ports(self):
        """Free inputs."""
        queue = self.queue
        inputs = ([queue.w_en, queue.w_data, queue.r_en]
                  if isinstance(queue, (fifo.SyncFIFO, fifo.AsyncFIFO)) else free_inputs(queue))
        return [self.pick, *self.ticks.values(), *inputs]

    def elaborate(self, platform):
        m = Module()
        inside = Fragment.get(self.queue, platform)
        g = formal.internals(inside)
        self.follow(m, self.queue, g, inside, self)
        if self.clocks:
            formal.assume(m, "no_reset", ~ResetSignal())
            inside = DomainRenamer(dict.fromkeys(self.clocks, "sync"))(
                EnableInserter(self.ticks)(inside))
        m.submodules.queue = inside
        return m


def _check(m, token, valid, word, takes):
    formal.claim(m, "order", ~(token.held & (token.ahead == 0) & valid) | (word == token.word))
    formal.claim(m, "nothing_more", ~valid | (token.inside != 0))
    formal.claim(m, "link_ahead", ~token.held | (token.ahead < token.inside))


def _stage(m, queue, g, inside, top):
    puts, takes = queue.i.valid & queue.i.ready, queue.o.valid & queue.o.ready
    token = _Token(m, top.pick, puts, Value.cast(queue.i.payload), takes, 1)
    _check(m, token, queue.o.valid, Value.cast(queue.o.payload), takes)
    formal.claim(m, "nothing_lost", token.inside == queue.o.valid)


def _sync_fifo(m, queue, g, inside, top):
    takes = queue.r_rdy & queue.r_en
    token = _Token(m, top.pick, queue.w_rdy & queue.w_en, queue.w_data, takes, queue.depth)
    _check(m, token, queue.r_rdy, queue.r_data, takes)
    formal.claim(m, "nothing_lost", (queue.level == token.inside) & (
        queue.r_rdy == (token.inside != 0)) & (queue.w_rdy == (token.inside != queue.depth)))
    formal.claim(m, "link_places", (
        (g["produce"] - g["consume"] - queue.level) & (queue.depth - 1)) == 0)
    formal.claim(m, "link_level", queue.level <= queue.depth)
    place = (g["consume"] + token.ahead)[:len(g["consume"])]
    formal.claim(m, "link_word", ~token.held | (
        formal.probe(inside, ["storage"], place) == token.word))


def _async_fifo(m, queue, g, inside, top):
    takes = queue.r_rdy & queue.r_en & top.ticks["read"]
    puts = queue.w_rdy & queue.w_en & top.ticks["write"]
    token = _Token(m, top.pick, puts, queue.w_data, takes, queue.depth)
    _check(m, token, queue.r_rdy, queue.r_data, takes)
    writer, reader = g["produce_w_bin"], g["consume_r_bin"]
    formal.claim(m, "nothing_lost", token.inside == (writer - reader)[:len(writer)])
    async_queue(m, g, queue.r_data, lambda address: formal.probe(inside, ["storage"], address))
    place = (reader + token.ahead)[:len(reader) - 1]
    formal.claim(m, "link_token", ~token.held | (
        formal.probe(inside, ["storage"], place) == token.word))


def _point_fifo(m, queue, g, inside, top):
    takes = queue.o.valid & queue.o.ready
    offered, shown = Value.cast(queue.i.payload), Value.cast(queue.o.payload)
    token = _Token(m, top.pick, g["push"], offered, takes, queue.depth)
    _check(m, token, queue.o.valid, shown, takes)
    level, slots = g["level"], queue.slots
    write_index, read_index = g["write_index"], g["read_index"]
    write_part, read_part = g["write_part"], g["read_part"]
    bits = -(-len(offered) // 3)

    def part(word, n):
        return word[n * bits:(n + 1) * bits]

    def stored(index, n):
        address = Signal(range(3 * slots), name=f"address_{len(addresses)}")
        addresses.append(address)
        m.d.comb += address.eq(index + n * slots)
        return formal.probe(inside, ["points"], address)

    addresses = []
    # A point that waits at the input stays, as every stream's does.
    waiting, waited = Signal(reset_less=True), Signal(len(offered), reset_less=True)
    m.d.sync += [waiting.eq(queue.i.valid & ~queue.i.ready & ~ResetSignal()), waited.eq(offered)]
    formal.assume(m, "stays", ~waiting | (queue.i.valid & (offered == waited)))

    formal.claim(m, "nothing_lost", token.inside == level + queue.o.valid)
    formal.claim(m, "goes_on", (level == 0) | queue.o.valid | g["reading"])
    formal.claim(m, "link_level", level <= slots)
    formal.claim(m, "link_indices", (write_index < slots) & (read_index < slots) & (
        (write_index == read_index + level) | (write_index + slots == read_index + level)))
    formal.claim(m, "link_parts", (write_part < 3) & (read_part < 3)
                 & ((write_part == 0) | (waiting & (level != slots)))
                 & ((read_part == 0) | ((level != 0) & ~queue.o.valid)))
    for n in range(2):
        formal.claim(m, f"link_written_{n}", (write_part <= n)
                     | (stored(write_index, n) == part(waited, n)))

    # The picked point in the memory, and its parts that have been read.
    steps = Signal(range(2 * slots + 2))
    place = Signal(range(slots + 1))
    m.d.comb += [
        steps.eq(read_index + token.ahead - queue.o.valid),
        place.eq(Mux(steps >= slots, steps - slots, steps)),
    ]
    out = queue.o.valid & (token.ahead == 0)
    words = Cat(*(stored(place, n) for n in range(3)))
    formal.claim(m, "link_word", ~token.held | out | (words == token.word))
    next_one = token.held & (token.ahead == 0) & ~queue.o.valid
    for read in (1, 2):
        seen = [g["kept_0"]] * (read - 1) + [g["got"]]
        formal.claim(m, f"link_read_{read}", ~next_one | (read_part != read) | (
            Cat(*seen) == token.word[:read * bits]))


def _spot_queue(m, queue, g, inside, top):
    takes = queue.o.valid & queue.o.ready
    ends = Value.cast(queue.o.p.end)
    inward = Cat(g["written"], g["counters"])
    token = _Token(m, top.pick, g["push"], inward, takes, queue.depth + 1)
    bits = len(g["written"])
    spot, counters, is_end = token.word[:bits], token.word[bits:], token.word[0]
    formal.claim(m, "order", ~(token.held & (token.ahead == 0) & queue.o.valid)
                 | (Value.cast(queue.o.payload) == spot))
    formal.claim(m, "nothing_more", ~queue.o.valid | (token.inside != 0))
    formal.claim(m, "nothing_lost", token.inside == g["level"] + g["held"])

    # No more than four frames are on their way, so no more than four end markers are in the memory.
    fetched = Signal()
    ends_before, ends_inside = Signal(4), Signal(4)
    leaves = fetched & g["shown"][0] & (ends_before != 0)
    comes = queue.i.valid & queue.i.p.end
    m.d.comb += ends_inside.eq(ends_before - leaves)
    m.d.sync += [fetched.eq(g["fetch"]), ends_before.eq(ends_inside + comes)]
    formal.assume(m, "frames", ~comes | (ends_inside < 4))
    formal.claim(m, "room_for_ends", g["level"] <= queue.depth)
    formal.claim(m, "link_room", (g["level"] <= queue.depth - 4 + ends_inside)
                 & (ends_inside <= 4))

    # Each end marker has its counters reported once, before it is taken.
    was_valid, was_taken = Signal(reset_less=True), Signal(reset_less=True)
    reported = Signal(reset_less=True)
    new = Signal()
    m.d.comb += new.eq(queue.counts.valid & (~was_valid | was_taken))
    m.d.sync += [
        was_valid.eq(queue.counts.valid & ~ResetSignal()), was_taken.eq(queue.counts.ready),
        reported.eq((reported | new) & ~(takes & ends) & ~ResetSignal()),
    ]
    head = token.held & (token.ahead == 0)
    formal.claim(m, "counts_once", ~(new & reported))
    formal.claim(m, "counts_of_an_end", ~new | g["shown"][0])
    formal.claim(m, "counts_first", ~(takes & ends) | reported | new)
    formal.claim(m, "counts", ~(head & is_end & new)
                 | (Value.cast(queue.counts.payload) == counters))
    formal.claim(m, "link_reported", g["counted"] == (reported | new))
    formal.claim(m, "link_counted", ~g["counted"] | (g["held"] & g["shown"][0]))

    # Spots of the frame that comes in: passed on, rejected or dropped.
    spots, passed = (Signal(17, name=f"seen_{name}", reset_less=True) for name in "sp")
    is_spot = queue.i.valid & ~queue.i.p.end
    with m.If(is_spot & (spots != 1 << 16)):
        m.d.sync += [spots.eq(spots + 1), passed.eq(passed + g["push"])]
    with m.If((queue.i.valid & queue.i.p.end) | ResetSignal()):
        m.d.sync += [spots.eq(0), passed.eq(0)]
    formal.claim(m, "conservation", (spots == 1 << 16) | (
        (g["spots"] == spots) & (passed + g["rejected"] + g["dropped"] == spots)))

    places = len(g["read_index"])
    formal.claim(m, "link_ahead", ~token.held | (token.ahead < token.inside))
    formal.claim(m, "link_places", (
        g["write_index"] - g["read_index"] - g["level"])[:places] == 0)
    place = (g["read_index"] + token.ahead - g["held"])[:places]
    words = []
    for memory in ("spots_memory", "counters_memory"):
        for bank in range(2):
            words.append(formal.probe(inside, [memory], Cat(place, Const(bank, 1))))
    formal.claim(m, "link_shown", ~(head & g["held"]) | (
        Cat(g["shown"], g["shown_counters"]) == token.word))
    formal.claim(m, "link_word", ~token.held | (head & g["held"])
                 | (Cat(words)[:len(inward)] == token.word))


@dataclass(frozen=True)
class Queue:
    """What it is made of, how it is followed, its domains if there are two, and what it is."""

    make: object
    follow: object
    clocks: tuple
    what: str

    def proof(self):
        """The design of the proof."""
        return QueueProof(self.make(), self.follow, self.clocks)


def _library(shape, depth):
    return Queue(lambda: fifo.SyncFIFO(width=Shape.cast(shape).width, depth=depth), _sync_fifo, (),
                 f"amaranth's SyncFIFO, {depth} words")


#: Queues of the design, by name.
QUEUES = {
    "stage": Queue(Stage, _stage, (), "one word between two blocks"),
    "frame_info": _library(FrameInfo, 4),
    "detection_fifo": _library(Detection, 4),
    "levels": _library(8, 4),
    "point_limiter.queue": _library(Counts, 4),
    "remap.queue": _library(8, 16),
    "addressed_camera.queue": _library(GreyPixel, 8),
    "camera.queue": Queue(lambda: fifo.AsyncFIFO(
        width=Shape.cast(GreyPixel).width, depth=16, w_domain="write", r_domain="read"),
        _async_fifo, ("write", "read"), "amaranth's AsyncFIFO, 16 words, any two clocks"),
    "point_fifo": Queue(PointFIFO, _point_fifo, (), "170 points"),
    "spot_queue": Queue(lambda: SpotQueue(64), _spot_queue, (),
                        "64 spots, with the counters of each frame"),
}
