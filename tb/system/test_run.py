"""``cyclope run`` and the demonstration: what they write, and what they refuse."""

import csv
import errno
import io
import json
import resource
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from hdl.protocol import Flag
from model.errors import UserError
from scripts import demo
from scripts.cyclope import cli
from scripts.host.decoder import Frame
from scripts.paths import ROOT
from scripts.results import accuracy, demo_figures, frames, measure, measurement, overlay
from scripts.results.points import POINT, STATUS
from scripts.simulation import library as native
from tb.host.clouds import read_ply
from tb.system.conftest import CACHE


@pytest.fixture(scope="session")
def measured(prepared, tmp_path_factory):
    """The result of a run of all frames with the model."""
    capture, calibration = prepared
    out = tmp_path_factory.mktemp("measured") / "out"
    assert cli.main(["run", capture, "--calibration", calibration, "--engine", "model", "-o",
                     out]) == 0
    return out


def frames_of(capture):
    """The capture's pattern images."""
    return sorted((capture / "frames").glob("*_ir.png"))


def table(path):
    """Rows of points.csv."""
    return list(csv.DictReader(io.StringIO((path / "points.csv").read_text())))


def model(prepared, targets, out, *options):
    """Exit status of a run with the model, without pictures."""
    targets = targets if isinstance(targets, list) else [targets]
    return cli.main(["run", *targets, "--calibration", prepared[1], "--engine", "model",
                     "--no-pictures", "-o", out, *options])


def test_everything_is_written(measured, prepared):
    names = {path.name for path in measured.iterdir()}
    assert names == {"points.csv", "points.ply", "frames", "point_cloud.png", "depth_error.png",
                     "summary.txt"}
    count = len(frames_of(prepared[0]))
    pictures = sorted((measured / "frames").iterdir())
    assert [path.name for path in pictures] == [f"{index:04}.png" for index in range(count)]
    for path in [*pictures, measured / "point_cloud.png", measured / "depth_error.png"]:
        picture = cv2.imread(str(path))
        assert picture.shape[0] > 288 and picture.std() > 5, path
    text = (measured / "summary.txt").read_text()
    assert "mean error" in text and "dropped" in text
    assert [path.name for path in measured.parent.iterdir()] == ["out"]


def test_table_and_cloud_agree(measured, prepared):
    text = (measured / "points.csv").read_text()
    assert text.startswith("frame,beam,u_px,v_px,area_px,x_mm,y_mm,z_mm,status,saturated,border\n")
    rows = table(measured)
    ok = [row for row in rows if row["status"] == "ok"]
    assert len(ok) > 250 and {row["status"] for row in rows} <= set(STATUS)
    for row in rows:
        coordinates = [row[name] for name in ("x_mm", "y_mm", "z_mm")]
        located = row["status"] in ("ok", "doubtful")
        assert all(coordinates) if located else not any(coordinates)
        assert bool(row["beam"]) == (located or row["status"] == "duplicate")
        assert 0 <= float(row["u_px"]) <= 351 and 0 <= float(row["v_px"]) <= 287
    octets = (measured / "points.ply").read_bytes()
    assert b"comment unit mm" in octets
    located = [row for row in rows if row["z_mm"]]
    found, _ = read_ply(octets)
    assert list(found) == ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "beam",
                           "frame", "status"]
    for name, column in (("x", "x_mm"), ("y", "y_mm"), ("z", "z_mm"), ("beam", "beam"),
                         ("frame", "frame")):
        assert np.allclose(found[name], [float(row[column]) for row in located], atol=1e-5)
    assert [STATUS[status] for status in found["status"]] == [row["status"] for row in located]
    assert (found["red"] > 0).all() and (found["red"] == found["blue"]).all()
    length = np.linalg.norm([found[name] for name in ("nx", "ny", "nz")], axis=0)
    assert (np.isclose(length, 1, atol=1e-3) | (length == 0)).all() and (length > 0).mean() > 0.9
    assert (found["nz"] <= 0).all()


