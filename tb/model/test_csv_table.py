"""Tables from spreadsheets and programs: read for certain, or refused with the line."""

import codecs

import pytest

from calibration.csv_table import read_table
from model.errors import UserError

ROWS = [("a.png", 80.5), ("b.png", 1234.0)]


def read(path):
    """Names and distances of a table."""
    return [(row.text("file"), row.number("z_mm", 0, 1e5, "a distance"))
            for row in read_table(path, ("file", "z_mm"), "write one")]


def written(path, text, encoding="utf-8", mark=b""):
    """The table's path, after it was written."""
    path.write_bytes(mark + text.encode(encoding))
    return path


PLAIN = "file,z_mm\na.png,80.5\nb.png,1234\n"
GOOD = {
    "plain": PLAIN,
    "no last line end": PLAIN.rstrip(),
    "carriage returns": PLAIN.replace("\n", "\r\n"),
    "old carriage returns": PLAIN.replace("\n", "\r"),
    "semicolons and decimal commas": "file;z_mm\na.png;80,5\nb.png;1234\n",
    "semicolons and decimal points": "file;z_mm\na.png;80.5\nb.png;1234.\n",
    "tabs and decimal commas": "file\tz_mm\na.png\t80,5\nb.png\t1234,0\n",
    "a spreadsheet's first line": "sep=;\nfile;z_mm\na.png;80,5\nb.png;1234\n",
    "capitals and blanks": " File , Z  mm \n a.png , 80.5 \nb.png,  1234\n",
    "comments": "# distances\nfile,z_mm\n  # one\na.png,80.5\n#,,\nb.png,1234\n# end",
    "blank lines": "\n\nfile,z_mm\n\na.png,80.5\n,\n\nb.png,1234\n,\n",
    "another column": "note,z_mm,file\n\"far, far\",80.5,a.png\n,1234,b.png\n",
    "columns without a name": "file,z_mm,,\na.png,80.5,,\nb.png,1234,,\n",
    "quotes": '"file";"z_mm"\n"a.png";"80,5"\n"b.png";"1234"\n',
    "exponents and signs": "file,z_mm\na.png,+8.05e1\nb.png,12.34E+02\n",
}


@pytest.mark.parametrize("kind", GOOD)
def test_tables_are_read(kind, tmp_path):
    assert read(written(tmp_path / "t.csv", GOOD[kind])) == ROWS


@pytest.mark.parametrize("encoding, mark", [
    ("utf-8", codecs.BOM_UTF8), ("utf-16-le", codecs.BOM_UTF16_LE), ("utf-16-le", b""),
    ("utf-16-be", codecs.BOM_UTF16_BE), ("utf-16-be", b""), ("utf-32-le", codecs.BOM_UTF32_LE)])
def test_encodings_are_recognised(encoding, mark, tmp_path):
    assert read(written(tmp_path / "t.csv", PLAIN, encoding, mark)) == ROWS
    text = PLAIN.replace("a.png", "größe.png")
    assert read(written(tmp_path / "t.csv", text, encoding, mark))[0] == ("größe.png", 80.5)


BAD = {
    "decimal comma": ("file,z_mm\na.png,80,5\n", "line 2: it has 3 cells where the first line has "
                      "2, or is ',' the decimal sign? Then separate the columns by ';'."),
    "decimal comma later": ("file,z_mm\n#\na.png,80\n\nb.png,80,5\n", "line 5: it has 3 cells"),
    "quoted decimal comma": ('file,z_mm\na.png,"80,5"\n', "line 2: z_mm must be a distance, not "
                             "'80,5'."),
    "missing cell": ("file,z_mm\na.png\n", "line 2: it has 1 cell where the first line has 2."),
    "extra cell": ("file;z_mm\na.png;80;far\n", "line 2: it has 3 cells where the first line has"),
    "cell without a column": ("file,z_mm,\na.png,80,far\n", "line 2: it has a cell in a column "
                              "without a name."),
    "two decimal signs": ("file;z_mm\na.png;80,5\nb.png;80\nc.png;80.5\n", "line 4: '80.5' has "
                          "another decimal sign than line 2: use one of '.' and ','."),
    "thousands": ("file;z_mm\na.png;1.234,5\n", "line 2: z_mm must be a distance, not '1.234,5'."),
    "two columns": ("file,z_mm,Z_MM\na.png,80,81\n", "has two columns z_mm: leave one of them out"),
    "no header": ("a.png,80\n", "must have the columns file,z_mm in its first line."),
    "empty": ("", "must have the columns file,z_mm in its first line."),
    "only comments": ("# file,z_mm\n", "must have the columns"),
    "nan": ("file,z_mm\na.png,nan\n", "line 2: z_mm must be a distance, not 'nan'."),
    "inf": ("file,z_mm\na.png,inf\n", "line 2: z_mm must be"),
    "negative": ("file,z_mm\na.png,-80\n", "line 2: z_mm must be"),
    "huge": ("file,z_mm\na.png,1e999\n", "line 2: z_mm must be"),
    "underscore": ("file,z_mm\na.png,8_0\n", "line 2: z_mm must be"),
    "other digits": ("file,z_mm\na.png,٨٠\n", "line 2: z_mm must be"),
    "hexadecimal": ("file,z_mm\na.png,0x80\n", "line 2: z_mm must be"),
    "unit": ("file,z_mm\na.png,80 mm\n", "line 2: z_mm must be a distance, not '80 mm'."),
    "no number": ("file,z_mm\na.png,\n", "line 2: z_mm must be a distance, not ''."),
    "open quote": ('file,z_mm\n"a.png,80\n', "is not a table (unexpected end of data)"),
    "quote in a cell": ('file,z_mm\n"a".png,80\n', "is not a table ("),
    "endless cell": ("file,z_mm\n" + "a" * 200_000, "is not a table (field larger"),
    "long number": ("file,z_mm\na.png," + "9" * 5000, "line 2: z_mm must be"),
}


@pytest.mark.parametrize("kind", BAD)
def test_tables_are_refused_by_line(kind, tmp_path):
    text, words = BAD[kind]
    path = written(tmp_path / "t.csv", text)
    with pytest.raises(UserError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and words in message
    assert message.endswith(".") and "\n" not in message and len(message) < 300


@pytest.mark.parametrize("data", [
    b"file,z_mm\n\xfc.png,80\n", codecs.BOM_UTF16_LE + b"f", b"\0\xd8\0\xd8", bytes(range(256))])
def test_other_encodings_are_refused(data, tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(data)
    with pytest.raises(UserError, match="is not a text in UTF-8 or UTF-16|must have the columns"):
        read(path)


def test_whole_numbers_and_empty_cells(tmp_path):
    path = written(tmp_path / "t.csv", "frame,z_mm\n7,\n7.0,1\n")
    rows = list(read_table(path, ("frame", "z_mm"), "write one"))
    assert rows[0].number("frame", 0, 9, "a frame", whole=True) == 7
    assert rows[0].number("z_mm", 0, 9, "a distance", empty=-1) == -1
    with pytest.raises(UserError, match="line 3: frame must be a frame, not '7.0'"):
        rows[1].number("frame", 0, 9, "a frame", whole=True)


def test_large_tables_are_refused(tmp_path):
    path = written(tmp_path / "t.csv", PLAIN)
    with pytest.raises(UserError, match=f"has {len(PLAIN)} octets, more than the 9 that are read"):
        list(read_table(path, ("file", "z_mm"), "write one", most=9))
