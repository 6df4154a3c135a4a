"""Calibration against the simulator's exact geometry, and everything that it must refuse."""

import json
import shutil
import zlib
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from calibration import file
from calibration.calibrate import Options, calibrate_beams, with_lens
from calibration.identity import PlaneSpots, identify
from calibration.lens import Lens, LensReport, calibrate_lens
from calibration.lines import Observations, check_planes, fit_lines
from calibration.projector import Projector
from calibration.remap import remap_table
from calibration.spots import find_spots
from calibration.tables import INVERSE_Z_ERROR, build_tables, choose_windows, separations
from model.capsule import Capsule
from model.errors import UserError
from model.optics import render, rigs, scenes
from model.optics.geometry import beam_lines
from model.optics.rigs import RIGS
from model.paper import Paper
from model.settings import RADIAL_WORDS, RECIPROCAL_WORDS, Settings
from model.stereo.depth import inverse_depth
from model.stereo.epipolar import OK, match, unpack_window
from scripts.cyclope import cli
from scripts.results.points import locate


def lens_of(rig):
    """The simulator's own lens."""
    camera = rig.camera
    return Lens(camera.width, camera.height, camera.focal_px, *camera.principal_px, camera.k1,
                camera.k2, camera.p1, camera.p2)


def off_nominal(projector, rng):
    """Nominal values, each wrong by all that is allowed, with a random sign."""
    def sign():
        return rng.choice([-1, 1])
    base = np.array(projector.base_mm)
    aside = np.radians(0.5) * np.linalg.norm(base)
    return Projector(
        projector.rows, projector.columns, projector.pitch_deg * (1 + 0.03 * sign()),
        projector.rotation_deg + sign(), projector.toe_in_deg + sign(),
        tuple(base * (1 + 0.03 * sign()) + [0, aside * sign(), aside * sign()]))


def observe(rig, seed, noise=0.03, missing=0.03, strays=3, planes=10):
    """Plane spots straight from geometry, with their beams (-1 for strays)."""
    rng = np.random.default_rng(seed)
    lens, result, truth = lens_of(rig), [], []
    for z in rig.calibration_planes(planes):
        place = rig.camera.project(rig.projector.points_at(z))
        seen = rig.camera.inside(place, 3) & (rng.random(len(place)) >= missing)
        place = place[seen] + rng.normal(scale=noise, size=(seen.sum(), 2))
        stray = rng.uniform((4, 4), (lens.width - 5, lens.height - 5), (strays, 2))
        u, v = np.concatenate([place, stray]).T
        beams = np.concatenate([np.flatnonzero(seen), np.full(strays, -1)])
        order = rng.permutation(len(u))
        u, v = u[order], v[order]
        x, y = lens.undistort(u, v)
        result.append(PlaneSpots(f"{z}.png", z, u, v, x, y, np.full(len(u), 9)))
        truth.append(beams[order])
    return result, truth, off_nominal(rig.projector, rng), lens


def fitted(rig, seed, **options):
    """Lines of a rig from :func:`observe`."""
    planes, _, nominal, lens = observe(rig, seed, **options)
    observations = Observations.of(planes, identify(planes, nominal, lens), lens)
    check_planes(observations, nominal.columns)
    return planes, lens, fit_lines(observations, lens)


@pytest.fixture(scope="module")
def capsule():
    """Lines, windows and tables of the capsule rig."""
    planes, lens, lines = fitted(RIGS["endoscope"], 5)
    windows = choose_windows(lines, 7, planes[-1].z_mm, planes[0].z_mm)
    return lens, lines, windows, build_tables(lines, windows, 7)


# The lens.

@pytest.mark.parametrize("k1, k2, p1, p2", [
    (0, 0, 0, 0), (-0.35, 0.15, 1e-3, -1e-3), (0.25, 0, -2e-3, 1e-3), (-0.12, 0.02, 5e-4, -4e-4)])
