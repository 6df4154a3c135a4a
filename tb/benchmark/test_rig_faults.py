"""The part ``calibration`` of the benchmark measures what it says."""

from tb.benchmark import rig_faults


def test_a_fault_is_measured():
    row = rig_faults.measure(rig_faults.Case("both", offset_mm=1.0, dead=1), [1])
    assert row.found.startswith("left out [1], offset off by 0.0")
    assert row.found.endswith("100.0% of the beams found")
    assert 0.02 < float(row.error.rstrip("%")) < 0.12


def test_photographs_are_measured():
    assert rig_faults.frontal_boards([0]).found == "1 of 1 refused or flagged"
    rows = rig_faults.capsules()
    assert [row.case for row in rows] == ["MiroCam, 5 photographs", "PillCam, 8 photographs"]
    assert all(0.2 < float(row.error.split()[0]) < 0.6 for row in rows)
