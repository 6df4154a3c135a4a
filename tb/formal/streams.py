"""The stream contract at every port of every block, at the sizes of the presets.

A word once offered stays, unchanged, until it is taken. What comes into a block is assumed to keep
to this, what goes out is claimed to; all else is free in every clock, reset included. Where a block
asks more of what is around it, or needs an auxiliary invariant, :data:`CASES` tells.
"""

from dataclasses import dataclass, field

from amaranth.hdl import (
    Cat,
    DomainRenamer,
    Elaboratable,
    EnableInserter,
    Fragment,
    Module,
    Mux,
    ResetSignal,
    Signal,
    Value,
)
from amaranth.lib import stream, wiring

from hdl.link import texture
from hdl.stereo.undistort import _Phase as Phase
from tb.formal import symbiyosys as formal

__all__ = ["CASES", "Case", "ContractProof", "async_queue", "free_inputs", "stream_ports"]


@dataclass(frozen=True)
class Case:
    """What the proof of a block needs besides the block.

    Parameters
    ----------
    around : callable, optional
        Gets the module, the block and its signals (:func:`tb.formal.symbiyosys.internals`); adds
        assumptions about what is around the block, and invariants, which are claimed too.
    exempt : :class:`dict`
        Streams that go out for which nothing is claimed, and why.
    clocks : sequence of :class:`str`
        Domains, where there are several: in each step any of them may tick, or none. Streams
        belong to ``sync``.
    resets : :class:`bool`
        A reset may come at any time.
    bounded : :class:`int`
        Clocks from the start for which alone the contract is checked, where no induction closes.
    """

    around: object = None
    exempt: dict = field(default_factory=dict)
    clocks: tuple = ()
    resets: bool = True
    bounded: int = 0


def free_inputs(component):
    """Signals that come into ``component`` from without."""
    values = [(member.flow, Value.cast(value))
              for _, member, value in component.signature.flatten(component)]
    return [value for flow, value in values if flow == wiring.In and isinstance(value, Signal)]


def stream_ports(component):
    """Streams of ``component`` by name: those that come in, those that go out."""
    ports = {wiring.In: {}, wiring.Out: {}}

    def walk(name, signature, flow, value, dimensions):
        if dimensions:
            for index in range(dimensions[0]):
                walk(f"{name}_{index}", signature, flow, value[index], dimensions[1:])
        elif isinstance(signature, wiring.FlippedSignature):
            walk(name, signature.flip(), flow, value, ())
        elif isinstance(signature, stream.Signature):
            ports[flow][name] = value

    for name, member in component.signature.members.items():
        if member.is_signature:
            walk(name, member.signature, member.flow, getattr(component, name), member.dimensions)
    return ports[wiring.In], ports[wiring.Out]


def _past(m, value, name):
    """What ``value`` was in the clock before."""
    value = Value.cast(value)
    before = Signal(value.shape(), name=name, reset_less=True)
    m.d.sync += before.eq(value)
    return before


def keeps(m, name, port, tick=1):
    """Whether the stream ``port`` keeps to the contract, in this clock after the one before."""
    waiting = Signal(name=f"{name}_waiting", reset_less=True)
    offered = Value.cast(port.payload)
    before = Signal(offered.shape(), name=f"{name}_before", reset_less=True)
    m.d.sync += [
        waiting.eq(port.valid & ~(port.ready & tick) & ~ResetSignal()),
        before.eq(offered),
    ]
    return ~waiting | (port.valid & (offered == before))


