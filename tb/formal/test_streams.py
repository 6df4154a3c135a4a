# amaranth: UnusedElaboratable=no
"""The stream contract at every port, and queues that keep what they take."""

import gc

import pytest
from amaranth.hdl import Const, Elaboratable, Fragment, Signal

from hdl.common.stage import Stage
from scripts.rtl.blocks import BLOCKS, VARIANTS, find
from tb.formal import prove
from tb.formal import symbiyosys as formal
from tb.formal.queue_faults import FAULTS
from tb.formal.queues import QUEUES
from tb.formal.streams import CASES, ContractProof, stream_ports

NAMED = {block.name: block for block in (*BLOCKS, *VARIANTS)}
STREAMING = {block.name: names for block, names in prove.streaming_blocks()}


@pytest.mark.parametrize("name", dict.fromkeys((*STREAMING, *(block.name for block in VARIANTS))))
def test_stream_contract(name):
    outcome = prove.contract_outcome(NAMED[name])
    wanted = "held" if name in CASES and CASES[name].bounded else "proved"
    assert outcome.result == wanted, (outcome.failed, outcome.log[-3000:])


@pytest.mark.parametrize("name", QUEUES)
def test_queue(name):
    outcome = prove.queue_outcome(name)
    assert outcome.result == "proved", (outcome.failed, outcome.log[-3000:])


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.what.replace(" ", "_"))
def test_planted_fault_is_found(fault):
    outcome = prove.queue_fault_outcome(fault)
    assert outcome.result == "failed", outcome.log[-3000:]
    assert outcome.failed and set(outcome.failed) <= set(fault.breaks)


class _Vacuous(Elaboratable):
    """The surroundings of a proof, and a claim that is false in the ninth clock."""

    def __init__(self, proof):
        self.proof, self.ports = proof, proof.ports

    def elaborate(self, platform):
        m = self.proof.elaborate(platform)
        count = Signal(4, reset_less=True)
        m.d.sync += count.eq(count + 1)
        formal.claim(m, "false", count != 8)
        return m


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
@pytest.mark.parametrize("name", sorted(name for name in CASES if CASES[name].around))
def test_assumptions_leave_something(name):
    """What is assumed about a block's surroundings is not a contradiction in itself."""
    proof = ContractProof(NAMED[name].component(), CASES[name])
    text = formal.to_rtlil(_Vacuous(proof), ("false",))
    outcome = formal.prove(f"vacuous {name}", text, "bmc", 10)
    assert outcome.result == "failed" and outcome.failed == ("false",)


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
def test_every_stream_is_looked_at():
    assert STREAMING.keys() >= {"camera", "labelling", "spot_queue", "depth", "point_fifo"}
    assert STREAMING["spot_queue"] == ["o", "counts"]
    assert set(CASES) <= set(NAMED)
    for name, case in CASES.items():
        assert set(case.exempt) <= set(stream_ports(NAMED[name].component())[1])
    assert set(stream_ports(NAMED["commands, paper"].component())[1]) == {"o", "memory"}
    gc.collect()


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
def test_what_the_design_uses_is_what_is_proved():
    """Queues from amaranth's library are followed at the depths that the design has."""
    capsule = Fragment.get(find("capsule").component(), None)
    depths = {(name.rpartition(".")[0].rpartition(".")[2], memory._data.depth)
              for name, memory in _memories(capsule) if name.endswith(".storage")}
    assert depths == {("frame_info", 4), ("detection_fifo", 4), ("queue", 4), ("queue", 16)}
    gc.collect()


def _memories(fragment, path=""):
    for inner, name, _ in fragment.subfragments:
        if isinstance(inner, formal.MemoryInstance):
            yield f"{path}{name}", inner
        yield from _memories(inner, f"{path}{name}.")


def test_a_probe_wants_a_memory():
    with pytest.raises(LookupError, match="There is no memory at "):
        formal.probe(Fragment.get(Stage(8), None), (), Const(0))