def test_undistort_is_the_inverse_of_opencv(k1, k2, p1, p2):
    lens = Lens(352, 288, 360.0, 177.1, 142.3, k1, k2, p1, p2)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-150, 150, (2, 500))
    slopes = np.stack([*lens.ray(x, y), np.ones(500)], axis=-1)
    seen, _ = cv2.projectPoints(slopes, np.zeros(3), np.zeros(3), lens.matrix, lens.coefficients)
    np.testing.assert_allclose(np.stack(lens.distort(x, y), -1), seen[:, 0], atol=1e-9)
    np.testing.assert_allclose(lens.undistort(*seen[:, 0].T), (x, y), atol=1e-6)
    assert not lens.folds()


@pytest.mark.parametrize("focal, k1, k2, folds", [
    (150, -0.35, 0, True), (360, -0.35, 0, False), (200, -0.35, 0.3, False),
    (200, 0.2, -0.25, True), (360, 0.25, 0, False)])
def test_lens_that_folds_is_refused(focal, k1, k2, folds):
    lens = Lens(352, 288, focal, 175.5, 143.5, k1, k2)
    # What a plain walk from the principal point to the farthest corner says.
    radius = np.linspace(0, 3, 300001)
    seen = radius * (1 + k1 * radius**2 + k2 * radius**4)
    turn = np.flatnonzero(np.diff(seen) <= 0)
    reach = seen[turn[0]] if len(turn) else np.inf
    assert (reach < np.hypot(176, 144) / focal) == folds
    assert lens.folds() == folds
    if folds:
        with pytest.raises(UserError, match="folds back inside the 352 x 288 picture"):
            lens.check_one_to_one()
    else:
        lens.check_one_to_one()


@cache
def board_views(count=10, fine=4):
    """Drawn photographs of a 9 x 6 board, fine x fine samples a pixel, and their lens."""
    lens = lens_of(RIGS["endoscope"])
    rng = np.random.default_rng(3)
    v, u = (np.mgrid[:lens.height * fine, :lens.width * fine] + 0.5) / fine - 0.5
    rays = np.stack([*lens.ray(*lens.undistort(u, v)), np.ones_like(u)], axis=-1)
    views = []
    for number in range(count):
        turn, _ = cv2.Rodrigues(np.append(rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.2, 0.2)))
        shift = np.array([rng.uniform(-8, 8), rng.uniform(-5, 5), rng.uniform(50, 65)])
        reach = (shift @ turn[:, 2]) / (rays @ turn[:, 2])
        place = ((rays * reach[..., None] - shift) @ turn[:, :2]) / 4 + [5, 3.5]
        square = np.floor(place).astype(int)
        dark = ((square >= 0) & (square < [10, 7])).all(axis=-1) & (square.sum(axis=-1) % 2 == 0)
        image = np.where(dark, 40.0, 200.0)
        image = image.reshape(lens.height, fine, lens.width, fine).mean(axis=(1, 3))
        image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(scale=2, size=image.shape)
        views.append((f"{number}.png", np.clip(np.rint(image), 0, 255).astype(np.uint8)))
    return lens, views


def test_lens_is_recovered():
    lens, views = board_views()
    blank = ("blank.png", np.full((288, 352), 120, np.uint8))
    found, report = calibrate_lens([*views[:4], blank, *views[4:]], 9, 6, 4.0, 360 * 1.03)
    assert report.without_board == ("blank.png",) and len(report.used) == 10
    assert report.rms_px < 0.1
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 352, 16), np.arange(0, 288, 16)))
    error = np.hypot(*(np.array(lens.ray(*lens.undistort(u, v)))
                       - found.ray(*found.undistort(u, v)))) * 360
    assert np.sqrt(np.mean(error**2)) < 0.5


def test_too_few_boards_are_refused():
    views = board_views()[1][:4]
    blank = ("blank.png", np.full((288, 352), 120, np.uint8))
    with pytest.raises(UserError, match=r"in 4 photographs \(not in blank.png\), at least 5"):
        calibrate_lens([*views, blank], 9, 6, 4.0, 360)


