"""Images that are damaged, hostile or of another kind, as frames, textures and photographs."""

import random

import numpy as np
import pytest

from calibration import image as images
from model.errors import UserError
from scripts.cyclope import cli
from tb.files.images import ACCEPTED, GREY, REFUSED


@pytest.mark.parametrize("kind", REFUSED)
def test_frames_are_refused(kind, prepared, tmp_path, refused):
    octets, words = REFUSED[kind]
    path = tmp_path / "0007.png"
    path.write_bytes(octets)
    message = refused("run", path, "--calibration", prepared[1], "--engine", "model", "-o",
                      tmp_path / "out")
    assert message.startswith(f"cyclope: {path} ") and words in message


@pytest.mark.parametrize("kind", ["jpeg damaged", "png colour", "empty"])
def test_textures_are_refused(kind, prepared, tmp_path, refused):
    (tmp_path / "0007_ir.png").write_bytes(ACCEPTED["png"])
    (tmp_path / "0007_texture.png").write_bytes(REFUSED[kind][0])
    message = refused("run", tmp_path, "--calibration", prepared[1], "--engine", "model", "-o",
                      tmp_path / "out")
    assert "0007_texture.png" in message and REFUSED[kind][1] in message


@pytest.mark.parametrize("kind", ACCEPTED)
def test_good_images_are_read_in_silence(kind, tmp_path, capfd):
    path = tmp_path / "image"
    path.write_bytes(ACCEPTED[kind])
    image = images.read_image(path, 352, 288)
    assert image.shape == (288, 352) and image.dtype == np.uint8
    if not kind.startswith(("jpeg", "png with")):
        np.testing.assert_array_equal(image, GREY)
    elif kind.startswith("jpeg"):
        assert np.abs(image - GREY.astype(int)).mean() < 12
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_of_many_scans_is_not_decoded(tmp_path, monkeypatch):
    """Each would take as long as an image."""
    def decoded(*_, **__):
        raise AssertionError("it was decoded")

    monkeypatch.setattr(images.simplejpeg, "decode_jpeg", decoded)
    path, octets = tmp_path / "0.jpg", ACCEPTED["jpeg progressive"]
    path.write_bytes(octets[:-2] + octets[octets.rindex(b"\xff\xda"):-2] * 100 + octets[-2:])
    with pytest.raises(UserError, match="is truncated or damaged") as caught:
        images.read_image(path)
    assert str(caught.value.__cause__) == "too many scans"


@pytest.mark.parametrize("seed", [1, 2])
def test_damage_of_any_kind_is_one_sentence(seed, monkeypatch, capfd):
    """Octets changed, lost and added anywhere, most often in the headers."""
    rng = random.Random(seed)
    refusals = 0
    for _ in range(400):
        data = bytearray(ACCEPTED[rng.choice(sorted(ACCEPTED))])
        for _ in range(rng.choice((1, 2, 5, 20))):
            at = rng.randrange(min(len(data), rng.choice((40, 200, len(data)))))
            what = rng.random()
            if what < 0.6:
                data[at] = rng.choice((0, 1, 127, 128, 255))
            elif what < 0.8:
                data[at:at] = rng.randbytes(rng.randrange(8))
            else:
                del data[at:at + rng.choice((1, 10, 100_000))]
            data = data or bytearray(b"-")
        monkeypatch.setattr(images, "read_octets", lambda *_, data=data: bytes(data))
        try:
            image = images.read_image("0001.png", 352, 288)
            assert image.shape == (288, 352) and image.dtype == np.uint8
        except UserError as error:
            refusals += 1
            assert str(error).startswith("0001.png ") and str(error).endswith(".")
    assert refusals > 200 and capfd.readouterr() == ("", "")


def test_a_white_frame_is_reported(prepared, tmp_path, capfd):
    """Every pixel but a few is saturated, which is said, and the exit status is 3."""
    from PIL import Image
    image = np.full((288, 352), 255, np.uint8)
    image[:9] = 0
    Image.fromarray(image).save(tmp_path / "0.png")
    assert cli.main(["run", tmp_path / "0.png", "--calibration", prepared[1], "--engine", "model",
                     "--no-pictures", "-o", tmp_path / "out"]) == 3
    out, err = capfd.readouterr()
    assert "overexposed: 96.9 % of its pixels are 255" in " ".join(out.split()) and err == ""
