"""Rotations of a mesh to be made, against walks along its lines, and ``--plan``."""

import numpy as np
import pytest

from calibration.plan import plan_mesh
from calibration.projector import Projector
from calibration.tables import DEPTH_MARGIN, NEAR_GUARD
from model.errors import UserError
from model.optics import geometry
from scripts.cyclope import cli

RANGE = (40.0, 110.0)
MESH = Projector(5, 5, 9.0, 0.0, 2.5, (5.0, 0.05, 0.12))


def optics(projector):
    """The same camera and mesh by the simulator's own geometry."""
    camera = geometry.Camera(352, 288, 360.0, (175.5, 143.5))
    return camera, geometry.Projector(projector.rows, projector.columns, projector.pitch_deg,
                                      projector.rotation_deg, projector.toe_in_deg,
                                      projector.base_mm)


def walked_separation(camera, projector):
    """Smallest distance of two lines, by single steps along them."""
    lines = geometry.beam_lines(camera, projector)
    near, far = RANGE[0] / DEPTH_MARGIN, RANGE[1] * DEPTH_MARGIN
    smallest = np.inf
    for one in range(projector.beams):
        window = np.sort([lines.column_at(near)[one], lines.column_at(far)[one]]) + [-1, 1]
        columns = np.clip(np.linspace(*window, 400), -175.5, 175.5)
        for other in range(projector.beams):
            ends = np.sort([lines.column_at(RANGE[0] / NEAR_GUARD)[other],
                            lines.column_at(1e12)[other]])
            shared = columns[(columns >= ends[0]) & (columns <= ends[1])]
            if other != one and len(shared):
                smallest = min(smallest, np.abs(
                    (lines.a[one] - lines.a[other]) * shared + lines.b[one] - lines.b[other]).min())
    return smallest


def test_plans_against_a_walk_along_the_lines():
    plans = plan_mesh(352, 288, 360.0, MESH, *RANGE)
    assert 2 <= len(plans) <= 4
    for plan in plans:
        camera, projector = optics(plan.projector)
        assert plan.separation_px == pytest.approx(walked_separation(camera, projector), abs=0.05)
        images = [camera.project(projector.points_at(z)) for z in np.linspace(*RANGE, 60)]
        inside = np.array([camera.inside(image) for image in images])
        assert (plan.always, plan.sometimes) == (inside.all(axis=0).sum(), inside.any(axis=0).sum())
        apart = min(np.sort(np.hypot(*(image[:, None] - image).T), axis=1)[:, 1].min()
                    for image in images)
        assert plan.pitch_px == pytest.approx(apart, rel=0.02)


@pytest.mark.parametrize("seed", [3])
def test_chance_against_random_highlights(seed):
    plan = plan_mesh(352, 288, 360.0, MESH, *RANGE)[0]
    lines = geometry.beam_lines(*optics(plan.projector))
    points = np.random.default_rng(seed).uniform((-176, -144), (176, 144), (200_000, 2))
    near, far = (lines.column_at(z) for z in (RANGE[0] / DEPTH_MARGIN, RANGE[1] * DEPTH_MARGIN))
    x, y = points.T[:, :, None]
    low, high = np.minimum(near, far) - 1, np.maximum(near, far) + 1
    # So few lines are far apart: every tolerance is the largest one.
    assert plan.separation_px > 3
    hit = ((np.abs(lines.a * x + lines.b - y) < 1.5) & (x >= low) & (x <= high)).any(axis=1)
    assert plan.chance == pytest.approx(hit.mean(), rel=0.05)


def test_the_best_rotation_is_better_than_all_others():
    best = plan_mesh(352, 288, 360.0, MESH, *RANGE)[0]
    for angle in range(2, 90, 4):
        turned = geometry.Projector(5, 5, 9.0, angle, 2.5, MESH.base_mm)
        camera, _ = optics(MESH)
        inside = np.array([camera.inside(camera.project(turned.points_at(z)))
                           for z in np.linspace(*RANGE, 60)]).all(axis=0).sum()
        if inside >= best.always:
            assert walked_separation(camera, turned) < best.separation_px + 0.05


@pytest.mark.parametrize(("rows", "columns", "z", "words"), [
    (1, 1, RANGE, "1 x 1 beams"), (23, 23, RANGE, "2 to 512 beams"), (5, 5, (60, 60), "is empty")])
def test_what_cannot_be_planned(rows, columns, z, words):
    mesh = Projector(rows, columns, 3.0, 0.0, 2.5, (5.0, 0.05, 0.12))
    with pytest.raises(UserError, match=words):
        plan_mesh(352, 288, 360.0, mesh, *z)
    away = Projector(5, 5, 3.0, 0.0, -60.0, (5.0, 0.05, 0.12))
    with pytest.raises(UserError, match="into the picture"):
        plan_mesh(352, 288, 360.0, away, *RANGE)


def test_command(small_capture, tmp_path, capsys):
    """The mesh spans the angle of the nominal one; planes are needed only for the range."""
    assert cli.main(["calibrate", str(small_capture), "--plan", "4x4"]) == 0
    text = capsys.readouterr().out
    assert "4 x 4 beams" in text and "Set rotation_deg = " in text
    folder = tmp_path / "only nominal"
    folder.mkdir()
    (folder / "capture.toml").write_bytes((small_capture / "capture.toml").read_bytes())
    assert cli.main(["calibrate", str(folder), "--plan", "4x4"]) == 2
    assert "--depth-min and --depth-max" in capsys.readouterr().err
    dense = ["calibrate", str(folder), "--plan", "16x16", "--depth-min", "10", "--depth-max", "110"]
    assert cli.main(dense) == 3
    assert "No rotation keeps the lines" in capsys.readouterr().out
    for bad in ("7", "0x4", "axb", "4x4x4", "-3x3"):
        assert cli.main(["calibrate", str(folder), f"--plan={bad}"]) == 2
        assert "rows x columns" in capsys.readouterr().err
    assert cli.main(["calibrate", str(folder)]) == 2
    assert "add -o FILE" in capsys.readouterr().err
