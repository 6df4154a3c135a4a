"""Real images with dots whose places are known: how many are found, and RTL = model."""

import numpy as np
import pytest

from hdl.config import Config
from tb.benchmark import dots
from tb.system.stimuli import any_settings
from tb.system.test_frames import assert_same, expected, shown

real = pytest.mark.skipif(
    not (dots.FOLDER / "sets.json").is_file(),
    reason=f"there are no real images in {'/'.join(dots.FOLDER.parts[-3:])} beside the repository")


@real
@pytest.mark.always_run
def test_dots_of_real_images_are_found():
    scores = list(dots.scores_of())
    groups = dots.group_scores(scores)
    assert len(scores) >= 9 and set(groups) == {"vocal3d", "hle", "kinect", "discorpy", "endocal"}
    assert np.mean(list(groups.values())) >= 0.95
    assert min(groups.values()) >= 0.85


@real
@pytest.mark.always_run
def test_rtl_is_the_model_on_real_images():
    """A part of one image of each group, learnt on itself, with beams that fit no rig."""
    config = Config(width=160, height=136, beams=16, spot_depth=512)
    groups, parts = set(), []
    for name, image, truth, _ in dots.images():
        group = dots.Score(name, 0, 0, 0).group
        if group not in groups:
            groups.add(group)
            middle = np.clip(np.median(truth, axis=0).astype(int), [80, 68],
                             np.array(image.shape[::-1]) - [80, 68])
            left, top = middle - [80, 68]
            parts += 2 * [image[top:top + 136, left:left + 160]]
    settings = any_settings(160, 136, config.beams, report_rejected=False, area_min=2)
    got = shown(settings, config, parts, frame_blanking=250_000)
    assert_same(got, expected(settings, config, parts))
    assert all(frame.spots > 10 and not frame.dropped for frame in got[1::2])


def test_a_folder_without_known_dots_is_named(tmp_path, capsys):
    assert dots.main([str(tmp_path)]) == 2
    assert f"{tmp_path} has no sets.json" in capsys.readouterr().err


def test_score_of_known_spots():
    """Found, missed, false, twice, outside of the region; by hand."""
    truth = np.array([[10.0, 10], [20, 10], [30, 10], [90, 90]])
    found = np.array([[10.5, 11], [10, 14], [32.9, 10], [40, 10], [91, 90]])
    region = {"u_v_range": [0, 50, 0, 50]}
    score = dots.score("hle_x", found, truth, [region])
    assert (score.dots, score.recall, score.precision) == (3, 2 / 3, 2 / 4)
    assert score.group == "hle" and score.f == pytest.approx(4 / 7)
    assert dots.score("x", found[:0], truth, [region]).f == 0
    hull = {"hull": [[0, 0], [25, 0], [25, 50], [0, 50]]}
    assert dots.score("x", found, truth, [hull]).recall == 1 / 2
    assert dots.group_scores([score, dots.Score("hle_y", 1, 1.0, 1.0)]) == {
        "hle": pytest.approx((4 / 7 + 1) / 2)}
