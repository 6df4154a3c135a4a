"""The calibration file: read back exactly, refused when damaged."""

import json
import zlib
from dataclasses import replace

import numpy as np
import pytest

from calibration import file
from calibration.projector import Projector
from calibration.remap import remap_table
from model.errors import UserError
from model.settings import RADIAL_WORDS, RECIPROCAL_WORDS, Settings
from tb.model.rig_spots import endoscope


@pytest.fixture(scope="module")
def calibration():
    """A calibration with plain numbers in the tables that are not tested here."""
    lens, lines, windows, tables = endoscope()
    beams = tuple(
        file.Beam(a=lines.a[k], b=lines.b[k], alpha=lines.alpha[k], beta=lines.beta[k],
                  u_min=windows.low[k], u_max=windows.high[k], tolerance=windows.tolerance[k],
                  separation=None, residual_u=0.1, residual_v=0.1, relative_area=1.0,
                  planes=8) for k in range(49))
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
    filtered = replace(calibration, bayer="GBRG")
    file.save(filtered, path)
    assert file.load(path) == filtered
    remapped = replace(
        calibration, settings=replace(calibration.settings, remap=remap_table(calibration.lens)))
    file.save(remapped, path)
    assert file.load(path) == remapped


def test_beams_that_were_left_out(calibration, tmp_path):
    path = tmp_path / "calibration.json"
    beams = tuple(None if number in (3, 40) else beam
                  for number, beam in enumerate(calibration.beams))
    some = replace(calibration, beams=beams, remarks={3: "left out: dead", 7: "overbright"})
    file.save(some, path)
    assert file.load(path) == some and some.left_out == (3, 40)
    file.save(replace(some, beams=(None,) * 49), path)
    with pytest.raises(UserError, match="a list with at least one beam"):
        file.load(path)


def test_every_flipped_bit_is_refused(calibration):
    """The check sum sees every single bit of the body; the trailer is compared byte by byte."""
    data = file.encode(calibration)
    assert file.decode(data) == calibration
    ends = {0, 1, 2, *range(len(data) - 40, len(data))}
    positions = sorted(ends | set(np.random.default_rng(1).integers(0, len(data), 300).tolist()))
    for position in positions:
        for bit in range(8):
            broken = bytearray(data)
            broken[position] ^= 1 << bit
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
    with pytest.raises(UserError, match="does not exist: make one with `cyclope calibrate"):
        file.load(tmp_path / "none.json")
    with pytest.raises(UserError, match="is not a file"):
        file.load(tmp_path)
    with pytest.raises(UserError, match="cannot be written"):
        file.save(calibration, tmp_path / "none" / "calibration.json")


@pytest.mark.parametrize("old, new, message", [
    (b'"version": 1', b'"version": 2', "is of version 2, this program reads version 1"),
    (b'"cyclope calibration"', b'"something else"', "is not a calibration file"),
    (b'"inverse_z_unit"', b'"unit"', "the file lacks inverse_z_unit"),
    (b'"erosion": "gate"', b'"erosion": "what"', "erosion of settings must be one of off, erode"),
    (b'"rows": 7', b'"rows": 8', "beams of the file must be a list of 56 beams"),
    (b'"height": 288', b'"height": 288, "bayer": "RGB"', "bayer of sensor must be one of RGGB, GR"),
    (b'"height": 288', b'"height": 288, "bayer": []', "bayer of sensor must be one of RGGB, GR"),
    (b'"remarks": {}', b'"remarks": {"49": "dead"}', "49 of remarks must be of a beam of the mesh"),
    (b'"remarks": {}', b'"remarks": {"4": 1}', "4 of remarks must be a text of up to 400")])
def test_other_files_with_a_good_check_sum_are_refused(calibration, old, new, message):
    body = file.encode(calibration).split(b'"crc32"')[0].replace(old, new)
    with pytest.raises(UserError, match=message):
        file.decode(body + b'"crc32": "%08x"\n}\n' % zlib.crc32(body))


def test_other_sensor_is_refused(calibration):
    calibration.check_sensor(352, 288)
    with pytest.raises(UserError, match="for a sensor of 352 x 288 pixels, not 640 x 480"):
        calibration.check_sensor(640, 480)
