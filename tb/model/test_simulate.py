"""Simulated capture folders, and the command that writes them."""

import csv
import filecmp

import cv2
import numpy as np
import pytest

from calibration.capture import read_capture, read_image
from model.errors import UserError
from model.optics import render
from model.optics.rigs import RIGS
from scripts.cyclope import cli


def files(path):
    """Names of all files below a folder."""
    return sorted(str(file.relative_to(path)) for file in path.rglob("*") if file.is_file())


def test_capture_holds_what_the_contract_says(small_capture):
    rig, found = RIGS["small"], read_capture(small_capture)
    assert (found.width, found.height) == (64, 64) and found.projector.beams == 16
    assert (found.board_columns, found.board_rows, found.square_mm) == (5, 4, 8.0)
    lens, planes = found.lens_images(), found.plane_images()
    assert len(lens) == 15 and len(planes) >= 8
    for _, image in lens:
        assert cv2.findChessboardCorners(image, (5, 4))[0]
    names = [f"{number:04}_{kind}.png" for number in range(5) for kind in ("ir", "texture")]
    assert sorted(file.name for file in (small_capture / "frames").iterdir()) == names
    for name in names:
        read_image(small_capture / "frames" / name, 64, 64)
    rows = list(csv.DictReader((small_capture / "truth.csv").open()))
    assert ",".join(rows[0]) == "frame,beam,u_px,v_px,x_mm,y_mm,z_mm,inside"
    assert [(row["frame"], row["beam"]) for row in rows] == [
        (str(frame), str(beam)) for frame in range(5) for beam in range(16)]
    distances = {float(row["z_mm"]) for row in rows}
    assert len(distances) == 5 and min(distances) < 50 and max(distances) > 85
    assert min(abs(z - plane) for z in distances for _, plane, _ in planes) > 0.01
    for row in rows:
        image = rig.camera.project(np.array([[float(row[name]) for name in (
            "x_mm", "y_mm", "z_mm")]]))[0]
        np.testing.assert_allclose(image, [float(row["u_px"]), float(row["v_px"])], atol=1e-5)
        assert row["inside"] == "1"


def test_plane_frames_show_the_plane_that_the_table_says(small_capture):
    rig = RIGS["small"]
    for _, z_mm, image in read_capture(small_capture).plane_images():
        spots = rig.camera.project(rig.projector.points_at(z_mm))
        at = image[tuple(np.rint(spots[:, ::-1]).astype(int).T)]
        assert at.min() > 50


def test_same_seed_gives_the_same_bytes(small_capture, tmp_path):
    arguments = ["--rig", "small", "--frames", "5"]
    assert cli.main(["simulate", "plane", tmp_path / "a", *arguments, "--seed", "3"]) == 0
    assert cli.main(["simulate", "plane", tmp_path / "b", *arguments, "--seed", "4"]) == 0
    names = files(small_capture)
    assert files(tmp_path / "a") == names and files(tmp_path / "b") == names
    assert filecmp.cmpfiles(small_capture, tmp_path / "a", names, shallow=False)[0] == names
    assert filecmp.cmpfiles(small_capture, tmp_path / "b", names, shallow=False)[0] == [
        "planes/planes.csv"]


def test_split_spots_can_be_asked_for(small_capture, tmp_path):
    assert cli.main(["simulate", "plane", tmp_path / "a", "--rig", "small", "--seed", "3",
                     "--frames", "5", "--split-spots"]) == 0
    same = filecmp.cmpfiles(small_capture, tmp_path / "a", files(small_capture), shallow=False)[0]
    assert {"truth.csv", "capture.toml"} <= set(same)
    assert not [name for name in same if name.endswith("_ir.png")]


@pytest.mark.parametrize("arguments, words", [
    (["cube", "OUT"], "cube"), (["plane", "OUT", "--seed", "-1"], "--seed must be 0 or more"),
    (["plane", "OUT", "--frames", "0"], "--frames must be 1 to 10000, not 0"),
    (["plane", "OUT", "--rig", "none"], "none"), (["plane"], "OUT")])
def test_simulate_refuses_bad_arguments(arguments, words, tmp_path, capsys):
    arguments = [tmp_path / "out" if word == "OUT" else word for word in arguments]
    assert cli.main(["simulate", *arguments]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1 and not list(tmp_path.iterdir())


def test_simulate_leaves_a_filled_folder_alone(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert cli.main(["simulate", "plane", tmp_path, "--rig", "small", "--frames", "1"]) == 2
    assert "already holds files" in capsys.readouterr().err
    assert files(tmp_path) == ["mine.txt"]


def test_simulate_leaves_nothing_half_written(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise UserError("The disk is full.")
    monkeypatch.setattr(render, "texture_frame", fail)
    assert cli.main(["simulate", "plane", tmp_path / "out", "--rig", "small"]) == 2
    assert "The disk is full." in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_default_seed_of_the_small_rig_calibrates(tmp_path):
    capture = tmp_path / "capture"
    assert cli.main(["simulate", "plane", capture, "--rig", "small", "--frames", "1"]) == 0
    assert cli.main(["calibrate", capture, "-o", tmp_path / "calibration.json"]) == 0
