"""The whole calibration, from noisy frames, and its command."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration import file
from calibration.calibrate import Options, calibrate_beams, with_lens
from calibration.chessboards import LensReport
from calibration.projector import Projector
from calibration.remap import remap_table
from calibration.spots import plane_spots
from model.optics import render, rigs, scenes
from model.optics.rigs import RIGS
from model.paper import Paper
from model.settings import Settings
from scripts.cyclope import cli
from tb.model.rig_spots import board_views, depth_errors, lens_of


def calibrated(rig, seed, settings, planes=12):
    """Calibration from simulated plane frames, nominal values off by their default error."""
    rng = np.random.default_rng(seed)
    lens = lens_of(rig)
    settings = with_lens(settings, lens)
    spots = [plane_spots(f"{z}.png", z, render.pattern_frame(rig, scenes.Plane(z), rng)[0],
                        settings, lens) for z in rig.calibration_planes(planes)]
    nominal = rigs.nominal(rig, rng)
    projector = Projector(rig.projector.rows, rig.projector.columns, nominal.pitch_deg,
                          nominal.rotation_deg, nominal.toe_in_deg, nominal.base_mm)
    return calibrate_beams(spots, projector, lens, LensReport(0.05), Options(settings), settings)


@pytest.mark.parametrize("name, seed, weighted, limit", [
    *(("endoscope", seed, True, 0.0012) for seed in range(5)), ("endoscope", 5, False, 0.007),
    ("endoscope", 6, False, 0.007), ("demonstrator", 7, True, 0.0005),
    ("demonstrator", 8, True, 0.0005)])
def test_depth_is_as_good_as_promised(name, seed, weighted, limit):
    settings = Settings(weighted=weighted)
    result = calibrated(RIGS[name], seed, settings)
    budget = result.calibration.budget
    assert budget["depth_relative"] <= 1e-4 and budget["undistortion_px"] <= 0.01
    assert budget["centre_px"] <= 0.005 and budget["line_px"] <= 0.003
    error, found = depth_errors(RIGS[name], result.calibration, ("plane", "tilted"), 4, seed)
    assert error.mean() <= limit and found >= 0.97 and (error > 0.05).mean() <= 0.001
    assert 0.5 < budget["expected_depth_relative"] / error.mean() < 1.5


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A small capture folder: 8 chessboards, 6 planes, nominal values off."""
    folder = tmp_path_factory.mktemp("capture")
    rig, rng = RIGS["endoscope"], np.random.default_rng(21)
    nominal = rigs.nominal(rig, rng)
    base = ", ".join(map(str, nominal.base_mm))
    (folder / "capture.toml").write_text(
        f"[sensor]\nwidth = 352\nheight = 288\nfocal_px = {nominal.focal_px}\n"
        f"[projector]\nrows = 7\ncolumns = 7\npitch_deg = {nominal.pitch_deg}\n"
        f"rotation_deg = {nominal.rotation_deg}\ntoe_in_deg = {nominal.toe_in_deg}\n"
        f"base_mm = [{base}]\n"
        "[lens]\nboard_columns = 9\nboard_rows = 6\nsquare_mm = 4.0\n")
    (folder / "lens").mkdir()
    for name, image in board_views()[1][:8]:
        cv2.imwrite(str(folder / "lens" / name), image)
    (folder / "planes").mkdir()
    rows = ["file,z_mm"]
    for number, z in enumerate(rig.calibration_planes(6)):
        image, _ = render.pattern_frame(rig, scenes.Plane(z), rng)
        cv2.imwrite(str(folder / "planes" / f"{number}.png"), image)
        rows.append(f"{number}.png,{z}")
    (folder / "planes" / "planes.csv").write_text("\n".join(rows) + "\n")
    return folder


def changed(capture, tmp_path, edit):
    """A copy of a capture folder with a change."""
    copy = tmp_path / "capture"
    shutil.copytree(capture, copy)
    edit(copy)
    return copy