def test_boards_that_fit_no_lens_are_refused(monkeypatch):
    rng = np.random.default_rng(2)
    grid = np.mgrid[:9, :6].T.reshape(-1, 2) * 20.0 + 60
    monkeypatch.setattr("calibration.lens.find_corners", lambda *_: (
        [(grid + rng.normal(scale=6, size=grid.shape)).astype(np.float32)] * 2))
    blank = np.zeros((288, 352), np.uint8)
    with pytest.raises(UserError, match="fit a lens only to .* px RMS|an impossible lens"):
        calibrate_lens([(str(number), blank) for number in range(8)], 9, 6, 4.0, 360)


# Which beam is which.

@pytest.mark.parametrize("name, seed", [
    ("endoscope", 1), ("endoscope", 2), ("demonstrator", 3), ("small", 4), ("small", 5)])
def test_identity_with_the_worst_nominal_values(name, seed):
    planes, truth, nominal, lens = observe(RIGS[name], seed, noise=0.1)
    identity = identify(planes, nominal, lens)
    for found, true in zip(identity.beams, truth, strict=True):
        real = true >= 0
        assert np.array_equal(found[real], true[real])
    assert sum((found[true < 0] >= 0).sum() for found, true in
               zip(identity.beams, truth, strict=True)) <= 1
    fit, projector = identity.projector, RIGS[name].projector
    assert abs(fit.rotation_deg - projector.rotation_deg) < 0.3
    assert abs(fit.base_mm[0] / projector.base_mm[0] - 1) < 0.02


@pytest.mark.parametrize("change, message", [
    ({"toe_in_deg": 2.5 + 6.3}, "projector|mesh"),
    ({"toe_in_deg": 2.5 - 6.3}, "projector|mesh"),
    ({"rows": 8}, "projector|mesh|planes"),
    ({"columns": 6}, "continue the 7 x 6 mesh"),
    ({"rotation_deg": -8.5}, "do not form the nominal 7 x 7 mesh"),
    ({"pitch_deg": 6.3 * 1.15}, "projector"),
    ({"base_mm": (-5, -0.05, 0.12)}, "mesh|projector")])
def test_numbering_is_never_shifted_silently(change, message):
    planes, _, nominal, lens = observe(RIGS["endoscope"], 8)
    with pytest.raises(UserError, match=message):
        identify(planes, replace(nominal, **change), lens)


def test_mesh_without_a_border_is_refused():
    rig = RIGS["endoscope"]
    fine = replace(rig.projector, rows=25, columns=25, pitch_deg=1.2, rotation_deg=3.0,
                   irregularity_deg=0)
    large = replace(rig, camera=replace(rig.camera, width=128, height=128,
                                        principal_px=(63.0, 64.0)), projector=fine)
    planes, _, _, lens = observe(large, 1, strays=0, missing=0, planes=5)
    nominal = Projector(25, 25, 1.2, 3.0, 2.5, fine.base_mm)
    with pytest.raises(UserError, match="cannot be told from their neighbours"):
        identify(planes, nominal, lens)


def test_frames_without_spots_are_refused():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 8, missing=1, strays=0, planes=4)
    with pytest.raises(UserError, match="do not form the nominal 7 x 7 mesh"):
        identify(planes, nominal, lens)


# Lines.

@pytest.mark.parametrize("name", ["endoscope", "demonstrator", "small"])
def test_lines_and_depth_are_the_simulators(name):
    rig = RIGS[name]
    _, _, lines = fitted(rig, 11, noise=0.02)
    exact = beam_lines(rig.camera, rig.projector)
    for z in np.linspace(*rig.range_mm, 9):
        column = exact.column_at(z)
        off = lines.a * column + lines.b - exact.a * column - exact.b
        assert np.abs(off).max() < 0.05
        move = column - lines.column_at(z)
        assert np.sqrt(np.mean(move**2)) < 0.02
    assert 0.01 < lines.rms_px < 0.03


def test_the_common_origin_helps():
    """Held-out planes say so, and the truth agrees."""
    rig = RIGS["endoscope"]
    planes, _, nominal, lens = observe(rig, 12, noise=0.05)
    data = Observations.of(planes, identify(planes, nominal, lens), lens)
    lines = fit_lines(data, lens)
    assert lines.strength >= 1
    assert lines.held_out_px[lines.strength] < 0.96 * lines.held_out_px[0.0]


