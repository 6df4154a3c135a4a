# amaranth: UnusedElaboratable=no
"""Exclusion of writer and reader, without bound and for any two clocks."""

import pytest

from hdl.acquisition.frame_banks import FrameBanks
from tb.acquisition.bank_faults import FAULTS, planted
from tb.formal import symbiyosys as formal
from tb.formal.frame_banks import BanksProof


def outcome(name, banks, **options):
    proof = BanksProof(banks, **{key: options.pop(key) for key in ("properties", "linked")
                                 if key in options})
    return formal.prove(name, formal.to_rtlil(proof), **options)


@pytest.mark.parametrize("banks", [2, 3])
def test_banks_are_exclusive(banks):
    done = outcome(f"frame_banks_{banks}", FrameBanks(banks, 1))
    assert done.result == "proved", (done.failed, done.log[-2000:])


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_found(fault):
    """By what the ports show, without the invariants."""
    done = outcome(f"frame_banks_fault_{list(FAULTS).index(fault)}", planted(fault, 2, 1),
                   mode="bmc", depth=40, linked=False)
    assert done.result == "failed", done.log[-2000:]