def replace_in(path, old, new):
    """Edit a text file."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_command_writes_calibration_and_picture(capture, tmp_path, capsys):
    output = tmp_path / "calibration.json"
    assert cli.main(["calibrate", capture, "-o", output]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"calibration.json", "calibration.png"}
    text = capsys.readouterr().out
    for word in ("px RMS", "line separation", "depth range", "worst beam", "1/z"):
        assert word in text
    calibration = file.load(output)
    assert calibration.settings == replace(
        calibration.settings, mean_window=11, fixed_noise=0, lit_gain=18, core_gain=24, dent_gain=4,
        weighted=True)
    error, found = depth_errors(RIGS["endoscope"], calibration, ("plane",), 4, 23)
    assert error.mean() <= 0.0012 and found >= 0.97
    picture = cv2.imread(str(tmp_path / "calibration.png"))
    assert picture.shape[1] >= 1200 and picture.std() > 20


def test_choices_go_into_the_file(capture, tmp_path):
    output = tmp_path / "calibration.json"
    assert cli.main(["calibrate", capture, "-o", output, "--no-picture", "--noise", "3",
                     "--lit", "1.25", "--core", "2.25", "--dent", "0", "--window", "13",
                     "--centre", "binary", "--area-min", "4", "--area-max", "200",
                     "--depth-min", "45", "--depth-max", "100"]) == 0
    calibration = file.load(output)
    settings = calibration.settings
    assert (settings.fixed_noise, settings.mean_window, settings.weighted) == (24, 13, False)
    assert (settings.lit_gain, settings.core_gain, settings.dent_gain) == (20, 36, 0)
    assert (settings.area_min, settings.area_max) == (4, 200)
    assert (calibration.z_min, calibration.z_max) == (45, 100)
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]


def test_calibration_for_whole_image_correction(capture, tmp_path):
    """The preset paper finds the spots, and measures, in corrected images."""
    output = tmp_path / "calibration.json"
    assert cli.main(["calibrate", capture, "-o", output, "--no-picture", "--preset", "paper"]) == 0
    calibration = file.load(output)
    settings = calibration.settings
    assert settings.remap == remap_table(calibration.lens)
    assert (settings.erosion, settings.weighted) == ("erode", False)
    error, found = depth_errors(RIGS["endoscope"], calibration, ("plane",), 4, 23, Paper)
    assert error.mean() <= 0.009 and found >= 0.97


def resized(folder, size):
    """Give all images of a folder another size."""
    for path in folder.iterdir():
        cv2.imwrite(str(path), cv2.resize(cv2.imread(str(path), 0), size))


def one_distance(path):
    """Give all planes the same distance."""
    names = [line.split(",")[0] for line in path.read_text().splitlines()[1:]]
    path.write_text("\n".join(["file,z_mm", *(f"{name},60" for name in names)]) + "\n")


@pytest.mark.parametrize("edit, options, message", [
    (lambda c: None, ["--preset", "paper", "--centre", "weighted"],
     "--preset paper has binary centres only"),
    (lambda c: None, ["--preset", "paper", "--lit", "1"], "--lit is for the preset capsule only"),
    (lambda c: None, ["--alpha", "5"], "--alpha is for the preset paper only"),
    (lambda c: None, ["--noise", "0"], "--noise must be 0.125 to 63.8 or 'adaptive', not '0'"),
    (lambda c: None, ["--core", "4"], "--core must be 0.0625 to 3.9, not 4"),
    (lambda c: None, ["--window", "10"], "--window must be odd and 5 to 31, not 10"),
    (lambda c: None, ["--preset", "paper", "--threshold", "0"],
     "--threshold must be 1 to 255 or 'adaptive', not '0'"),
    (lambda c: None, ["--preset", "paper", "--alpha", "16"], "--alpha must be 0 to 15.9, not 16"),
    (lambda c: None, ["--dead", "1,2", "7,0"], "--dead must be ROW,COLUMN, counted from 0, of the "
     "7 x 7 mesh, not '7,0'"),
    (lambda c: None, ["--dead", "12"], "--dead must be ROW,COLUMN"),
    (lambda c: None, ["--area-min", "0"], "--area-min must be 1 to 1023, not 0"),
    (lambda c: None, ["--area-min", "9", "--area-max", "8"], "--area-min must not be above"),
    (lambda c: None, ["--noise", "63", "--core", "3.9"],
     "No spots were found in 6 of the 6 plane frames"),
    (lambda c: None, ["--depth-min", "90", "--depth-max", "50"], "The depth range 90 to 50 mm is "),
    (lambda c: replace_in(c / "capture.toml", "columns = 7", "columns = 6"), [],
     "continue the 7 x 6 mesh"),
    (lambda c: replace_in(c / "capture.toml", "board_rows = 6", "board_rows = 5"), [],
     "The 9 x 5 inner corners of the chessboard were found in"),
    (lambda c: (c / "planes" / "planes.csv").write_text(
        "\n".join((c / "planes" / "planes.csv").read_text().splitlines()[:4]) + "\n"), [],
     "show 3 distances, at least 4"),
    (lambda c: replace_in(c / "capture.toml", "width = 352", "width = 320"), [],
     "All images have 352 x 288 pixels, but "),
    (lambda c: resized(c / "lens", (320, 320)), [],
     "The chessboard photographs have 320 x 320 pixels, of another sensor, scaled or cropped, and "
     "the plane frames 352 x 288"),
    (lambda c: resized(c / "lens", (288, 352)), [], "have 288 x 352 pixels, turned by a quarter"),
    (lambda c: one_distance(c / "planes" / "planes.csv"), [],
     "All plane frames are at one distance by planes.csv"),
    (lambda c: replace_in(c / "capture.toml", "pitch_deg = 6", "pitch_deg = 0 # "), [],
     "pitch_deg in [projector] must"),
    (lambda c: replace_in(c / "capture.toml", "base_mm = [", "base_mm = [0, 1, 2] # "), [],
     "base_mm in [projector] must"),
], ids=["preset", "lit", "of paper", "noise", "core", "window", "threshold", "alpha",
        "dead", "dead number", "area",
        "areas", "dark", "depth", "mesh", "board", "planes", "size", "sensor", "turned",
        "one distance", "pitch", "base"])
def test_command_refuses_in_one_sentence(capture, tmp_path, capsys, edit, options, message):
    folder = changed(capture, tmp_path, edit)
    output = tmp_path / "out.json"
    assert cli.main(["calibrate", folder, "-o", output, *options]) == 2
    text = capsys.readouterr().err
    assert text.startswith("cyclope: ") and message in text and text.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_dead_beams_are_those_of_option_and_capture(capture, tmp_path, capsys):
    folder = changed(capture, tmp_path, lambda c: replace_in(
        c / "capture.toml", "[lens]", "dead = [[6, 6], [0, 1]]\n\n[lens]"))
    output = tmp_path / "out.json"
    assert cli.main(["calibrate", folder, "-o", output, "--no-picture",
                     "--dead", "0,0", "0,1", "--dead", "3,2"]) == 0
    calibration = file.load(output)
    assert calibration.left_out == (0, 1, 23, 48)
    text = " ".join(capsys.readouterr().out.split())
    assert "not used" not in text and "left out" not in text[text.index("Health:"):]
    for beam, row, column in ((0, 0, 0), (1, 0, 1), (23, 3, 2), (48, 6, 6)):
        assert (f"Beam {beam} (row {row}, column {column}): left out: known to be dead, but there "
                "are spots where its own would be at 6 distances") in text


def test_output_that_cannot_be_written_is_refused(capture, tmp_path, capsys):
    assert cli.main(["calibrate", capture, "-o", tmp_path]) == 2
    assert "is a folder: name a file" in capsys.readouterr().err
    assert cli.main(["calibrate", capture, "-o", tmp_path / "none" / "calibration.json"]) == 2
    assert "does not exist" in capsys.readouterr().err
