"""Changed images keep their truth."""

import csv
import json

import cv2
import numpy as np
import pytest

from tb.benchmark import changed_dots

_PLACES = np.stack(np.meshgrid(np.arange(30, 171, 20.0), np.arange(40, 121, 16.0)), -1) + 0.3


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One image of Gaussian dots with its truth, complete in a part of it."""
    folder = tmp_path_factory.mktemp("dots")
    places = _PLACES.reshape(-1, 2)
    v, u = np.mgrid[:160, :200]
    levels = 40 + sum(120 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / 4) for x, y in places)
    levels += np.random.default_rng(1).normal(0, 1.5, levels.shape)
    cv2.imwrite(str(folder / "hle_x.png"), np.clip(np.rint(levels), 0, 255).astype(np.uint8))
    with open(folder / "hle_x_truth.csv", "w", newline="") as file:
        csv.writer(file).writerows([("u_px", "v_px"), *places.tolist()])
    (folder / "sets.json").write_text(json.dumps(
        {"hle_x": {"regions": [{"u_v_range": [50, 150, 50, 110]}]}}))
    return folder


@pytest.mark.parametrize("name", changed_dots.CHANGES)
def test_truth_follows_the_image(name, folder):
    score, = changed_dots.scores(name, folder)
    assert score.group == "hle" and score.dots == 5 * 4 and score.f > 0.9


def test_table(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(changed_dots, "CHANGES", {
        name: changed_dots.CHANGES[name] for name in ("none", "mirrored")})
    assert changed_dots.main([str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["change", "none", "mirrored"]
    assert lines[1].split()[1:] == ["1.000", "1.000"]
    assert changed_dots.main([str(tmp_path)]) == 2
    assert "has no sets.json" in capsys.readouterr().err
