"""Images and capture folders that are read, and all those that are refused."""

import shutil

import cv2
import numpy as np
import pytest

from calibration.capture import read_capture, read_image
from model.errors import UserError


def broken_png(path, image, at):
    """A PNG with one wrong octet."""
    data = bytearray(cv2.imencode(".png", image)[1].tobytes())
    data[at] ^= 1
    path.write_bytes(data)


def cut(path, image, suffix, share=0.6):
    """The first part of an image file."""
    data = cv2.imencode(suffix, image)[1].tobytes()
    path.write_bytes(data[:int(len(data) * share)])


GREY = np.random.default_rng(1).integers(0, 256, (48, 64), np.uint8)
IMAGES = {
    "missing": (lambda p: None, "does not exist"),
    "folder": (lambda p: p.mkdir(), "is not a file"),
    "empty": (lambda p: p.touch(), "is empty"),
    "text": (lambda p: p.write_text("hello"), "cannot be read as an image"),
    "png cut": (lambda p: cut(p, GREY, ".png"), "is truncated or damaged"),
    "png without end": (lambda p: cut(p, GREY, ".png", 0.997), "is truncated or damaged"),
    "png wrong bit": (lambda p: broken_png(p, GREY, 700), "is truncated or damaged"),
    "jpg cut": (lambda p: cut(p, GREY, ".jpg"), "is truncated or damaged"),
    "bmp cut": (lambda p: cut(p, GREY, ".bmp"), "is truncated or damaged"),
    "pgm cut": (lambda p: cut(p, GREY, ".pgm"), "is truncated or damaged"),
    "tiff cut": (lambda p: cut(p, GREY, ".tiff"), ""),
    "colour": (lambda p: p.write_bytes(cv2.imencode(".png", cv2.merge([GREY] * 3))[1].tobytes()),
               "is a colour image"),
    "16 bits": (lambda p: p.write_bytes(
        cv2.imencode(".png", GREY.astype(np.uint16))[1].tobytes()), "has 16 bits per pixel"),
    "size": (lambda p: p.write_bytes(cv2.imencode(".png", GREY[:40])[1].tobytes()),
             "has 64 x 40 pixels instead of the sensor's 64 x 48"),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_bad_images_are_refused_in_one_sentence(kind, tmp_path):
    make, words = IMAGES[kind]
    path = tmp_path / "picture.png"
    make(path)
    with pytest.raises(UserError) as caught:
        read_image(path, 64, 48)
    message = str(caught.value)
    assert message.startswith(str(path)) and words in message
    assert message.endswith(".") and "\n" not in message


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".jpg", ".tiff"])
def test_photographs_of_the_board_may_be_in_colour(suffix, tmp_path):
    """Their luma is taken; frames to measure are refused."""
    colours = cv2.merge([GREY, cv2.flip(GREY, 0), cv2.flip(GREY, 1)])
    path = tmp_path / f"board{suffix}"
    cv2.imwrite(str(path), colours)
    luma = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2GRAY)
    wrong = np.abs(read_image(path, 64, 48, colour=True).astype(int) - luma)
    assert wrong.mean() < 2 if suffix == ".jpg" else wrong.max() <= 1
    with pytest.raises(UserError, match="is a colour image"):
        read_image(path, 64, 48)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".tiff"])
def test_good_images_are_read_exactly(suffix, tmp_path):
    path = tmp_path / f"picture{suffix}"
    assert cv2.imwrite(str(path), GREY)
    np.testing.assert_array_equal(read_image(path, 64, 48), GREY)
    np.testing.assert_array_equal(read_image(str(path)), GREY)
    photograph = tmp_path / "photograph.jpg"
    assert cv2.imwrite(str(photograph), np.full((48, 64), 90, np.uint8))
    assert np.abs(read_image(photograph, 64, 48).astype(int) - 90).max() <= 2


def edit(name, old, new):
    """Replaces text in a file of the capture."""
    def change(folder):
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))
    return change


def emptied(name):
    """Empties a sub-folder."""
    def change(folder):
        shutil.rmtree(folder / name)
        (folder / name).mkdir()
    return change


