"""Values on the command line that nobody can have meant."""

from types import SimpleNamespace

import pytest

from scripts.cyclope import simulate

#: Command, options and words of the sentence.
BAD = [
    ("simulate", "--frames 0", "--frames must be 1 to 10000, not 0"),
    ("simulate", "--frames -3", "--frames must be 1 to 10000, not -3"),
    ("simulate", "--frames 99999999999999999999", "--frames must be 1 to 10000, not 9999999"),
    ("simulate", "--frames 1e3", "--frames: invalid int value: '1e3'"),
    ("simulate", "--frames many", "--frames: invalid int value: 'many'"),
    ("simulate", "--seed -1", "--seed must be 0 or more, not -1"),
    ("simulate", "--seed nan", "--seed: invalid int value: 'nan'"),
    ("simulate", "--rig none", "--rig: invalid choice: 'none'"),
    ("run", "--noise 64", "--noise must be 0, or 0.125 to 63.8, not 64"),
    ("run", "--noise -1", "--noise must be 0, or 0.125 to 63.8, not -1"),
    ("run", "--noise nan", "--noise must be 0, or 0.125 to 63.8, not nan"),
    ("run", "--noise much", "--noise: invalid float value: 'much'"),
    ("run", "--level 30", "--level is for the preset paper, and the calibration is for capsule"),
    ("run", "--level 256", "--level must be 0 to 255, not 256"),
    ("run", "--level -1", "--level must be 0 to 255, not -1"),
    ("run", "--level nan", "--level: invalid int value: 'nan'"),
    ("run", "--engine best", "--engine: invalid choice: 'best'"),
    ("run", "--engine", "--engine: expected one argument"),
    ("run", "--levle 3", "cyclope run`; did you mean --level?"),
    ("calibrate", "--noise nan", "--noise must be 0.125 to 63.8 or 'adaptive', not 'nan'"),
    ("calibrate", "--noise 64", "--noise must be 0.125 to 63.8 or 'adaptive', not '64'"),
    ("calibrate", "--lit nan", "--lit must be 0.0625 to 3.9, not nan"),
    ("calibrate", "--core 0", "--core must be 0.0625 to 3.9, not 0"),
    ("calibrate", "--dent -1", "--dent must be 0 to 3.9, not -1"),
    ("calibrate", "--dent inf", "--dent must be 0 to 3.9, not inf"),
    ("calibrate", "--window 10", "--window must be odd and 5 to 31, not 10"),
    ("calibrate", "--window 33", "--window must be odd and 5 to 31, not 33"),
    ("calibrate", "--preset paper --alpha nan",
     "--alpha must be 0 to 15.9, not nan"),
    ("calibrate", "--preset paper --alpha inf",
     "--alpha must be 0 to 15.9, not inf"),
    ("calibrate", "--preset paper --alpha 1e300",
     "--alpha must be 0 to 15.9, not 1e+300"),
    ("calibrate", "--preset paper --alpha -1",
     "--alpha must be 0 to 15.9, not -1"),
    ("calibrate", "--preset paper --threshold 256",
     "--threshold must be 1 to 255 or 'adaptive', not '256'"),
    ("calibrate", "--preset paper --threshold nan",
     "--threshold must be 1 to 255 or 'adaptive', not 'nan'"),
    ("calibrate", "--preset paper --threshold ٣",
     "--threshold must be 1 to 255 or 'adaptive', not '٣'"),
    ("calibrate", "--area-min 0", "--area-min must be 1 to 1023, not 0"),
    ("calibrate", "--area-max 99999999999", "--area-max must be 1 to 1023, not 99999999999"),
    ("calibrate", "--depth-min nan", "--depth-min must be above 0 and up to 100000 mm, not nan"),
    ("calibrate", "--depth-min -5", "--depth-min must be above 0 and up to 100000 mm, not -5"),
    ("calibrate", "--depth-max inf", "--depth-max must be above 0 and up to 100000 mm, not inf"),
]


@pytest.mark.parametrize("command, options, words", BAD,
                         ids=[f"{command} {options}" for command, options, _ in BAD])
def test_values_are_refused(command, options, words, prepared, tmp_path, refused):
    start = {"simulate": ["plane", tmp_path / "out"],
             "run": [prepared[0], "--calibration", prepared[1], "-o", tmp_path / "out"],
             "calibrate": [prepared[0], "-o", tmp_path / "out"]}[command]
    assert words in refused(command, *start, *options.split())


def test_a_capture_that_does_not_fit_is_refused_at_once(tmp_path, refused, monkeypatch):
    monkeypatch.setattr(simulate.shutil, "disk_usage", lambda _: SimpleNamespace(free=5_000_000))
    message = refused("simulate", "plane", tmp_path / "out", "--frames", "1000")
    assert "That is a capture of up to 2" in message and f"{tmp_path} has 5 MB left" in message


def test_a_picture_over_its_own_calibration_is_refused(prepared, tmp_path, refused):
    message = refused("calibrate", prepared[0], "-o", tmp_path / "out.png")
    assert "would be the calibration and its picture in one" in message