def test_outliers_do_not_move_the_lines():
    rig = RIGS["endoscope"]
    planes, _, nominal, lens = observe(rig, 13, noise=0.02, strays=0)
    data = Observations.of(planes, identify(planes, nominal, lens), lens)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(data.x)) < 0.03
    spoilt = replace(data, x=data.x + wrong * rng.uniform(0.5, 2, len(wrong)),
                     y=data.y + wrong * rng.uniform(0.5, 2, len(wrong)))
    lines = fit_lines(spoilt, lens)
    exact = beam_lines(rig.camera, rig.projector)
    assert lines.outliers >= 0.9 * wrong.sum()
    for z in (40, 60, 110):
        assert np.abs(lines.column_at(z) - exact.column_at(z)).max() < 0.06


def test_too_few_planes_are_refused():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 14, planes=3)
    data = Observations.of(planes, identify(planes, nominal, lens), lens)
    with pytest.raises(UserError, match="show 3 distances, at least 4 different"):
        check_planes(data, 7)


def test_beams_in_too_few_planes_are_named():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 15, strays=0, missing=0)
    identity = identify(planes, nominal, lens)
    data = Observations.of(planes, identity, lens)
    keep = ~(np.isin(data.beam, (10, 48)) & (data.plane >= 3))
    data = replace(data, **{name: getattr(data, name)[keep]
                            for name in ("beam", "plane", "inverse_z", "x", "y")})
    with pytest.raises(UserError, match=r"Beams 10 \(row 1, column 3: 3\), 48 \(row 6, column 6: "
                                        r"3\) are seen in fewer than 4 planes"):
        check_planes(data, 7)


# Tables.

def test_separations_against_a_walk_along_the_lines():
    rng = np.random.default_rng(4)
    a, b = rng.normal(scale=0.1, size=12), rng.uniform(-20, 20, 12)
    low = rng.uniform(-100, 50, 12)
    high = low + rng.uniform(10, 60, 12)
    found = separations(a, b, low, high)
    for one in range(12):
        for other in range(12):
            first, last = max(low[one], low[other]), min(high[one], high[other])
            if one == other or first > last:
                assert np.isinf(found[one, other])
                continue
            u = np.linspace(first, last, 20001)
            gap = (a[one] - a[other]) * u + b[one] - b[other]
            walked = 0 if gap.min() < 0 < gap.max() else np.abs(gap).min()
            assert found[one, other] == pytest.approx(walked, abs=1e-9)


def test_quantised_tables_measure_as_float(capsule):
    _, lines, windows, tables = capsule
    assert tables.depth_relative <= INVERSE_Z_ERROR / 2
    assert tables.line_px < 0.003
    rng = np.random.default_rng(6)
    tolerance, u_min, u_max = unpack_window(tables.window)
    assert np.all(u_min / 16 <= windows.low) and np.all((u_max + 1) / 16 > windows.high)
    assert np.all(np.abs(tolerance / 32 - windows.tolerance) <= 1 / 32)
    beam = np.repeat(np.arange(49), 200)
    x = np.rint(rng.uniform(windows.low[beam], windows.high[beam]) * 512).astype(int)
    y = np.rint((lines.a[beam] * x / 512 + lines.b[beam]) * 512).astype(int)
    status, found = match(x, y, np.zeros(len(x), bool), tables.line, tables.window)
    assert np.all(status == OK) and np.array_equal(found, beam)
    status, _, value = inverse_depth(x, beam, status, tables.depth)
    assert np.all(status == OK)
    exact = lines.alpha[beam] * x / 512 + lines.beta[beam]
    assert np.abs(value * tables.inverse_z_unit / exact - 1).max() <= INVERSE_Z_ERROR / 2


