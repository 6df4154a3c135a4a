# amaranth: UnusedElaboratable=no
"""All ways to join three labels, for some clocks; and planted faults are found."""

import pytest

from tb.formal.label_joiner import FAULTS, joiner_fault_outcome, joiner_outcome


def test_three_labels():
    outcome = joiner_outcome()
    assert outcome.result == "held", (outcome.failed, outcome.log[-2000:])


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.replace(" ", "_"))
def test_planted_faults_are_found(fault):
    outcome = joiner_fault_outcome(fault)
    assert outcome.result == "failed", outcome.log[-2000:]