def test_points_project_onto_their_spots(measured, prepared):
    from calibration import file
    lens = file.load(prepared[1]).lens
    ok = [row for row in table(measured) if row["status"] == "ok"]
    place = np.array([[float(row[name]) for name in ("x_mm", "y_mm", "z_mm")] for row in ok])
    seen = np.array([[float(row[name]) for name in ("u_px", "v_px")] for row in ok])
    image, _ = cv2.projectPoints(place, np.zeros(3), np.zeros(3), lens.matrix, lens.coefficients)
    assert np.abs(image[:, 0] - seen).max() < 0.005


def test_accuracy_on_the_polyp(measured, prepared):
    rows = table(measured)
    points = np.zeros(len(rows), POINT)
    for name, column in (("frame", "frame"), ("beam", "beam"), ("z", "z_mm")):
        points[name] = [float(row[column] or -1) for row in rows]
    points["status"] = [STATUS.index(row["status"]) for row in rows]
    truth = accuracy.load_truth(prepared[0] / "truth.csv")
    found = accuracy.compare(points, truth, np.unique(truth["frame"]))
    assert found.found >= 0.97 and found.wrong <= 0.005 and found.median < 0.002


def test_definitions_of_accuracy():
    truth = np.zeros(4, accuracy.TRUTH)
    truth["beam"], truth["z"] = range(4), (100, 50, 80, 90)
    truth["u"], truth["inside"] = (10, 20, 30, 40), (1, 1, 1, 0)
    points = np.zeros(5, POINT)
    points["beam"], points["z"] = (0, 1, 3, 9, -1), (101, 40, 90, 92, np.nan)
    points["u"], points["status"] = (10, 20, 40, 41, 5), (0, 0, 0, 0, 1)
    result = accuracy.compare(points, truth, [0, 7])
    assert result.expected == 3 and result.found == pytest.approx(2 / 3)
    assert result.wrong == pytest.approx(1 / 4)
    assert result.mean == pytest.approx((0.01 + 0.2 + 0 + 2 / 90) / 4)
    assert accuracy.compare(points, truth, [7]) is None


def test_first_frame_is_learnt_on_itself(prepared, measured, tmp_path):
    path = frames_of(prepared[0])[0]
    assert model(prepared, path, tmp_path / "out") == 0
    assert table(tmp_path / "out") == [row for row in table(measured) if row["frame"] == "0"]


def test_independent_frames_do_not_depend_on_their_order(prepared, tmp_path):
    paths = frames_of(prepared[0])[:3]
    for order, name in ((paths, "one"), (paths[::-1], "two")):
        folder = tmp_path / f"{name} in"
        folder.mkdir()
        for index, path in enumerate(order):
            shutil.copy(path, folder / f"{index}.png")
        assert model(prepared, folder, tmp_path / name, "--independent") == 0

    def rows(name, frame):
        return [{**row, "frame": ""} for row in table(tmp_path / name) if row["frame"] == frame]

    for index in range(3):
        assert rows("one", str(index)) == rows("two", str(2 - index))


@pytest.mark.parametrize("names, numbers", [
    (["0010_ir.png", "0002_ir.png"], [2, 10]), (["3.png", "20.png"], [3, 20]),
    (["b.png", "a.png"], [0, 1]), (["1.png", "01.png"], [0, 1]), (["7.png", "x.png"], [0, 1])])
def test_frames_are_numbered(names, numbers, tmp_path):
    for name in names:
        (tmp_path / name).touch()
    found = frames.find_frames([tmp_path])
    assert [entry.index for entry in found.entries] == numbers and found.truth is None
    assert bool(found.notes) == (set(numbers) == {0, 1} and "b.png" not in names)
    if set(numbers) == {0, 1}:
        assert [entry.path.name for entry in found.entries] == sorted(names)