class ContractProof(Elaboratable):
    """``component`` between streams that keep to the contract and readers that do as they like.

    Parameters
    ----------
    component : :class:`amaranth.lib.wiring.Component`
        Any block.
    case : :class:`Case`
        What it needs.
    """

    def __init__(self, component, case=None):
        self.component, self.case = component, case or Case()
        self.ticks = {domain: Signal(name=f"{domain}_tick") for domain in self.case.clocks}

    @property
    def ports(self):
        """Free inputs."""
        return [*self.ticks.values(), *free_inputs(self.component)]

    def elaborate(self, platform):
        m = Module()
        case = self.case
        inside = Fragment.get(self.component, platform)
        signals = formal.internals(inside)
        if case.around is not None:
            case.around(m, self.component, signals, inside)
        if case.clocks:
            m.submodules.block = DomainRenamer(
                dict.fromkeys(case.clocks, "sync"))(EnableInserter(self.ticks)(inside))
        else:
            m.submodules.block = inside
        if not case.resets:
            formal.assume(m, "no_reset", ~ResetSignal())
        takes, gives = stream_ports(self.component)
        for name, port in takes.items():
            formal.assume(m, name, keeps(m, name, port))
        for name, port in gives.items():
            if name not in case.exempt:
                formal.claim(m, name, keeps(m, name, port, self.ticks.get("sync", 1)))
        return m


def _binary(gray):
    """The number that is ``gray`` in Gray code."""
    return Cat(gray[n:].xor() for n in range(len(gray)))


def async_queue(m, signals, word, probe):
    """Invariants of an :class:`amaranth.lib.fifo.AsyncFIFO` between any two clocks.

    Its counters, and what each side knows of the other's, are passed on along a chain, and each
    is between the two beside it: what the writer knows of the reader, what is on its way there,
    the reader, what it knows of the writer, what is on its way, the writer.
    """
    writer, reader = signals["produce_w_bin"], signals["consume_r_bin"]
    to_reader = [_binary(signals[f"produce_cdc.stage{n}"]) for n in (0, 1)]
    to_writer = [_binary(signals[f"consume_cdc.stage{n}"]) for n in (0, 1)]
    formal.claim(m, "link_writer", _binary(signals["produce_w_gry"]) == writer)
    formal.claim(m, "link_reader", _binary(signals["consume_r_gry"]) == reader)
    chain = [(value - to_writer[1])[:len(writer)] for value in (
        to_writer[0], reader, to_reader[1], to_reader[0], writer)]
    for n, (one, other) in enumerate(zip(chain, chain[1:], strict=False)):
        formal.claim(m, f"link_chain_{n}", one <= other)
    formal.claim(m, "link_room", chain[-1] <= 1 << (len(writer) - 1))
    resets = [signals[f"rst_cdc.stage{n}"] for n in (0, 1)]
    formal.claim(m, "link_reset_0", ~resets[0] | (resets[1] & (to_reader[0] == writer)))
    formal.claim(m, "link_reset_1", ~resets[1] | ((to_reader[0] == reader)
                                                  & (to_reader[1] == reader)))
    formal.claim(m, "link_word", (reader == to_reader[1]) | (word == probe(reader[:-1])))


def _camera(m, block, g, inside):
    queue = {name.removeprefix("queue."): value for name, value in g.items()}
    async_queue(m, queue, Value.cast(block.o.payload),
                lambda address: formal.probe(inside, ("queue", "storage"), address))


def _frame_gate(m, block, g, inside):
    # A queue that has room for an announcement has it until that comes; the tag and the share
    # of frames are still while a frame begins.
    for name in ("info", "texture_info"):
        port = getattr(block, name)
        room = Signal(name=f"{name}_room", reset_less=True)
        m.d.sync += room.eq(port.ready & ~port.valid)
        formal.assume(m, f"{name}_room", ~room | port.ready)
    waits = Signal(reset_less=True)
    m.d.sync += waits.eq(block.i.valid & ~block.i.ready)
    for name in ("tag", "pattern_every"):
        port = getattr(block, name)
        formal.assume(m, name, ~waits | (
            Value.cast(port) == _past(m, port, f"{name}_before")))


