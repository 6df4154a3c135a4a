"""``cyclope measure``: the same numbers in every form and from every source, or one sentence."""

import csv
import json

import numpy as np
import pytest

from calibration import file
from model.optics.scenes import Plane
from scripts.cyclope import cli
from scripts.host.history import read_history
from scripts.measure.records import CSV_HEADER
from scripts.results.outputs import write_csv
from tb.host.bench import record
from tb.measure.simulated import calibration_of, measured, mesh_rig

NOISE_PX = 0.04
POINTS = ("--points", "120,90", "200,160")
RIM = ("150,120", "190,120", "190,160", "150,160", "170,168", "170,112")


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A folder with points.csv of frames 4, 6 and 8, and the calibration."""
    folder = tmp_path_factory.mktemp("result")
    rig = mesh_rig(11)
    calibration = calibration_of(rig, NOISE_PX)
    rng = np.random.default_rng(1)
    write_csv(folder / "points.csv", np.concatenate([
        measured(rig, calibration, Plane(60, 20, 30), rng, NOISE_PX, frame)
        for frame in (4, 6, 8)]))
    file.save(calibration, folder / "calibration.json")
    return folder


def measure(result, *words):
    return cli.main(["measure", result, "--calibration", result / "calibration.json",
                     *map(str, words)])


def test_every_form_has_the_same_numbers(result, capsys, tmp_path):
    assert measure(result, "--frame", 6, *POINTS, "--format", "json") == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["frame"] == 6 and plain["kind"] == "ruler" and plain["frames"] == 1
    assert plain["points_px"] == [[120, 90], [200, 160]]
    ends = np.array(plain["ends_mm"])
    assert np.isclose(np.linalg.norm(ends[1] - ends[0]), plain["length_mm"], atol=1e-3)
    assert 0 < plain["uncertainty_mm"] < 0.2
    assert measure(result, "--frame", 6, *POINTS, "-o", tmp_path / "m.csv") == 0
    said = capsys.readouterr().out
    row, = csv.DictReader((tmp_path / "m.csv").open())
    assert (tmp_path / "m.csv").read_text().startswith(CSV_HEADER + "\n")
    assert float(row["length_mm"]) == plain["length_mm"]
    assert row["points_px"] == "120.00 90.00;200.00 160.00" and row["size_class"] == ""
    assert f"frame 6: distance {plain['length_mm']:.2f} mm +- " in said
    assert measure(result, "--frame", 6, *POINTS, "-o", tmp_path / "m.json") == 0
    assert json.loads((tmp_path / "m.json").read_text()) == plain


def test_polyp_and_mean(result, capsys):
    assert measure(result, "--frame", 4, "--mean", 3, "--polyp", *RIM, "--format", "json") == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["frames"] == 3 and plain["kind"] == "polyp"
    assert plain["size_class"] in ("6-9 mm", "10-19 mm") and len(plain["rim_mm"]) == len(RIM)
    assert measure(result, "--frame", 4, "--circle", "170,140,28") == 0
    assert "longest diameter" in capsys.readouterr().out


@pytest.mark.parametrize("words, sentence", [
    (("--frame", 5, *POINTS), "has no points of frame 5: its frames are numbered 4 to 8"),
    (("--frame", 4, "--points", "120;90", "1,2"), "--points takes 2 numbers with commas"),
    (("--frame", 4, "--points", "120,nan", "1,2"), "--points takes 2 numbers with commas"),
    (("--frame", 4, "--polyp", "120,90", "1,2"), "three points or more, not 2"),
    (("--frame", 4, "--circle", "120,90,-3"), "The radius of --circle must be above 0, not -3."),
    (("--frame", 4, "--points", "1,2", "120,90"), "no measured surface at 1.0,2.0 in frame 4"),
    (("--frame", 4, "--mean", 0, *POINTS), "--mean must be 1 to 1000, not 0."),
    (("--frame", 4, *POINTS, "-o", "x.txt"), "-o takes the name of a .json or a .csv, not x.txt."),
    (("--frame", 4), "one of the arguments --points --polyp --circle is required"),
])
def test_bad_input_is_one_sentence(result, words, sentence, capsys):
    assert measure(result, *words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and sentence in error


def test_sources_that_are_none(result, capsys, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "foreign").write_bytes(b"no packet in here" * 9)
    for source, sentence in (("none", "does not exist."), ("empty", "holds no points.csv"),
                             ("foreign", "holds no packet of the chip")):
        assert cli.main(["measure", tmp_path / source, "--calibration",
                         result / "calibration.json", "--frame", "1", *POINTS]) == 2
        assert sentence in capsys.readouterr().err


def test_a_recording_measures_as_its_tables_do(tmp_path, capsys):
    """Points of the chip, which no rig made, so the lengths mean nothing; but they are the same."""
    calibration = record(tmp_path, 6)
    history = read_history(tmp_path / "out" / "link.raw", calibration)
    assert history.count >= 5
    capsys.readouterr()
    moment = history.moment(2)
    words = ["--calibration", tmp_path / "calibration.json", "--frame", moment.frame.index,
             "--format", "json"]
    answers = []
    for source in (tmp_path / "out", tmp_path / "out" / "link.raw"):
        # Wherever there is surface: the mesh of these spots has some cells.
        status = cli.main(["measure", source, *map(str, words), "--points", "20,20", "40,30"])
        output = capsys.readouterr()
        answers.append(output.out if status == 0 else output.err)
    assert answers[0] == answers[1] or np.isclose(
        *(json.loads(answer)["length_mm"] for answer in answers), rtol=1e-3)