def test_what_is_not_used_is_named(prepared, tmp_path, capsys):
    """Files of a folder that are no frames, frames that were named twice, unclear numbers."""
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("0001_ir.png", "0002.tif", "3_texture.png", "0004_ir.webp", "note.txt", ".hidden"):
        shutil.copy(frames_of(prepared[0])[0], folder / name)
    assert model(prepared, folder, tmp_path / "out") == 0
    printed = capsys.readouterr().out.replace("\n", " ")
    assert f"! not used in {folder}:" in " ".join(printed.split())
    assert "0002.tif, 0004_ir.webp, 3_texture.png, note.txt" in " ".join(printed.split())
    assert "0004_ir.webp" in (tmp_path / "out" / "summary.txt").read_text()
    path = folder / "0001_ir.png"
    assert frames.find_frames([path, path]).notes == [f"named twice: {path}"]
    shutil.copy(path, folder / "x_ir.png")
    notes = frames.find_frames([folder]).notes
    assert notes[0].startswith("frames are numbered by their position in the sorted list")


def test_texture_gives_the_colour(prepared, tmp_path):
    image = np.full((288, 352), 77, np.uint8)
    shutil.copy(frames_of(prepared[0])[0], tmp_path / "0004_ir.png")
    cv2.imwrite(str(tmp_path / "0004_texture.png"), image)
    assert model(prepared, tmp_path, tmp_path / "out") == 0
    found, _ = read_ply((tmp_path / "out" / "points.ply").read_bytes())
    assert len(found["x"]) > 30
    assert set(found["frame"]) == {4} and set(found["green"]) == {77}


@pytest.mark.parametrize("grey, note", [(0, "all black"), (255, "all white"), (9, "no spot")])
def test_frames_without_spots_are_reported(grey, note, prepared, tmp_path, capsys):
    folder = tmp_path / "in"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), np.full((288, 352), grey, np.uint8))
    cv2.imwrite(str(folder / "1.png"), np.full((288, 352), grey, np.uint8))
    assert cli.main(["run", folder, "--calibration", prepared[1], "--engine", "model", "-o",
                     tmp_path / "out"]) == 3
    assert "! no frame has an ok point, so nothing here is to be used" in capsys.readouterr().out
    assert note in (tmp_path / "out" / "summary.txt").read_text()
    assert not [row for row in table(tmp_path / "out") if row["status"] == "ok"]
    assert "element vertex 0" in (tmp_path / "out" / "points.ply").read_text()
    assert (tmp_path / "out" / "point_cloud.png").exists()


@pytest.mark.parametrize("fields, beams, words", [
    ({}, [1, 2], ()), ({}, [3, 1, 3, 0, 0], ("more than one spot for beams 0, 3",)),
    ({"flags": 1 << Flag.LEARNING, "spots": 0}, [], ("learning: no level yet", "no spot")),
    ({"flags": 1 << Flag.BROKEN, "skipped": 2}, [1],
     ("broken: synchronism lost", "2 frames lost before it")),
    ({"spots": 5, "dropped": 3, "ok": 1, "rejected": 1}, [1],
     ("3 spots dropped: buffer full", "1 rejected spot without a row")),
    ({"lost": 1}, [1], ("1 packet lost on the link",)),
    ({"verified": False}, [1],
     ("its check fails: other tables in the chip, or a fault in its depth unit",)),
    ({"spots": 7}, [1], ("its counts do not add up",)),
    ({"bad_sync": 1, "overrun": 2}, [1], ("camera: 1 bad sync, 2 overruns so far",))])
def test_nothing_is_silent(fields, beams, words):
    points = np.zeros(len(beams), POINT)
    points["beam"] = beams
    frame = Frame(0, **{"spots": len(beams), "ok": len(beams), **fields})
    assert measure.frame_notes(np.full((2, 2), 9, np.uint8), frame, points) == words


