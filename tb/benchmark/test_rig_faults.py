"""The part ``calibration`` of the benchmark measures what it says."""

from tb.benchmark import rig_faults


def test_all_faults_at_once():
    row = rig_faults.measure(rig_faults.ALL_AT_ONCE, [1])
    assert row.found.startswith("left out [2], offset off by 0.0")
    found, wrong = (float(part.split("%")[0].split()[-1]) for part in row.found.split(",")[2:])
    assert found > 98 and wrong <= 0.3
    assert 0.1 < float(row.error.rstrip("%")) < 100 * rig_faults.ALL_AT_ONCE.limit


def test_photographs_are_measured():
    assert rig_faults.frontal_boards([0]).found == "1 of 1 refused or flagged"
    rows = rig_faults.capsules()
    assert [row.case for row in rows] == ["MiroCam, 5 photographs", "PillCam, 8 photographs"]
    assert all(0.2 < float(row.error.split()[0]) < 0.6 for row in rows)
