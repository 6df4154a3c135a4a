"""The list of planted faults fits the sources; the faults themselves are not run here."""

import ast

import pytest

from scripts.paths import ROOT
from tb.benchmark import planted_faults
from tb.benchmark.faults import FAULTS, Fault


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_fault_fits_the_sources(fault):
    text = (ROOT / fault.file).read_text()
    assert text.count(fault.old) == 1
    assert fault.new != fault.old
    if fault.file.endswith(".py"):
        ast.parse(text.replace(fault.old, fault.new))
    file, _, function = fault.test.partition("::")
    tree = ast.parse((ROOT / file).read_text())
    assert function in [each.name for each in tree.body if isinstance(each, ast.FunctionDef)]


def test_names_are_unique():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)


@pytest.mark.parametrize("text", ["a = 2\n", "a = 1\nb = a = 1\n"])
def test_text_must_be_there_once(text, tmp_path):
    (tmp_path / "block.py").write_text(text)
    fault = Fault("block_wrong", "block.py", "a = 1", "a = 3", "tb/test_block.py::test_block")
    with pytest.raises(ValueError, match="exactly once"):
        planted_faults.plant(fault, tmp_path)
    assert (tmp_path / "block.py").read_text() == text


@pytest.mark.parametrize("found", [["tb/test_a.py::test_a[1]", ""], ["tb/test_a.py::test_a"] * 2])
def test_status_tells_whether_all_are_found(found, monkeypatch, capsys):
    answers = iter(found)
    monkeypatch.setattr(planted_faults, "found_by", lambda fault: next(answers))
    status = planted_faults.main([fault.name for fault in FAULTS[:2]])
    assert status == ("" in found)
    lines = capsys.readouterr().out.splitlines()
    assert [("NOT FOUND" in line) for line in lines[:2]] == [not test for test in found]
    assert lines[2] == f"{2 - found.count('')} of 2 found"


def test_unknown_name(capsys):
    with pytest.raises(SystemExit) as stop:
        planted_faults.main(["no_such_fault"])
    assert stop.value.code == 2
    assert "There is no fault 'no_such_fault'" in capsys.readouterr().err
