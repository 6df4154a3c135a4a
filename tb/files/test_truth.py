"""Tables of truth and of points that are damaged or forged."""

import numpy as np
import pytest

from model.errors import UserError
from scripts.results.accuracy import load_points, load_truth

HEADER = "frame,beam,u_px,v_px,x_mm,y_mm,z_mm,inside\n"
ROW = "0,1,10.5,20.5,1,2,80,1\n"
BAD = {
    "decimal comma": ("0,1,10,5,20,5,1,2,80,1\n", "line 2: it has 10 cells where"),
    "missing cells": ("0,1,10\n", "line 2: it has 3 cells where the first line has 8"),
    "frame text": (ROW.replace("0,1,", "a,1,"), "line 2: frame must be the number of a frame"),
    "frame negative": ("-" + ROW, "line 2: frame must be the number of a frame, not '-0'"),
    "frame huge": ("9" * 30 + ROW, "line 2: frame must be the number of a frame"),
    "beam huge": (ROW.replace("0,1,", "0,40000,"), "line 2: beam must be the number of a beam"),
    "beam float": (ROW.replace("0,1,", "0,1.0,"), "line 2: beam must be the number of a beam"),
    "nan": (ROW.replace("80", "nan"), "line 2: z_mm must be a distance above 0 or nothing"),
    "zero": (ROW.replace("80", "0"), "line 2: z_mm must be a distance above 0 or nothing"),
    "negative": (ROW.replace("80", "-80"), "line 2: z_mm must be a distance above 0 or nothing"),
    "inf": (ROW.replace("10.5", "inf"), "line 2: u_px must be a number or nothing, not 'inf'"),
    "huge": (ROW.replace("10.5", "1e300"), "line 2: u_px must be a number or nothing"),
    "inside": (ROW.replace(",1\n", ",perhaps\n"), "line 2: inside must be 1 or 0, not 'perhaps'"),
    "twice": (ROW + "# and\n" + ROW, "line 4: frame 0 has beam 1 in line 2 already"),
}


@pytest.mark.parametrize("kind", BAD)
def test_truth_is_refused_by_line(kind, tmp_path):
    text, words = BAD[kind]
    path = tmp_path / "truth.csv"
    path.write_text(HEADER + text.replace("-0", "-0"))
    if kind == "frame negative":
        path.write_text(HEADER + "-1" + ROW[1:])
        words = words.replace("'-0'", "'-1'")
    with pytest.raises(UserError) as caught:
        load_truth(path)
    assert str(caught.value).startswith(f"{path}, {words}")


def test_truth_from_a_spreadsheet(tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text(HEADER.replace(",", ";") + "0;1;10,5;20,5;1;2;80;TRUE\n7;2;;;;;;0\n", "utf-16")
    truth = load_truth(path)
    assert truth["frame"].tolist() == [0, 7] and truth["beam"].tolist() == [1, 2]
    assert truth["u"][0] == 10.5 and np.isnan(truth["z"][1])
    assert truth["inside"].tolist() == [True, False]


def test_points_of_other_statuses_are_passed_over(tmp_path):
    path = tmp_path / "points.csv"
    header = "frame,beam,u_px,v_px,area_px,x_mm,y_mm,z_mm,status,more\n"
    path.write_text(header + "3,4,1,2,9,1,2,80,ok,\n3,,1,2,9,,,,noise,x\n3,,1,2,9,,,,unverified,\n")
    points = load_points(path)
    assert points["beam"].tolist() == [4, -1] and points["status"].tolist() == [0, 1]
    assert points["z"][0] == 80 and np.isnan(points["z"][1])
    path.write_text(header + "3,4,1,2,1900,1,2,80,ok,\n")
    with pytest.raises(UserError, match="line 2: area_px must be a number of pixels, not '1900'"):
        load_points(path)