def test_more_spots_than_any_queue_holds(prepared, tmp_path):
    image = np.zeros((288, 352), np.uint8)
    for row in range(4, 284, 8):
        for column in range(4, 348, 8):
            image[row:row + 4, column:column + 4] = 200
    cv2.imwrite(str(tmp_path / "0.png"), image)
    assert model(prepared, tmp_path, tmp_path / "out", "--noise", "20") == 0
    assert str(35 * 43) in (tmp_path / "out" / "summary.txt").read_text()


def image_file(path, kind):
    """An image that cannot be measured."""
    good = np.full((288, 352), 20, np.uint8)
    if kind == "empty":
        path.touch()
    elif kind == "text":
        path.write_text("this is not an image")
    elif kind == "truncated":
        noise = np.random.default_rng(1).integers(0, 256, good.shape, np.uint8)
        data = cv2.imencode(".png", noise)[1].tobytes()
        path.write_bytes(data[:len(data) // 2])
    elif kind == "colour":
        colour = cv2.merge([good, good, good // 2])
        cv2.imwrite(str(path), colour)
    elif kind == "16 bits":
        cv2.imwrite(str(path), good.astype(np.uint16) * 257)
    elif kind == "size":
        cv2.imwrite(str(path), good[:240, :320])
    elif kind == "folder":
        path.mkdir()


def refused(capsys, tmp_path, out, status):
    """The one sentence that a refused run leaves, and nothing else."""
    said = capsys.readouterr().err
    assert status == 2
    assert said.startswith("cyclope: ") and said.endswith(".\n") and said.count("\n") == 1, said
    assert "Traceback" not in said
    assert not list(tmp_path.rglob("*.part")), "something half-written was left"
    assert not Path(out).is_dir() or not (Path(out) / "points.csv").exists()
    return said


@pytest.mark.parametrize("kind", ["empty", "text", "truncated", "colour", "16 bits", "size",
                                  "folder"])
@pytest.mark.parametrize("place", ["alone", "middle"])
def test_bad_images_are_refused_by_name(kind, place, prepared, tmp_path, capsys):
    folder = tmp_path / "in"
    folder.mkdir()
    image_file(folder / "0001.png", kind)
    if place == "middle":
        for name in ("0000.png", "0002.png"):
            shutil.copy(frames_of(prepared[0])[0], folder / name)
    out = tmp_path / "out"
    said = refused(capsys, tmp_path, out, model(prepared, folder, out))
    assert "0001.png" in said and not out.exists()


@pytest.mark.parametrize("target, words", [
    ("nowhere.png", "does not exist"), ("nowhere", "does not exist"), ("hollow", "no image")])
def test_missing_frames_are_refused(target, words, prepared, tmp_path, capsys):
    (tmp_path / "hollow").mkdir()
    out = tmp_path / "out"
    assert words in refused(capsys, tmp_path, out, model(prepared, tmp_path / target, out))
    assert not out.exists()


def test_folder_among_files_is_refused(prepared, tmp_path, capsys):
    targets = [frames_of(prepared[0])[0], prepared[0]]
    out = tmp_path / "out"
    assert "is a folder" in refused(capsys, tmp_path, out, model(prepared, targets, out))


@pytest.mark.parametrize("kind", ["missing", "empty", "bit", "version", "text", "folder"])
def test_bad_calibrations_are_refused(kind, prepared, tmp_path, capsys):
    path = tmp_path / "calibration.json"
    data = bytearray(prepared[1].read_bytes())
    if kind == "bit":
        data[len(data) // 2] ^= 1
    elif kind == "version":
        content = json.loads(data)
        content["version"] = 99
        data = json.dumps(content).encode()
    elif kind == "text":
        data = b"{}"
    elif kind == "empty":
        data = b""
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes(data)
    out = tmp_path / "out"
    status = cli.main(["run", prepared[0], "--calibration", path, "--engine", "model", "-o", out])
    assert "calibration.json" in refused(capsys, tmp_path, out, status)
    assert not out.exists()


def test_filled_output_is_refused_and_left_alone(prepared, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    said = refused(capsys, tmp_path, out, model(prepared, prepared[0], out))
    assert "already" in said and [path.name for path in out.iterdir()] == ["mine.txt"]


def test_empty_output_folder_is_taken(prepared, tmp_path):
    (tmp_path / "out").mkdir()
    assert model(prepared, frames_of(prepared[0])[0], tmp_path / "out") == 0
    assert (tmp_path / "out" / "points.csv").exists()


@pytest.mark.parametrize("out", ["file", "file/below", "/proc/cyclope/out"])
def test_output_that_cannot_be_written_is_refused(out, prepared, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    out = tmp_path / out
    refused(capsys, tmp_path, out, model(prepared, prepared[0], out))
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("options", [
    ["--noise", "64"], ["--noise", "x"], ["--level", "30"], ["--engine", "best"]])
def test_bad_options_are_refused(options, prepared, tmp_path, capsys):
    out = tmp_path / "out"
    said = refused(capsys, tmp_path, out, model(prepared, prepared[0], out, *options))
    assert options[0] in said and not out.exists()


def test_broken_truth_is_refused(prepared, tmp_path, capsys):
    (tmp_path / "in" / "frames").mkdir(parents=True)
    shutil.copy(frames_of(prepared[0])[0], tmp_path / "in" / "frames" / "0000_ir.png")
    (tmp_path / "in" / "truth.csv").write_text("frame,beam\n1,2\n")
    out = tmp_path / "out"
    assert "truth.csv" in refused(capsys, tmp_path, out, model(prepared, tmp_path / "in", out))


@pytest.mark.parametrize("error, status, words", [
    (KeyboardInterrupt(), 130, "interrupted."), (UserError("The disk is full."), 2, "disk is full"),
    (OSError(errno.EIO, "Input/output error", "x"), 2, "x: Input/output error."),
    (ZeroDivisionError("x"), 1, "a fault of the program (ZeroDivisionError: x)")],
    ids=["interrupt", "sentence", "system", "fault"])
def test_what_was_measured_stays(error, status, words, prepared, measured, tmp_path, capsys,
                                 monkeypatch):
    """At the third frame something fails: all that was measured is on the disk by its name."""
    out, count = tmp_path / "out", 0
    draw = overlay.draw_frame

    def failing(*arguments):
        nonlocal count
        count += 1
        rows = table(out)
        assert {row["frame"] for row in rows} == {str(number) for number in range(count)}
        if count == 3:
            raise error
        return draw(*arguments)

    monkeypatch.setattr(measurement, "draw_frame", failing)
    assert cli.main(["run", prepared[0], "--calibration", prepared[1], "--engine", "model", "-o",
                     out]) == status
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1
    assert message.endswith(f"The points of 3 of {len(frames_of(prepared[0]))} frames are in "
                            f"{out / 'points.csv'}.\n")
    assert table(out) == [row for row in table(measured) if int(row["frame"]) < 3]
    assert sorted(path.name for path in out.iterdir()) == ["frames", "points.csv"]
    assert {path.name for path in (out / "frames").iterdir()} == {"0000.png", "0001.png"}


def test_a_failure_at_the_end_keeps_the_points(prepared, measured, tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(measurement, "print_report", interrupted)
    assert model(prepared, prepared[0], tmp_path / "out") == 130
    assert "interrupted. The points of 12 of 12 frames are in" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["points.csv"]
    assert table(tmp_path / "out") == table(measured)


@pytest.mark.parametrize("there", [False, True])
def test_an_interrupt_before_the_first_frame_leaves_nothing(there, prepared, tmp_path, capsys,
                                                            monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(measure, "measure", interrupted)
    out = tmp_path / "out"
    if there:
        out.mkdir()
    assert model(prepared, prepared[0], out) == 130
    assert capsys.readouterr().err == "cyclope: interrupted. Nothing was written.\n"
    assert out.exists() == there and not list(tmp_path.rglob("*.*"))


def test_a_disk_that_fills_up_is_named(prepared, tmp_path, capsys):
    """The second frame's points do not fit any more: the file ends with a whole row."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))
    try:
        assert model(prepared, prepared[0], tmp_path / "out") == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    message = capsys.readouterr().err
    assert "points.csv cannot be written: File too large. The points of 1 of 12 frames" in message
    text = (tmp_path / "out" / "points.csv").read_text()
    assert len(text) > 3900 and text.endswith("\n")
    assert all(line.count(",") == 10 for line in text.splitlines())


def test_without_compiler_the_other_engine_is_named(prepared, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(native, "BUILD", tmp_path / "native")
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    status = cli.main(["run", prepared[0], "--calibration", prepared[1], "-o", out])
    said = refused(capsys, tmp_path, out, status)
    assert "C++" in said and "--engine model" in said


def test_what_makes_a_library_is_in_its_key(tmp_path, monkeypatch):
    """One is made once, and anew when what makes it has changed."""
    maker = tmp_path / "maker.py"
    assert Path(native.__file__) in native._MAKERS
    monkeypatch.setattr(native, "BUILD", tmp_path / "native")
    monkeypatch.setattr(native, "_MAKERS", (maker,))
    made = []

    def make(folder):
        made.append(folder / "part")
        made[-1].touch()
        return made[-1]

    paths = []
    for text in ("one", "one", "two", "one"):
        maker.write_text(text)
        paths.append(native._made("block", ("key",), "libblock.so", make))
    assert paths[0] == paths[1] == paths[3] != paths[2] and len(made) == 2


@pytest.mark.parametrize("options", [[], ["--independent"], ["--noise", "4"]],
                         ids=lambda options: "".join(options) or "learnt")
def test_engines_give_the_same_bytes(options, prepared, tmp_path):
    for kind in ("rtl", "model"):
        assert cli.main(["run", prepared[0], "--calibration", prepared[1], "--engine", kind,
                         "--no-pictures", "-o", tmp_path / kind, *options]) == 0
    assert len(table(tmp_path / "rtl")) > 500
    for name in ("points.csv", "points.ply", "summary.txt"):
        one, other = ((tmp_path / kind / name).read_text() for kind in ("rtl", "model"))
        assert one == other


def test_what_the_chip_has_no_room_for_is_counted(prepared, tmp_path, capsys):
    dotted = cv2.imread(str(frames_of(prepared[0])[0]), cv2.IMREAD_UNCHANGED)
    dotted[::9, ::3] = np.maximum(dotted[::9, ::3], 150)  # too small for spots
    cv2.imwrite(str(tmp_path / "0.png"), dotted)
    for kind in ("rtl", "model"):
        assert cli.main(["run", tmp_path / "0.png", "--calibration", prepared[1], "--engine", kind,
                         "--no-pictures", "--noise", "6", "-o", tmp_path / kind]) == 0
        if kind == "rtl":
            said = capsys.readouterr().out
    some, all_of_them = (
        set((tmp_path / kind / "points.csv").read_text().splitlines()) for kind in ("rtl", "model"))
    assert some < all_of_them
    lost = len(all_of_them) - len(some)
    assert f"! frame 0: {lost} rejected spots without a row" in said


def test_demo_again_keeps_what_is_there(prepared, capsys):
    before = prepared[1].stat().st_mtime_ns
    assert demo.main(CACHE) == 0
    said = capsys.readouterr().out
    assert "there already" in said and "mean error" in said and "point_cloud.png" in said
    assert prepared[1].stat().st_mtime_ns == before
    for name, _ in demo.OUTPUTS:
        assert (CACHE / name).exists()
    summary = json.loads((CACHE / "result" / "summary.json").read_text())
    assert demo_figures.sentence(summary) in said
    readme = (ROOT / "README.md").read_text()
    assert readme.count("<!-- demo: figures -->\n") == 1
    assert demo_figures.updated(readme, summary) == readme, (
        "README.md quotes other figures than `make demo` prints: `python -m scripts.demo --readme`")