def test_a_spot_is_never_within_two_tolerances(capsule):
    _, lines, windows, _ = capsule
    distance = separations(lines.a, lines.b, windows.low, windows.high)
    pair = np.add.outer(windows.tolerance, windows.tolerance)
    assert np.all(distance >= pair - 1e-9)


def test_ambiguous_pattern_is_refused():
    rig = RIGS["endoscope"]
    flat = replace(rig, projector=replace(rig.projector, rotation_deg=0.0, irregularity_deg=0))
    planes, _, lines = fitted(flat, 16)
    with pytest.raises(UserError, match=r"The pattern is ambiguous: the epipolar lines of beams 0 "
                                        r"and 1 \(0\.\d\d px\), .* turn the mesh"):
        choose_windows(lines, 7, planes[-1].z_mm, planes[0].z_mm)


def test_base_along_the_columns_is_refused():
    rig = RIGS["endoscope"]
    above = replace(rig.projector, base_mm=(0.2, 5.0, 0.1), toe_in_deg=0.0, pitch_deg=5.0)
    with pytest.raises(UserError, match="beside the camera along the rows"):
        fitted(replace(rig, projector=above), 17, strays=0, missing=0)


def test_depth_range_to_infinity_is_refused(capsule):
    _, lines, windows, _ = capsule
    endless = replace(windows, low=windows.low - 60)
    with pytest.raises(UserError, match="beyond infinite distance"):
        build_tables(lines, endless, 7)


# The file.

@pytest.fixture(scope="module")
def calibration(capsule):
    """A calibration with plain numbers in the tables that others build."""
    lens, lines, windows, tables = capsule
    beams = tuple(
        file.Beam(a=lines.a[k], b=lines.b[k], alpha=lines.alpha[k], beta=lines.beta[k],
                  u_min=windows.low[k], u_max=windows.high[k], tolerance=windows.tolerance[k],
                  separation=None, residual_u=0.1, residual_v=0.1, planes=8) for k in range(49))
    settings = Settings(radial=tuple(range(RADIAL_WORDS)), line=tables.line, window=tables.window,
                        reciprocal=tuple(range(RECIPROCAL_WORDS)), depth=tables.depth)
    return file.Calibration(
        lens=lens, projector=Projector(7, 7, 6.3, 8.5, 2.5, (5.0, 0.05, 0.12)), beams=beams,
        settings=settings, inverse_z_unit=tables.inverse_z_unit, z_min=38.4, z_max=114.4,
        budget={"line_px": tables.line_px})


def test_file_gives_back_what_it_was_given(calibration, tmp_path):
    path = tmp_path / "calibration.json"
    path.write_text("old")
    file.save(calibration, path)
    back = file.load(path)
    assert back == calibration
    assert (back.width, back.height, back.rows, back.columns) == (352, 288, 7, 7)
    assert json.loads(path.read_text())["version"] == file.VERSION
    assert [entry.name for entry in tmp_path.iterdir()] == ["calibration.json"]
    remapped = replace(
        calibration, settings=replace(calibration.settings, remap=remap_table(calibration.lens)))
    file.save(remapped, path)
    assert file.load(path) == remapped


def test_every_flipped_bit_is_refused(calibration):
    """The check sum sees every single bit of the body; the trailer is compared byte by byte."""
    data = file.encode(calibration)
    assert file.decode(data) == calibration
    ends = {0, 1, 2, *range(len(data) - 40, len(data))}
    places = sorted(ends | set(np.random.default_rng(1).integers(0, len(data), 300).tolist()))
    for place in places:
        for bit in range(8):
            broken = bytearray(data)
            broken[place] ^= 1 << bit
            with pytest.raises(UserError, match="corrupt"):
                file.decode(bytes(broken))
    # All others: the check sum is linear, so a flipped bit changes it by a difference that does
    # not depend on the data but on the bit's distance from the end, and is never zero.
    size = len(data) - len(b'"crc32": "00000000"\n}\n')
    zero = bytes(64)
    plain = zlib.crc32(zero)
    for bit in range(8):
        difference = zlib.crc32(bytes([1 << bit]) + zero[1:]) ^ plain
        for _ in range(size):
            assert difference
            difference = zlib.crc32(b"\0", difference ^ 0xFFFFFFFF) ^ zlib.crc32(b"\0", 0xFFFFFFFF)


