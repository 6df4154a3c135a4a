"""Calibration files that are forged, with a correct check sum."""

import json
import zlib

import pytest

from scripts.cyclope import cli


def signed(text):
    """The octets of a file with that content before its check sum."""
    body = text.encode("latin-1")
    return body + b'"crc32": "%08x"\n}\n' % zlib.crc32(body)


def forged(content):
    """The octets of a file with that content, apart from its check sum."""
    content.pop("crc32", None)
    return signed(json.dumps(content)[:-1] + ",\n")


def put(*path, value):
    """Replaces a value."""
    def change(content):
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = value
    return change


def drop(*path):
    """Removes a value."""
    def change(content):
        for key in path[:-1]:
            content = content[key]
        del content[path[-1]]
    return change


#: What is done to the content of a good file, and words of the sentence.
FORGED = {
    "version": (put("version", value=2), "is of version 2, this program reads version 1"),
    "version of digits": (put("version", value="9" * 900), "is of version 9999"),
    "no version": (drop("version"), "is of version None"),
    "version list": (put("version", value=[1]), "is of version [1]"),
    "format": (put("format", value="something else"), "is not a calibration file"),
    "no lens": (drop("lens"), "the file lacks lens"),
    "unknown key": (put("extra", value=1), "the file has 'extra', which nobody knows"),
    "sensor list": (put("sensor", value=[352, 288]), "sensor must be an object"),
    "width 0": (put("sensor", "width", value=0), "width of sensor must be an integer from 8 to"),
    "width 65535": (put("sensor", "width", value=65535), "width of sensor must be"),
    "width float": (put("sensor", "width", value=352.0), "width of sensor must be an integer"),
    "width true": (put("sensor", "width", value=True), "width of sensor must be an integer"),
    "height text": (put("sensor", "height", value="288"), "height of sensor must be an integer"),
    "focal 0": (put("lens", "focal", value=0), "focal of lens must be a number from 1 to"),
    "focal text": (put("lens", "focal", value="360"), "focal of lens must be a number"),
    "focal huge": (put("lens", "focal", value=10**400), "focal of lens must be a number"),
    "principal outside": (put("lens", "principal_u", value=-1), "principal_u of lens must be"),
    "folding lens": (put("lens", "k1", value=-5), "its lens folds back inside the image"),
    "lens model": (put("lens", "model", value="pinhole"), "model of lens must be one of brown, "),
    "usable 0": (put("lens", "usable_px", value=0), "usable_px of lens must be a number from 1"),
    "lens key": (put("lens", "k9", value=0), "lens has 'k9', which nobody knows"),
    "rows 0": (put("projector", "rows", value=0), "rows of projector must be an integer"),
    "rows 10^9": (put("projector", "rows", value=10**9), "rows of projector must be an integer"),
    "12544 beams": (lambda c: c["projector"].update(rows=112, columns=112), "more than 512 beams"),
    "base of two": (put("projector", "base_mm", value=[5, 0]), "base_mm of projector must be a"),
    "base of text": (put("projector", "base_mm", value=["5", 0, 0]), "base_mm of projector must"),
    "base null": (put("projector", "base_mm", value=None), "base_mm of projector must be a list"),
    "pitch 1e30": (put("projector", "pitch_deg", value=1e30), "pitch_deg of projector must be"),
    "a beam less": (drop("beams", 3), "beams of the file must be a list of 49 beams"),
    "beams null": (put("beams", value=None), "beams of the file must be a list of 49 beams"),
    "beam of text": (put("beams", 3, value="beam"), "beam 3 must be an object"),
    "beam lacks a": (drop("beams", 3, "a"), "beam 3 lacks a"),
    "beam's planes": (put("beams", 3, "planes", value=-1), "planes of beam 3 must be an integer"),
    "depths reversed": (put("depth_range", value=[110, 40]), "depth_range of the file must be two"),
    "depth 0": (put("depth_range", value=[0, 40]), "depth_range of the file must be two"),
    "unit 0": (put("inverse_z_unit", value=0), "inverse_z_unit of the file must be a number"),
    "unit huge": (put("inverse_z_unit", value=1e300), "inverse_z_unit of the file must be"),
    "settings null": (put("settings", value=None), "settings must be an object"),
    "radial short": (drop("settings", "radial", 0), "radial of settings must be a list of 1024"),
    "radial negative": (put("settings", "radial", 9, value=-1), "radial of settings must be"),
    "radial float": (put("settings", "radial", 9, value=1.0), "radial of settings must be"),
    "reciprocal wide": (put("settings", "reciprocal", 9, value=1 << 36), "reciprocal of settings"),
    "line wide": (put("settings", "line", 9, value=1 << 36), "line of settings must be a list of"),
    "window text": (put("settings", "window", value="0" * 49), "window of settings must be a list"),
    "depth long": (lambda c: c["settings"]["depth"].extend([0] * 1000), "depth of settings must"),
    "erosion": (put("settings", "erosion", value="both"), "erosion of settings must be one of off"),
    "erosion list": (put("settings", "erosion", value=["off"]), "erosion of settings must be one"),
    "even window": (put("settings", "mean_window", value=10), "mean_window of settings must be an"),
    "no lit gain": (put("settings", "lit_gain", value=0), "lit_gain of settings must be an"),
    "level 0": (put("settings", "level_fixed", value=0), "level_fixed of settings must be an int"),
    "level true": (put("settings", "level_fixed", value=True), "level_fixed of settings must be"),
    "area 0": (put("settings", "area_min", value=0), "area_min of settings must be an integer"),
    "weighted 2": (put("settings", "weighted", value=2), "weighted of settings must be true or"),
    "tangential": (put("settings", "tangential_1", value=1 << 17), "tangential_1 of settings must"),
    "remap text": (put("settings", "remap", value="yes"), "remap of settings must be true or fal"),
    "budget list": (put("budget", value=[1]), "budget must be an object"),
    "budget text": (put("budget", "lens_px", value="good"), "lens_px of budget must be a number"),
}