CAPTURES = {
    "no folder": (shutil.rmtree, "does not exist"),
    "empty folder": (emptied(""), "is empty"),
    "no toml": (lambda f: (f / "capture.toml").unlink(), "capture.toml does not exist"),
    "bad toml": (edit("capture.toml", "width =", "width"), "capture.toml is not valid TOML"),
    "binary toml": (lambda f: (f / "capture.toml").write_bytes(b"\xff\xfe\x00"), "not valid TOML"),
    "no section": (edit("capture.toml", "[sensor]", "[other]"), "has no section [sensor]"),
    "no key": (edit("capture.toml", "focal_px", "focal"), "has no focal_px in [sensor]"),
    "text width": (edit("capture.toml", "width = 64", "width = '64'"), "width in [sensor] must be"),
    "true width": (edit("capture.toml", "width = 64", "width = true"), "width in [sensor] must be"),
    "wide": (edit("capture.toml", "width = 64", "width = 1040"), "an integer from 8 to 1024"),
    "no focal": (edit("capture.toml", "focal_px = ", "focal_px = -"), "focal_px in [sensor] must"),
    "endless": (edit("capture.toml", "pitch_deg = ", "pitch_deg = inf #"), "pitch_deg in"),
    "many beams": (edit("capture.toml", "columns = 4\npitch", "columns = 400\npitch"), "4 x 400 "),
    "base": (edit("capture.toml", "base_mm = [", "base_mm = [1, "), "base_mm in [projector] must"),
    "filters": (edit("capture.toml", "[projector]", "bayer = 'RGB'\n[projector]"),
                "bayer in [sensor] must be one of RGGB, GRBG, GBRG, BGGR, or left out, not 'RGB'"),
    "dead number": (edit("capture.toml", "[lens]", "dead = 3\n[lens]"), "dead in [projector] must"),
    "dead row": (edit("capture.toml", "[lens]", "dead = [[4, 0]]\n[lens]"),
                 "a list of beams [row, column], counted from 0, of the 4 x 4 mesh, not [[4, 0]]"),
    "no base": (edit("capture.toml", "base_mm = [", "base_mm = [0, 0, 0] # ["), "x other than 0"),
    "square": (edit("capture.toml", "square_mm = 8.0", "square_mm = 0"), "square_mm in [lens]"),
    "no lens": (lambda f: shutil.rmtree(f / "lens"), "is not a folder that can be read"),
    "empty lens": (emptied("lens"), "lens holds no images"),
    "no planes": (emptied("planes"), "planes.csv does not exist"),
    "header": (edit("planes/planes.csv", "z_mm", "depth"), "must have the columns file,z_mm"),
    "empty table": (lambda f: (f / "planes/planes.csv").write_text(""), "must have the columns"),
    "no rows": (lambda f: (f / "planes/planes.csv").write_text("file,z_mm\n"), "names no plane"),
    "no number": (edit("planes/planes.csv", "00.png,", "00.png,far"), "line 2: z_mm must be"),
    "behind": (edit("planes/planes.csv", "00.png,", "00.png,-"), "line 2: z_mm must be"),
    "twice": (edit("planes/planes.csv", "01.png", "00.png"), "00.png twice, in lines 2 and 3"),
    "elsewhere": (edit("planes/planes.csv", "01.png", "../01.png"), "is not the name of a file"),
    "no picture": (lambda f: (f / "planes/03.png").unlink(), "03.png does not exist"),
}


@pytest.mark.parametrize("kind", CAPTURES)
def test_bad_captures_are_refused_in_one_sentence(kind, small_capture, tmp_path):
    change, words = CAPTURES[kind]
    copy = tmp_path / "capture"
    shutil.copytree(small_capture, copy)
    change(copy)
    with pytest.raises(UserError) as caught:
        read_capture(copy)
    message = str(caught.value)
    assert words in message and str(copy) in message
    assert message.endswith(".") and "\n" not in message


def test_bad_picture_in_a_capture_is_refused(small_capture, tmp_path):
    copy = tmp_path / "capture"
    shutil.copytree(small_capture, copy)
    (copy / "lens" / "03.png").write_bytes(b"")
    (copy / "planes" / "05.png").write_bytes(b"no picture")
    found = read_capture(copy)
    with pytest.raises(UserError, match=r"lens/03\.png is empty"):
        found.lens_images()
    with pytest.raises(UserError, match=r"planes/05\.png cannot be read as an image"):
        found.plane_images()


def test_table_of_planes_may_come_from_a_spreadsheet(small_capture, tmp_path):
    copy = tmp_path / "capture"
    shutil.copytree(small_capture, copy)
    path = copy / "planes" / "planes.csv"
    lines = path.read_text().splitlines()
    text = "\r\n".join(["note,z_mm , file", *(
        f'"far, far",{line.split(",")[1]}, {line.split(",")[0]}' for line in lines[1:]), "", ""])
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_capture(copy).planes == tuple(
        (copy / "planes" / picture.name, z) for picture, z in read_capture(small_capture).planes)