@pytest.mark.parametrize("change", ["cut", "longer", "empty", "text", "image"])
def test_spoilt_file_is_refused(calibration, tmp_path, change):
    data = file.encode(calibration)
    spoilt = {"cut": data[:-1], "longer": data + b"\n", "empty": b"", "text": b"hello",
              "image": bytes(range(256))}[change]
    path = tmp_path / "calibration.json"
    path.write_bytes(spoilt)
    with pytest.raises(UserError, match="calibrat") as refusal:
        file.load(path)
    assert str(path) in str(refusal.value) and str(refusal.value).endswith(".")


def test_missing_file_and_folder_are_refused(tmp_path, calibration):
    with pytest.raises(UserError, match="does not exist: make it with `cyclope calibrate"):
        file.load(tmp_path / "none.json")
    with pytest.raises(UserError, match="cannot be read"):
        file.load(tmp_path)
    with pytest.raises(UserError, match="cannot be written"):
        file.save(calibration, tmp_path / "none" / "calibration.json")


@pytest.mark.parametrize("old, new, message", [
    (b'"version": 1', b'"version": 2', "is of version 2, this program reads version 1"),
    (b'"cyclope calibration"', b'"something else"', "is not a calibration file"),
    (b'"inverse_z_unit"', b'"unit"', "lacks something"),
    (b'"erosion": "gate"', b'"erosion": "what"', "lacks something"),
    (b'"rows": 7', b'"rows": 8', "lacks something")])
def test_other_files_with_a_good_check_sum_are_refused(calibration, old, new, message):
    body = file.encode(calibration).split(b'"crc32"')[0].replace(old, new)
    with pytest.raises(UserError, match=message):
        file.decode(body + b'"crc32": "%08x"\n}\n' % zlib.crc32(body))


def test_other_sensor_is_refused(calibration):
    calibration.check_sensor(352, 288)
    with pytest.raises(UserError, match="for a sensor of 352 x 288 pixels, not 640 x 480"):
        calibration.check_sensor(640, 480)


# All of it, from noisy frames.

def calibrated(rig, seed, settings, planes=12):
    """Calibration from simulated plane frames, nominal values off by their default error."""
    rng = np.random.default_rng(seed)
    lens = lens_of(rig)
    settings = with_lens(settings, lens)
    spots = [find_spots(f"{z}.png", z, render.pattern_frame(rig, scenes.Plane(z), rng)[0],
                        settings, lens) for z in rig.calibration_planes(planes)]
    nominal = rigs.nominal(rig, rng)
    projector = Projector(rig.projector.rows, rig.projector.columns, nominal.pitch_deg,
                          nominal.rotation_deg, nominal.toe_in_deg, nominal.base_mm)
    return calibrate_beams(spots, projector, lens, LensReport(0.05), Options(settings), settings)


def depth_errors(rig, calibration, kinds, frames, seed, model=Capsule):
    """Relative depth errors of all ok points, and the share of beams found, by the golden model."""
    rng = np.random.default_rng([seed, 1])
    chip = model(calibration.settings, calibration.width, calibration.height)
    errors, found, expected = [], 0, 0
    for kind in kinds:
        for scene in scenes.sequence(kind, rig, frames, rng):
            image, truth = render.pattern_frame(rig, scene, rng)
            chip.frame(image)
            points = locate(chip.frame(image).points, 0, calibration, image)
            points = points[points["status"] == 0]
            errors.append(np.abs(points["z"] / truth["z_mm"][points["beam"]] - 1))
            inside = truth["beam"][truth["inside"]]
            expected += len(inside)
            found += np.isin(inside, points["beam"]).sum()
    return np.concatenate(errors), found / expected


@pytest.mark.parametrize("name, seed, erosion, limit", [
    *(("endoscope", seed, "gate", 0.0012) for seed in range(5)),
    ("endoscope", 5, "erode", 0.007),
    ("endoscope", 6, "erode", 0.007), ("demonstrator", 7, "gate", 0.0005),
    ("demonstrator", 8, "gate", 0.0005)])
