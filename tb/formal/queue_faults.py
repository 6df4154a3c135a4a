"""Faults planted in queues and in the handshakes of blocks, to be found by the proofs."""

from dataclasses import dataclass, field

from tb.formal.altered import altered
from tb.formal.queues import QUEUES, QueueProof
from tb.formal.streams import CASES, Case, ContractProof

__all__ = ["FAULTS", "Fault"]


@dataclass(frozen=True)
class Fault:
    """A planted fault.

    ``module`` and ``name`` tell the class, ``edits`` are pairs of a text and what stands there
    instead, ``breaks`` are the claims of which one must fail within ``depth`` clocks. ``queue``
    is the entry of :data:`tb.formal.queues.QUEUES` that follows it; without one it is the stream
    contract that fails.
    """

    what: str
    module: str
    name: str
    edits: tuple
    breaks: tuple
    queue: str = ""
    arguments: dict = field(default_factory=dict)
    depth: int = 20

    def proof(self):
        """The design of the proof, with the fault in it."""
        component = getattr(altered(self.module, self.edits), self.name)(**self.arguments)
        if self.queue:
            return QueueProof(component, QUEUES[self.queue].follow)
        return ContractProof(component, CASES.get(self.module.rpartition(".")[2], Case()))


def _small(*edits):
    """Few slots, so that the queue is soon full."""
    return (("_BLOCK_WORDS = 512", "_BLOCK_WORDS = 12"), *edits)


_STAGE, _POINTS = "hdl.common.stage", "hdl.common.point_fifo"
_SPOTS = "hdl.preprocessing.spot_queue"
FAULTS = (
    Fault("stage: takes a word while it holds one", _STAGE, "Stage", (
        ("self.i.ready.eq(~self.o.valid | self.o.ready)", "self.i.ready.eq(1)"),),
        ("order", "nothing_lost"), "stage", {"shape": 8}),
    Fault("stage: a word changes while it waits", _STAGE, "Stage", (
        ("self.i.ready.eq(~self.o.valid | self.o.ready)", "self.i.ready.eq(1)"),), ("o",),
        arguments={"shape": 8}),
    Fault("stage: makes words up", _STAGE, "Stage", (
        ("self.o.valid.eq(self.i.valid)", "self.o.valid.eq(1)"),), ("nothing_more",), "stage",
        {"shape": 8}),
    Fault("point_fifo: takes a point too many", _POINTS, "PointFIFO", _small(
        ("room.eq(level != self.slots)", "room.eq(1)")),
        ("order", "nothing_lost"), "point_fifo"),
    Fault("point_fifo: a point that waits is overwritten", _POINTS, "PointFIFO", _small(
        ("(level != 0) & ~self.o.valid),", "level != 0),")), ("order", "nothing_lost"),
        "point_fifo"),
    Fault("point_fifo: a point changes while it waits", _POINTS, "PointFIFO", _small(
        ("(level != 0) & ~self.o.valid),", "level != 0),")), ("o",)),
    Fault("point_fifo: reads what is not yet written", _POINTS, "PointFIFO", _small(
        ("level + push - fetch", "level + (write.en & (write_part == 0)) - fetch")),
        ("order", "nothing_lost"), "point_fifo"),
    Fault("point_fifo: a point comes out twice", _POINTS, "PointFIFO", _small(
        ("read_index.eq(self._next(read_index))", "read_index.eq(read_index)")), ("order",),
        "point_fifo"),
    Fault("spot_queue: no slots for end markers", _SPOTS, "SpotQueue", (
        ("self.depth - _END_SLOTS", "self.depth"),), ("order", "room_for_ends"), "spot_queue",
        {"depth": 8}),
    Fault("spot_queue: dropped spots are not counted", _SPOTS, "SpotQueue", (
        ("~rejected & ~room)]", "~rejected & ~room & C(0))]"),), ("conservation",), "spot_queue",
        {"depth": 8}),
    Fault("spot_queue: counters are overwritten", _SPOTS, "SpotQueue", (
        ("& (~self.counts.valid | self.counts.ready)):", "):"),), ("counts_first",), "spot_queue",
        {"depth": 8}),
    Fault("spot_queue: counters come behind their frame", _SPOTS, "SpotQueue", (
        ("(~shown.end | counted)", "C(1)"),), ("counts_first",), "spot_queue", {"depth": 8}),
    Fault("depth: a point does not wait", "hdl.stereo.depth", "Depth", (
        ("with m.If(takes):\n", "with m.If(self.o.valid):\n"),), ("o",)),
    Fault("depth: the next spot is shown in its place", "hdl.stereo.depth", "Depth", (
        ("self.i.ready.eq(takes)", "self.i.ready.eq(step[3])"),), ("o",)),
    Fault("camera: a pixel that waits is skipped", "hdl.acquisition.camera", "Camera", (
        ("queue.r_en.eq(self.o.ready)", "queue.r_en.eq(1)"),), ("o",),
        arguments={"width": 8, "height": 4}),
    Fault("table_access, paper: the memory is not waited for", "hdl.link.table_access",
          "TableAccess", (("with m.If(self.memory.ready):", "with m.If(C(1)):"),), ("memory",),
          arguments={"preset": "paper"}),
)