def _depth(m, block, g, inside):
    step = g["step"]
    formal.claim(m, "link_step", (step & (step - 1)) == 0)
    formal.claim(m, "link_idle", ~block.o.valid | ~step.any())
    formal.claim(m, "link_held", ~(block.o.valid | step.any()) | block.i.valid)


def _undistort(m, block, g, inside):
    phase, turn, done = g["phase"], g["turn"], g["done"]
    idle = (phase == Phase.TURN.value) & (turn == 0)
    formal.claim(m, "link_phase", (phase <= Phase.APPLY.value) & (turn <= block.rounds))
    formal.claim(m, "link_done", ~done | idle)
    formal.claim(m, "link_held", (idle & ~done) | block.i.valid)
    for name, phases in (("turning", "TURN"), ("shifting", "SHIFT"), ("in_radius", "RADIUS"),
                         ("use_half", "SHIFT APPLY")):
        formal.claim(m, f"link_{name}", g[name] == Cat(
            phase == Phase[each].value for each in phases.split()).any())


def _image_bank(m, block, g, inside):
    # A frame begins while `free` is high and belongs to the bank until `stored` is taken.
    owned = Signal()
    begins = Signal()
    m.d.comb += begins.eq(block.i.valid & ~owned)
    with m.If(block.i.valid):
        m.d.sync += owned.eq(~block.i.p.marker.frame_end)
    formal.assume(m, "begins_while_free", ~begins | block.free)
    formal.claim(m, "link_owned", ~(block.stored.valid & (owned | block.free)))
    formal.claim(m, "link_free", ~(owned & block.free))


def _remap(m, block, g, inside):
    # Words answer what was asked for; those on their way are yet to come or in the queue.
    asked = Signal(5)
    asks = block.ask.valid & block.ask.ready
    m.d.sync += asked.eq(asked + asks - block.answer.valid)
    formal.assume(m, "answers", ~block.answer.valid | (asked != 0))
    level, under_way = g["queue.level"], g["under_way"]
    formal.claim(m, "link_way", under_way == asked + level)
    formal.claim(m, "link_most", under_way <= 8)
    _sync_queue(m, g, "queue", 8)
    # A pixel once read stays; nothing is read but for a frame that is read.
    was_read = _past(m, block.read, "read_before")
    formal.assume(m, "grey", was_read | (block.grey == _past(m, block.grey, "grey_before")))
    reading = block.start.valid & ~block.start.p
    formal.claim(m, "link_reading", reading | ~(under_way.any() | g["numbered"] | g["all_asked"]))


def _receiver(m, block, g, inside):
    # Octets come from the line, nine clocks or more from one to the next.
    pause = Signal(range(9), init=8)
    with m.If(block.i.valid):
        m.d.sync += pause.eq(0)
    with m.Elif(pause != 8):
        m.d.sync += pause.eq(pause + 1)
    formal.assume(m, "pauses", ~block.i.valid | (pause == 8))
    ended, held = g["ended"], block.o.valid
    formal.claim(m, "link_ended", ~ended | (g["empty"] & (pause == 0)))
    formal.claim(m, "link_held", ~held | g["empty"] | g["spoilt"])
    formal.claim(m, "link_spoilt", ~(held & ended) | ~g["whole"])


def _table_access(m, block, g, inside):
    # An access and all that belongs to it stay until it is done.
    waits = Signal(reset_less=True)
    m.d.sync += waits.eq((block.write | block.read) & ~block.done & ~ResetSignal())
    request = Cat(block.write, block.read, block.number, block.address, block.word,
                  block.octet_select)
    before = _past(m, request, "request_before")
    formal.assume(m, "request", ~waits | (request == before))
    formal.assume(m, "kind", ~(block.write & block.read))


def _commands(m, block, g, inside):
    # The buffer shows the octet of the address of the clock before.
    address = _past(m, block.address, "address_before")
    stays = Signal(reset_less=True)
    m.d.sync += stays.eq((address == block.address) & ~block.write_enable)
    data = _past(m, block.data, "data_before")
    formal.assume(m, "buffer", ~stays | (block.data == data))
    formal.claim(m, "link_shown", ~g["data_valid"] | (address == block.address))