def test_depth_is_as_good_as_promised(name, seed, erosion, limit):
    settings = Settings(erosion=erosion, weighted=erosion == "gate")
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
    assert calibration.settings == replace(calibration.settings, erosion="gate", weighted=True)
    error, found = depth_errors(RIGS["endoscope"], calibration, ("plane",), 4, 23)
    assert error.mean() <= 0.0012 and found >= 0.97
    picture = cv2.imread(str(tmp_path / "calibration.png"))
    assert picture.shape[1] >= 1200 and picture.std() > 20


def test_choices_go_into_the_file(capture, tmp_path):
    output = tmp_path / "calibration.json"
    assert cli.main(["calibrate", capture, "-o", output, "--no-picture", "--erosion", "off",
                     "--centre", "binary", "--threshold", "40", "--alpha", "3.5", "--area-min",
                     "4", "--area-max", "200", "--depth-min", "45", "--depth-max", "100"]) == 0
    calibration = file.load(output)
    settings = calibration.settings
    assert (settings.erosion, settings.weighted) == ("off", False)
    assert (settings.level_fixed, settings.threshold_alpha) == (40, 56)
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


@pytest.mark.parametrize("edit, options, message", [
    (lambda c: None, ["--preset", "paper", "--centre", "weighted"],
     "--preset paper has binary centres only"),
    (lambda c: None, ["--threshold", "0"],
     "--threshold must be 1 to 255 or 'adaptive', not '0'"),
    (lambda c: None, ["--alpha", "16"], "--alpha must be 0 to 15.9, not 16"),
    (lambda c: None, ["--area-min", "0"], "--area-min must be 1 to 255, not 0"),
    (lambda c: None, ["--area-min", "9", "--area-max", "8"], "--area-min must not be above"),
    (lambda c: None, ["--threshold", "255"], "do not form the nominal 7 x 7 mesh"),
    (lambda c: None, ["--depth-min", "90", "--depth-max", "50"], "The depth range 90 to 50 mm is "),
    (lambda c: replace_in(c / "capture.toml", "columns = 7", "columns = 6"), [],
     "continue the 7 x 6 mesh"),
    (lambda c: replace_in(c / "capture.toml", "board_rows = 6", "board_rows = 5"), [],
     "The 9 x 5 inner corners of the chessboard were found in"),
    (lambda c: (c / "planes" / "planes.csv").write_text(
        "\n".join((c / "planes" / "planes.csv").read_text().splitlines()[:4]) + "\n"), [],
     "show 3 distances, at least 4"),
    (lambda c: replace_in(c / "capture.toml", "width = 352", "width = 320"), [],
     "0.png has 352 x 288 pixels"),
    (lambda c: replace_in(c / "capture.toml", "pitch_deg = 6", "pitch_deg = 0 # "), [],
     "pitch_deg in [projector] must"),
    (lambda c: replace_in(c / "capture.toml", "base_mm = [", "base_mm = [0, 1, 2] # "), [],
     "base_mm in [projector] must"),
], ids=["preset", "threshold", "alpha", "area", "areas", "dark", "depth", "mesh", "board", "planes",
        "size", "pitch", "base"])
def test_command_refuses_in_one_sentence(capture, tmp_path, capsys, edit, options, message):
    folder = changed(capture, tmp_path, edit)
    output = tmp_path / "out.json"
    assert cli.main(["calibrate", folder, "-o", output, *options]) == 2
    text = capsys.readouterr().err
    assert text.startswith("cyclope: ") and message in text and text.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_output_that_cannot_be_written_is_refused(capture, tmp_path, capsys):
    assert cli.main(["calibrate", capture, "-o", tmp_path]) == 2
    assert "is a folder: name a file" in capsys.readouterr().err
    assert cli.main(["calibrate", capture, "-o", tmp_path / "none" / "calibration.json"]) == 2
    assert "does not exist" in capsys.readouterr().err