#: Octets that no forger would have written by :mod:`json`.
RAW = {
    "a list": (signed("[1,\n"), "it is not valid JSON"),
    "a number": (signed("1\n"), "it is not valid JSON"),
    "twice": (signed('{"format": "x", "format": "cyclope calibration",\n'), "has 'format' twice"),
    "not a number": (signed('{"format": "cyclope calibration", "version": NaN,\n'), "NaN is no"),
    "infinity": (signed('{"version": -Infinity,\n'), "-Infinity is no number"),
    "5000 digits": (signed('{"version": ' + "9" * 5000 + ",\n"), "it is not valid JSON"),
    "deep lists": (signed('{"format": ' + "[" * 100_000 + ",\n"), "it is nested too deeply"),
    "deep objects": (signed('{"format": ' + '{"a":' * 100_000 + ",\n"), "nested too deeply"),
    "no text": (signed('{"format": "\xff\xfe",\n'), "it is not valid JSON"),
    "empty": (b"", "is empty"),
    "text": (b"calibration", "its check sum is wrong"),
    "binary": (bytes(range(256)) * 100, "its check sum is wrong"),
    "zeros": (bytes(100_000), "its check sum is wrong"),
    "2 MB": (signed(" " * 2_000_000 + "{"), "octets, more than the 1048576 that are read"),
}


def run(path, tmp_path):
    """The words of a run with a calibration."""
    return ("run", tmp_path / "frames", "--calibration", path, "--engine", "model", "-o",
            tmp_path / "out", "--no-pictures")


@pytest.fixture
def path(prepared, tmp_path):
    """Where the calibration is written, beside a folder of frames."""
    (tmp_path / "frames").symlink_to(prepared[0] / "frames")
    return tmp_path / "calibration.json"


@pytest.mark.parametrize("kind", FORGED)
def test_forged_values_are_refused(kind, prepared, path, tmp_path, refused):
    change, words = FORGED[kind]
    content = json.loads(prepared[1].read_bytes())
    change(content)
    path.write_bytes(forged(content))
    message = refused(*run(path, tmp_path))
    assert f"The calibration {path} " in message and words in message


@pytest.mark.parametrize("kind", RAW)
def test_forged_octets_are_refused(kind, path, tmp_path, refused):
    octets, words = RAW[kind]
    path.write_bytes(octets)
    message = refused(*run(path, tmp_path))
    assert f"The calibration {path} " in message and words in message


def test_the_forger_changes_nothing_else(prepared, path, tmp_path):
    """Without a change, what he writes is good."""
    path.write_bytes(forged(json.loads(prepared[1].read_bytes())))
    assert cli.main(run(path, tmp_path)) == 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_any_words_in_the_tables_are_measured(seed, prepared, path, tmp_path, capfd):
    """Tables of noise are a bad calibration, which the model measures with to the end."""
    import numpy as np
    content = json.loads(prepared[1].read_bytes())
    rng = np.random.default_rng(seed)
    for name, bits in (("line", 36), ("window", 36), ("depth", 36), ("reciprocal", 36),
                       ("radial", 18)):
        table = content["settings"][name]
        table[:] = rng.integers(0, 1 << bits, len(table)).tolist()
    path.write_bytes(forged(content))
    assert cli.main(run(path, tmp_path)) in (0, 3)
    assert capfd.readouterr().err == ""
