"""The report of a recording: one file that needs nothing else, the same each time."""

import base64
import re

import cv2
import numpy as np
import pytest

from model.optics.scenes import Plane
from scripts.cyclope import cli
from scripts.view.measurements import Measurements
from scripts.view.report import write_report
from tb.view.bench import history_of


@pytest.fixture(scope="module")
def history():
    return history_of([Plane(50 + step, 10, 0) for step in range(12)])[1]


def test_figures_measurements_and_pictures(history):
    measured = Measurements(history)
    found = measured.measure(3, "ruler", [[120, 90], [200, 160]])
    measured.measure(3, "polyp", [[150, 120], [190, 120], [190, 160], [150, 160]])
    text = write_report(history, "colon <3>/link.raw", measured.plain()).decode()
    assert text == write_report(history, "colon <3>/link.raw", measured.plain()).decode()
    assert "<title>colon &lt;3&gt;/link.raw</title>" in text and "<3>" not in text
    assert "12, numbered 10 to 32" in text and "25.0 pairs/s" in text
    assert f"<td>{found['length_mm']:.2f}</td>" in text and "Not a medical device" in text
    # Nothing is asked of anybody.
    assert not re.search(r"(src|href)=\"(?!data:)|url\(|https?:", text)
    pictures = [cv2.imdecode(np.frombuffer(base64.b64decode(each), np.uint8), cv2.IMREAD_COLOR)
                for each in re.findall(r"base64,([^\"]+)", text)]
    captions = re.findall(r"<figcaption>frame (\d+), ([\d.]+) s", text)
    assert len(pictures) == 2 * len(captions) and ("16", "0.12") in captions
    assert all(each.shape == (576, 704, 3) for each in pictures)
    marked = pictures[2 * captions.index(("16", "0.12"))]
    assert (marked == (62, 210, 255)).all(axis=2).sum() > 200
    surface = pictures[1]
    white = (surface == 255).all(axis=2)
    assert 0.3 < 1 - white.mean() < 0.9
    # Nearer is brighter.
    far = pictures[-1]
    both = ~white & ~(far == 255).all(axis=2)
    assert surface[both].mean() > far[both].mean() + 10


def test_nothing_measured(history):
    assert "Nothing was measured." in write_report(history, "x", []).decode()


def test_bad_input_is_one_sentence(tmp_path, capsys):
    (tmp_path / "raw").write_bytes(b"nothing")
    for recording, sentence in (("none", "does not exist"), ("raw", "does not exist")):
        assert cli.main(["report", str(tmp_path / recording), "--calibration",
                         str(tmp_path / "none.json"), "-o", str(tmp_path / "out.html")]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and sentence in error
    assert not (tmp_path / "out.html").exists()
