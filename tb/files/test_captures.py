"""Capture folders with hostile descriptions and tables."""

import pytest

TOML = """[sensor]
width = 352
height = 288
focal_px = 360.0
[projector]
rows = 7
columns = 7
pitch_deg = 6.3
rotation_deg = 8.5
toe_in_deg = 2.5
base_mm = [5.0, 0.1, 0.1]
[lens]
board_columns = 9
board_rows = 6
square_mm = 4.0
"""
PLANES = "file,z_mm\n0.png,80.5\n1.png,90\n"


@pytest.fixture
def capture(tmp_path):
    """A capture that is good up to its first photograph, which is empty."""
    folder = tmp_path / "capture"
    (folder / "lens").mkdir(parents=True)
    (folder / "planes").mkdir()
    (folder / "capture.toml").write_text(TOML)
    (folder / "planes" / "planes.csv").write_text(PLANES)
    for name in ("lens/0.png", "planes/0.png", "planes/1.png"):
        (folder / name).touch()
    return folder


def calibrate(capture, tmp_path):
    """The words of a calibration."""
    return "calibrate", capture, "-o", tmp_path / "out"


#: A line of the description and what is there instead, and words of the sentence.
VALUES = {
    "width negative": ("width = 352", "width = -1", "width in [sensor] must be an integer from 8"),
    "width huge": ("width = 352", "width = 99999999999", "width in [sensor] must be"),
    "width float": ("width = 352", "width = 352.0", "width in [sensor] must be an integer"),
    "width of 5000 digits": ("width = 352", "width = " + "9" * 5000, "is not valid TOML"),
    "width list": ("width = 352", "width = [" + "352," * 999 + "]", "must be an integer from 8"),
    "focal nan": ("focal_px = 360.0", "focal_px = nan", "focal_px in [sensor] must be a number"),
    "focal inf": ("focal_px = 360.0", "focal_px = inf", "focal_px in [sensor] must be a number"),
    "focal huge": ("focal_px = 360.0", "focal_px = 1e300", "focal_px in [sensor] must be"),
    "focal of 400 digits": ("focal_px = 360.0", "focal_px = 1" + "0" * 400, "focal_px in [sensor]"),
    "focal date": ("focal_px = 360.0", "focal_px = 2020-01-01", "focal_px in [sensor] must be"),
    "pitch 90": ("pitch_deg = 6.3", "pitch_deg = 90", "must be an angle between 0 and 45 degrees"),
    "base nan": ("[5.0, 0.1, 0.1]", "[5.0, nan, 0.1]", "must be three numbers [x, y, z]"),
    "base huge": ("[5.0, 0.1, 0.1]", "[1e200, 0, 0]", "must be three numbers [x, y, z]"),
    "base nested": ("[5.0, 0.1, 0.1]", "[[5.0], 0, 0]", "must be three numbers [x, y, z]"),
    "beams": ("rows = 7", "rows = 128", "128 x 7 beams are more than 512"),
    "board": ("board_columns = 9", "board_columns = 100000", "board_columns in [lens] must be"),
    "square": ("square_mm = 4.0", "square_mm = 0", "square_mm in [lens] must be a number of mm"),
    "key twice": ("rows = 7", "rows = 7\nrows = 6", "is not valid TOML"),
    "section twice": ("[lens]", "[sensor]", "is not valid TOML"),
    "section of text": ("[sensor]", "sensor = 'a'\n[other]", "has no section [sensor]"),
    "section list": ("[sensor]", "[[sensor]]", "has no section [sensor]"),
    "deep": ("rows = 7", "rows = " + "[" * 5000, "is nested too deeply"),
    "deep tables": ("rows = 7", "rows = " + "{a = " * 2500, "is nested too deeply"),
    "control character": ("rows = 7", "rows = 7 # \x01", "is not valid TOML"),
    "long": ("rows = 7", "rows = 7 #" + "-" * 20_000, "octets, more than the 16384 that are read"),
}


@pytest.mark.parametrize("kind", VALUES)
def test_hostile_descriptions_are_refused(kind, capture, tmp_path, refused):
    old, new, words = VALUES[kind]
    assert old in TOML
    (capture / "capture.toml").write_text(TOML.replace(old, new))
    message = refused(*calibrate(capture, tmp_path))
    assert f"{capture / 'capture.toml'}" in message and words in message


@pytest.mark.parametrize("octets, words", [
    (b"", "has no section [sensor]"), (b"\xff\xfe\x00", "is not valid TOML"),
    (bytes(1000), "is not valid TOML"), (b"{}", "is not valid TOML")])