def _framer(m, block, g, inside):
    # What is sent stands in a full half, which is not written to; and it has been read when it is
    # due, since a character is longer than a read.
    assembly, sending = g["assembly_state"], g["sending_state"]
    full, writing, reading = g["full"], g["write_half"], g["read_half"]
    shift, opening = 0, 0  # the first states
    formal.claim(m, "link_states", (assembly <= 2) & (sending <= 2))
    formal.claim(m, "link_empty", (assembly == shift) | ~full.bit_select(writing, 1))
    formal.claim(m, "link_full", (sending == opening) | full.bit_select(reading, 1))
    word = formal.probe(inside, ["memory"], Cat(g["read_position"], reading))
    formal.claim(m, "link_read", (sending != 1) | ~g["due"] | (block.o.payload == word[:8]))


def _texture(m, block, g, inside):
    # A frame comes if its announcement was taken, in the clock of its first pixel.
    inside_frame = Signal()
    with m.If(block.i.valid):
        m.d.sync += inside_frame.eq(~block.i.p.marker.frame_end)
    formal.assume(m, "announced", ~block.i.valid | inside_frame
                  | (block.info.valid & block.info.ready))
    state = g["fsm_state"]
    formal.claim(m, "link_due", (state == 0) | ~g["of_frame"] | g["frame_due"])
    formal.claim(m, "link_frame", ~inside_frame | ~g["frame_due"])
    index = g["index"]
    formal.claim(m, "link_idle", (state != 0) | (index == 0))
    formal.claim(m, "link_head", (state != 1) | (
        index < Mux(g["of_frame"], texture._FRAME_OCTETS, 1)))
    formal.claim(m, "link_words", (state < 2) | ~g["of_frame"])


def _sync_queue(m, g, prefix, depth):
    """Invariant of an :class:`amaranth.lib.fifo.SyncFIFO` with a power of two of places."""
    level = g[f"{prefix}.level"]
    formal.claim(m, f"link_{prefix}_most", level <= depth)
    formal.claim(m, f"link_{prefix}", (
        (g[f"{prefix}.produce"] - g[f"{prefix}.consume"] - level) & (depth - 1)) == 0)


def _point_limiter(m, block, g, inside):
    # The limit changes only between frames, so not while a point waits.
    waits = Signal(reset_less=True)
    m.d.sync += waits.eq(block.i.valid & ~block.i.ready)
    limit = _past(m, block.limit, "limit_before")
    formal.assume(m, "limit", ~waits | (block.limit == limit))
    _sync_queue(m, g, "queue", block.frames)


def _addressed_camera(m, block, g, inside):
    # Every conversion under way has its place in the queue.
    _sync_queue(m, g, "queue", block.depth)
    under_way = sum(g[f"word_{stage}"][0] for stage in range(1, block.latency))
    formal.claim(m, "room", g["room"] + g["queue.level"] + under_way == block.depth)


CASES = {
    "addressed_camera": Case(_addressed_camera),
    "depth": Case(_depth),
    "undistort": Case(_undistort),
    "point_limiter": Case(_point_limiter),
    "framer": Case(_framer),
    "texture": Case(_texture),
    "image_bank": Case(_image_bank),
    "remap": Case(_remap),
    "receiver": Case(_receiver),
    "table_access": Case(_table_access),
    "table_access, paper": Case(_table_access),
    "commands": Case(_commands),
    "commands, paper": Case(_commands),
    "camera": Case(_camera, clocks=("sync", "pixel"), resets=False),
    "sram_frames": Case(clocks=("sync", "display"), resets=False),
    "frame_gate": Case(_frame_gate, exempt=dict.fromkeys(
        ("info", "texture_info"), "for a queue that takes at once or not at all")),
}
