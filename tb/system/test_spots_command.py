"""``cyclope spots``: any images, no calibration."""

import csv
import os

import cv2
import numpy as np
import pytest
from PIL import Image

from model.optics import render, scenes
from model.optics.rigs import RIGS
from scripts.cyclope import cli
from scripts.results.spot_rows import SPOT, is_too_small, spots_of


def table(folder):
    """Rows of ``spots.csv``."""
    with open(folder / "spots.csv", newline="") as file:
        return list(csv.DictReader(file))


def save(path, image):
    """Write an image, and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def blobs(shape, places, peak=200.0, sigma=1.3, ground=30.0):
    """Gaussian spots at (u, v)."""
    v, u = np.mgrid[:shape[0], :shape[1]]
    levels = np.full(shape, ground)
    for column, row in places:
        levels += peak * np.exp(-((u - column) ** 2 + (v - row) ** 2) / (2 * sigma**2))
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


PLACES = [(20.3, 15.6), (41.7, 18.2), (30.0, 40.5), (52.4, 44.1)]


def test_spots_of_a_simulated_frame():
    rig = RIGS["endoscope"]
    image, truth = render.pattern_frame(rig, scenes.Plane(70.0), np.random.default_rng(1))
    spots = spots_of(image)
    assert spots.dtype == SPOT and len(spots) == 49 and not spots["status"].any()
    distance = np.hypot(spots["u"][:, None] - truth["u_px"], spots["v"][:, None] - truth["v_px"])
    assert distance.min(axis=1).max() < 0.15 and len(set(distance.argmin(axis=1))) == 49
    for spot in spots:
        u, v = round(spot["u"]), round(spot["v"])
        assert spot["peak"] == image[v - 3:v + 4, u - 3:u + 4].max()
    assert (spots["weight"] >= spots["area"]).all()


def test_saturated_spots_are_flagged():
    image = np.maximum(blobs((64, 64), PLACES[:2]), blobs((64, 64), PLACES[2:], peak=400))
    spots = spots_of(image)
    assert len(spots) == 4
    assert [bool(spot["saturated"]) for spot in spots] == [spot["v"] > 30 for spot in spots]
    assert (spots["saturated"] == (spots["peak"] == 255)).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (5, 300), (300, 5), (8, 8), (9, 9), (9, 512),
                                   (17, 23), (512, 9), (512, 512)])
@pytest.mark.parametrize("kind", ["black", "white", "noise", "checks", "dots", "ramp"])
def test_any_image_has_spots_or_none(kind, shape):
    v, u = np.mgrid[:shape[0], :shape[1]]
    image = {
        "black": np.zeros(shape), "white": np.full(shape, 255), "checks": (u + v) % 2 * 255,
        "noise": np.random.default_rng(1).integers(0, 256, shape),
        "dots": ((u % 3 == 1) & (v % 2 == 0)) * 200, "ramp": u * 255 // max(shape[1] - 1, 1),
    }[kind].astype(np.uint8)
    spots = spots_of(image)
    assert not (is_too_small(image) and len(spots)) and len(spots) <= 40_000
    assert np.isfinite(spots["u"]).all() and (spots["area"] > 0).all()
    if kind in ("black", "white"):
        assert not len(spots)


def test_many_spots():
    """A spot on each 5 x 5 pixels, and a pixel on each 4 x 4, which is no spot by its area."""
    v, u = np.mgrid[:512, :512]
    spots = spots_of(np.where((u % 5 < 2) & (v % 5 < 2), 180, 20).astype(np.uint8))
    assert len(spots) == 103 * 103 and not spots["status"][spots["area"] == 4].any()
    assert (np.abs(spots["u"] % 5 - 0.5) < 0.01).mean() > 0.98
    spots = spots_of(np.where((u % 4 == 2) & (v % 4 == 2), 180, 20).astype(np.uint8))
    assert len(spots) == 128 * 128 and (spots["status"] == 1).all() and (spots["area"] == 1).all()


def test_table_pictures_and_sheet(tmp_path, capsys):
    folder = tmp_path / "in"
    first = blobs((64, 64), PLACES)
    save(folder / "a, b.png", first)
    save(folder / "b.png", np.full((40, 50), 90, np.uint8))
    save(folder / "tiny.png", np.full((5, 5), 90, np.uint8))
    (folder / "notes.txt").write_text("mine")
    out = tmp_path / "out"
    assert cli.main(["spots", folder, "-o", out, "--sheet"]) == 0
    printed = capsys.readouterr().out
    assert f"4 spots in 3 images, in {out}\n" in printed
    assert "b.png: all pixels alike: no spots" in printed and "notes.txt" in printed
    assert "tiny.png: smaller than the window" in printed
    assert (out / "spots.csv").read_text().startswith(
        "file,u_px,v_px,area_px,weight,peak,saturated,status,border\n")
    rows = table(out)
    spots = spots_of(first)
    assert [(row["file"], row["u_px"], row["v_px"], row["area_px"], row["weight"], row["peak"],
             row["saturated"], row["status"]) for row in rows] == [
        ("a, b.png", f"{spot['u']:.4f}", f"{spot['v']:.4f}", str(spot["area"]),
         str(spot["weight"]), str(spot["peak"]), "0", "ok") for spot in spots]
    names = {path.name: cv2.imread(str(path)) for path in (out / "pictures").iterdir()}
    assert {name: image.shape for name, image in names.items()} == {
        "a, b.png": (192, 192, 3), "b.png": (120, 150, 3), "tiny.png": (15, 15, 3)}
    assert (names["b.png"] == 90).all()
    coloured = np.ptp(names["a, b.png"].astype(int), axis=2) > 40
    assert 50 < coloured.sum() < 2000
    assert cv2.imread(str(out / "sheet.png")).std() > 5


def test_images_of_the_same_name(tmp_path, capsys):
    image = blobs((64, 64), PLACES)
    paths = [save(tmp_path / name, image) for name in ("x/1.png", "y/1.png", "y/1.bmp", "y/2.png")]
    assert cli.main(["spots", paths[0], tmp_path / "y", paths[3], "-o", tmp_path / "out"]) == 0
    assert "16 spots in 4 images" in capsys.readouterr().out
    files = [row["file"] for row in table(tmp_path / "out")]
    assert set(files) == {str(paths[0]), str(paths[1]), "1.bmp", "2.png"}
    assert len(list((tmp_path / "out" / "pictures").iterdir())) == 4


def test_a_capture_shows_its_pattern_frames(tmp_path, capsys):
    capture = tmp_path / "capture"
    assert cli.main(["simulate", "plane", capture, "--rig", "small", "--frames", "2"]) == 0
    assert cli.main(["spots", capture, "-o", tmp_path / "out"]) == 0
    assert {row["file"] for row in table(tmp_path / "out")} == {"0000_ir.png", "0001_ir.png"}


@pytest.mark.parametrize("name, content, words", [
    ("bad.png", b"\x89PNG\r\n\x1a\nrest", "truncated or damaged"),
    ("bad.png", b"", "is empty"), ("bad.jpg", b"text", "cannot be read as an image"),
    ("wide.png", np.zeros((4, 1100), np.uint8), "at most 1024 x 1024"),
    ("colour.png", np.zeros((64, 64, 3), np.uint8), "colour image"),
    (None, None, "does not exist"), ("readme.txt", b"text", "holds no images")])
@pytest.mark.parametrize("beside", [True, False])
def test_what_cannot_be_read_is_refused(name, content, words, beside, tmp_path, capsys):
    folder = tmp_path / "in"
    folder.mkdir()
    if isinstance(content, bytes):
        (folder / name).write_bytes(content)
    elif name:
        save(folder / name, content)
    else:
        folder = folder / "missing"
    targets = [save(tmp_path / "good.png", blobs((64, 64), PLACES))] if beside else []
    assert cli.main(["spots", *targets, folder, "-o", tmp_path / "out"]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1
    assert not (tmp_path / "out").exists()


def written(path, kind, image):
    """A file of the user's, of some kind, with an image's pixels."""
    picture = Image.fromarray(image)
    if kind == "16 bits":
        picture = Image.fromarray(image.astype(np.uint16) * 257)
    elif kind in ("LA", "RGBA", "P", "1", "RGB", "CMYK", "F"):
        picture = picture.convert(kind)
    pages = [picture, picture] if kind == "pages" else []
    if kind == "ascii":
        path.write_text(f"P2\n# by hand\n{image.shape[1]} {image.shape[0]}\n255\n"
                        + "\n".join(map(str, image.ravel())))
    elif kind == "turned":
        exif = picture.getexif()
        exif[0x0112] = 6
        picture.save(path, exif=exif, quality=100)
    else:
        picture.save(path, **({"save_all": True, "append_images": pages} if pages else {}))
    return path


@pytest.mark.parametrize("name, kind, words", [
    ("1.png", "16 bits", "16 bits per pixel"), ("1.tif", "F", "32 bits per pixel"),
    ("1.png", "1", "1 bit per pixel"), ("1.png", "LA", "transparent pixels"),
    ("1.png", "RGBA", "transparent pixels"), ("1.png", "P", "a colour image"),
    ("1.jpg", "RGB", "a colour image"), ("1.jpg", "CMYK", "a colour image"),
    ("1.tif", "pages", "several images"), ("1.png", "pages", "several images")])
def test_other_kinds_of_images_are_refused(name, kind, words, tmp_path, capsys):
    path = written(tmp_path / name, kind, blobs((64, 64), PLACES))
    assert cli.main(["spots", path, "-o", tmp_path / "out"]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1


@pytest.mark.parametrize("name, kind", [
    ("1.pgm", "ascii"), ("1.png", "turned"), ("1.jpg", "turned"), ("1.TIFF", ""),
    ("with space.png", ""), ("S\u00e4ge \u65e5\u672c.png", ""), (os.fsdecode(b"\xff.png"), ""),
    ("-o.png", ""), ("100%.png", ""), (251 * "n" + ".png", ""), ("[bold].png", "")])
def test_kinds_and_names_of_images_that_are_taken(name, kind, tmp_path, capsys):
    image = blobs((64, 64), PLACES)
    path = written(tmp_path / name, kind, image)
    assert cli.main(["spots", path, "-o", tmp_path / "out", "--sheet"]) == 0
    assert "4 spots in 1 image" in capsys.readouterr().out
    with open(tmp_path / "out" / "spots.csv", newline="", errors="surrogateescape") as file:
        rows = list(csv.DictReader(file))
    assert {row["file"] for row in rows} == {name}
    found = np.array([[float(row["u_px"]), float(row["v_px"])] for row in rows])
    spots = spots_of(image)  # pixels as they are stored: an orientation turns nothing
    assert np.hypot(*(found - np.stack([spots["u"], spots["v"]], axis=-1)).T).max() < 0.1
    assert len(list((tmp_path / "out" / "pictures").iterdir())) == 1


def test_frames_of_a_video(tmp_path, capsys):
    for number in range(24):
        save(tmp_path / "in" / f"frame_{number:05}.jpg", blobs((64, 64), PLACES[:number % 5]))
    assert cli.main(["spots", tmp_path / "in", "-o", tmp_path / "out"]) == 0
    printed = capsys.readouterr().out
    assert "46 spots in 24 images" in printed and printed.count("no spots") == 5


@pytest.mark.parametrize("count", [0, 1, 100, 10_000, 40_000])
def test_any_number_of_bright_pixels(count):
    image = np.full((512, 512), 20, np.uint8)
    image.flat[np.random.default_rng(1).choice(image.size, count, replace=False)] = 200
    spots = spots_of(image)
    assert len(spots) <= count and (count > 1000 or len(spots) >= 0.8 * count)


def test_a_filled_folder_is_left_alone(tmp_path, capsys):
    image = save(tmp_path / "in" / "1.png", blobs((64, 64), PLACES))
    assert cli.main(["spots", image, "-o", tmp_path / "in"]) == 2
    assert "already holds files" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "in").iterdir()] == ["1.png"]


def test_the_chip_finds_the_same_spots(tmp_path, capsys):
    """Spots, saturated ones, noise, none, and an image smaller than the window."""
    rng = np.random.default_rng(1)
    images = [blobs((48, 40), [(12.2, 9.7), (25.1, 30.4)]), np.full((48, 40), 9, np.uint8),
              blobs((48, 40), rng.uniform(3, 37, (9, 2)), peak=400),
              rng.integers(0, 256, (48, 40), dtype=np.uint8), np.zeros((6, 40), np.uint8)]
    for number, image in enumerate(images):
        save(tmp_path / "in" / f"{number}.png", image)
    for engine in ("model", "rtl"):
        assert cli.main(["spots", tmp_path / "in", "-o", tmp_path / engine,
                         "--engine", engine]) == 0
    assert table(tmp_path / "rtl") == table(tmp_path / "model")
    assert {row["file"] for row in table(tmp_path / "rtl")} >= {"0.png", "2.png"}
    save(tmp_path / "narrow.png", np.zeros((40, 12), np.uint8))
    capsys.readouterr()
    assert cli.main(["spots", tmp_path / "narrow.png", "-o", tmp_path / "none", "--engine",
                     "rtl"]) == 2
    assert "There is no chip for images of 12 x 40 pixels" in capsys.readouterr().err