def test_other_descriptions_are_refused(octets, words, capture, tmp_path, refused):
    (capture / "capture.toml").write_bytes(octets)
    assert words in refused(*calibrate(capture, tmp_path))


#: Octets of planes.csv, and words of the sentence.
TABLES = {
    "decimal comma": (b"file,z_mm\n0.png,80,5\n", "line 2: it has 3 cells where the first line "
                      "has 2, or is ',' the decimal sign? Then separate the columns by ';'"),
    "decimal comma once": (b"file,z_mm\n0.png,80\n1.png,90,5\n", "line 3: it has 3 cells"),
    "missing cell": (b"file,z_mm\n0.png\n", "line 2: it has 1 cell where the first line has 2"),
    "nan": (b"file,z_mm\n0.png,nan\n", "line 2: z_mm must be the distance in mm, above 0 and up"),
    "inf": (b"file,z_mm\n0.png,inf\n", "line 2: z_mm must be the distance in mm"),
    "negative": (b"file,z_mm\n0.png,-80\n", "line 2: z_mm must be the distance in mm"),
    "zero": (b"file,z_mm\n0.png,0\n", "line 2: z_mm must be the distance in mm"),
    "huge": (b"file,z_mm\n0.png,1e300\n", "line 2: z_mm must be the distance in mm"),
    "unit": (b"file,z_mm\n0.png,80 mm\n", "line 2: z_mm must be the distance in mm, above 0 and"),
    "twice": (b"file,z_mm\n0.png,80\n0.png,90\n", "names 0.png twice, in lines 2 and 3"),
    "elsewhere": (b"file,z_mm\n../lens/0.png,80\n", "is not the name of a file beside it"),
    "absolute": (b"file,z_mm\n/etc/passwd,80\n", "is not the name of a file beside it"),
    "no such file": (b"file,z_mm\n7.png,80\n", "7.png does not exist"),
    "zero character": (b"file,z_mm\n0\0.png,80\n", "does not exist"),
    "line feed": (b'file,z_mm\n"0\n.png",80\n', "line 2: "),
    "empty": (b"", "must have the columns file,z_mm in its first line"),
    "no rows": (b"file,z_mm\n# 0.png,80\n", "names no plane frames"),
    "no header": (b"0.png,80\n", "must have the columns file,z_mm in its first line"),
    "two columns": (b"file,z_mm,z_mm\n0.png,80,90\n", "has two columns z_mm"),
    "latin-1": (b"file,z_mm\n\xfc.png,80\n", "is not a text in UTF-8 or UTF-16"),
    "binary": (bytes(range(256)), "is not a text in UTF-8 or UTF-16"),
    "open quote": (b'file,z_mm\n"0.png,80\n', "is not a table ("),
    "long cell": (b"file,z_mm\n" + b"0" * 900_000, "is not a table ("),
    "large": (b"file,z_mm\n" + b"\n" * 1_100_000, "octets, more than the 1048576 that are read"),
}


@pytest.mark.parametrize("kind", TABLES)
def test_hostile_tables_of_planes_are_refused(kind, capture, tmp_path, refused):
    octets, words = TABLES[kind]
    (capture / "planes" / "planes.csv").write_bytes(octets)
    message = refused(*calibrate(capture, tmp_path))
    assert f"{capture / 'planes' / 'planes.csv'}" in message and words in message


@pytest.mark.parametrize("text, encoding", [
    (PLANES, "utf-8"), (PLANES.replace(",", ";").replace(".5", ",5"), "utf-8-sig"),
    (PLANES.replace(",", "\t").replace(".5", ",5"), "utf-16")])
def test_good_ones_get_as_far_as_the_photographs(text, encoding, capture, tmp_path, refused):
    (capture / "planes" / "planes.csv").write_text(text, encoding)
    assert "lens/0.png is empty" in refused(*calibrate(capture, tmp_path))


def test_what_is_not_used_is_named(capture):
    """Other files, and values that nobody reads, get a note; photographs may be TIFF."""
    from calibration.capture import read_capture
    for name in ("lens/1.tif", "lens/2.raw", "lens/.3", "planes/7.png", "planes/note.txt"):
        (capture / name).touch()
    (capture / "capture.toml").write_text(TOML.replace("[lens]", "gain = 2\n[lens]")
                                          + "[camera]\nname = 'x'\n")
    found = read_capture(capture)
    assert [path.name for path in found.lens_paths] == ["0.png", "1.tif"]
    assert found.notes == (
        f"{capture / 'capture.toml'} has values that are not used: camera, gain in [projector]",
        f"not used in {capture / 'lens'}: 2.raw",
        f"not used in {capture / 'planes'}: 7.png, note.txt")
