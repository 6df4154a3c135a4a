"""Tables of text as spreadsheets and programs write them.

Columns are separated by a comma, a semicolon or a tab, whichever the first line uses; with the
latter two a number may have a comma as its decimal sign. UTF-8 and UTF-16, with or without a byte
order mark; capitals and blanks in the names of columns do not matter. Blank lines and lines that
begin with ``#`` are passed over. Whatever else cannot be read for certain is refused with its line.
"""

import codecs
import csv
import io
import re

from calibration.files import read_octets
from model.errors import UserError

__all__ = ["Row", "read_table"]

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d{1,3})?", re.ASCII | re.IGNORECASE)
_INTEGER = re.compile(r"[+-]?\d{1,15}", re.ASCII)
_MARKS = ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
          (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"),
          (codecs.BOM_UTF16_BE, "utf-16"))


class _Table:
    """What the rows of a table have in common."""

    def __init__(self, path, separator, columns):
        self.path, self.separator, self.columns = path, separator, columns
        self.decimal = None  # the sign, and the line where it was met first


class Row:
    """A line of a table, whose cells are taken by the names of their columns.

    Parameters
    ----------
    table : table
        Path, separator and the position of each column.
    line : :class:`int`
        Its number in the file, from 1.
    cells : list of :class:`str`
        Their text, without blanks around it.
    """

    def __init__(self, table, line, cells):
        self._table, self.line, self._cells = table, line, cells

    def refuse(self, words):
        """Raise :class:`UserError` that names file and line."""
        raise UserError(f"{self._table.path}, line {self.line}: {words}.")

    def text(self, column):
        """The text of a cell."""
        return self._cells[self._table.columns[column]]

    def _number(self, text, whole):
        """A number as it stands there, or None."""
        if whole:
            return int(text) if _INTEGER.fullmatch(text) else None
        if not _NUMBER.fullmatch(text):
            return None
        for sign in ",.":
            if sign in text:
                if sign == "," and self._table.separator == ",":
                    return None
                before, line = self._table.decimal = self._table.decimal or (sign, self.line)
                if before != sign:
                    self.refuse(f"{text!r} has another decimal sign than line {line}: use one of "
                                "'.' and ','")
        return float(text.replace(",", "."))

    def number(self, column, low, high, must, whole=False, empty=None):
        """The number in a cell.

        Parameters
        ----------
        column : :class:`str`
            Name of the column.
        low, high : :class:`float`
            Limits, both allowed.
        must : :class:`str`
            What it has to be, for the message.
        whole : :class:`bool`
            Only integers.
        empty : object
            What an empty cell stands for; None refuses it.
        """
        text = self.text(column)
        if not text and empty is not None:
            return empty
        value = self._number(text, whole)
        if value is None or not low <= value <= high:
            self.refuse(f"{column} must be {must}, not {text[:40]!r}")
        return value


def _encoding(start):
    """The encoding of a text, from its first octets."""
    for mark, encoding in _MARKS:
        if start.startswith(mark):
            return encoding
    if start[1:2] == b"\0":
        return "utf-16-le"
    return "utf-16-be" if start[:1] == b"\0" else "utf-8"


def _without_comments(lines):
    """Comments become blank lines, so that lines can still be counted."""
    for line in lines:
        yield "\n" if line.lstrip().startswith("#") else line


def _names(line, separator):
    """The names of columns in a line, if its columns are separated so."""
    try:
        cells = next(csv.reader([line], delimiter=separator, strict=True), [])
    except csv.Error:  # quotes, and another separator behind them
        return []
    return [re.sub(r"\s+", "_", cell.strip().lower()) for cell in cells]


def _header(path, lines, wanted):
    """The table that the first line with something in it describes, the names of its columns, and
    the number of that line."""
    number, line = next(((number, line) for number, line in enumerate(lines, 1)
                         if line.strip() and not line.lower().startswith("sep=")), (0, ""))
    for separator in ",;\t":
        names = _names(line, separator)
        if set(wanted) <= set(names):
            break
    else:
        raise UserError(f"{path} must have the columns {','.join(wanted)} in its first line.")
    named = [name for name in names if name]
    for name in named:
        if named.count(name) > 1:
            raise UserError(f"{path} has two columns {name}: leave one of them out.")
    return _Table(path, separator, {name: names.index(name) for name in named}), names, number


def _rows(path, lines, wanted):
    lines = _without_comments(lines)
    table, names, above = _header(path, lines, wanted)
    reader = csv.reader(lines, delimiter=table.separator, strict=True)
    last = above
    for cells in reader:
        first, last = last + 1, above + reader.line_num
        cells = [cell.strip() for cell in cells]
        if not any(cells):
            continue
        row = Row(table, first, cells)
        if len(cells) != len(names):
            hint = ", or is ',' the decimal sign? Then separate the columns by ';'" if (
                table.separator == "," and len(cells) > len(names)) else ""
            row.refuse(f"it has {len(cells)} cell{'s' * (len(cells) != 1)} where the first line "
                       f"has {len(names)}{hint}")
        if any(cell and not name for cell, name in zip(cells, names, strict=True)):
            row.refuse("it has a cell in a column without a name")
        yield row


def read_table(path, columns, advice, most=1 << 20):
    """Yield the rows of a table, each a :class:`Row`, as they are read.

    Parameters
    ----------
    path : path
        The file.
    columns : sequence of :class:`str`
        Columns that it must have; more are passed over.
    advice : :class:`str`
        What to do if it cannot be opened, as the end of a sentence.
    most : :class:`int`
        Octets that it may have.

    Raises
    ------
    UserError
        If it is missing, unreadable or no such table; in a row with the line's number.
    """
    data = read_octets(path, advice, most)
    try:
        with io.TextIOWrapper(io.BytesIO(data), _encoding(data[:4]), newline="") as lines:
            yield from _rows(path, lines, columns)
    except UnicodeError:
        raise UserError(f"{path} is not a text in UTF-8 or UTF-16: save the table as CSV in "
                        "UTF-8.") from None
    except csv.Error as error:
        raise UserError(f"{path} is not a table ({error}): write the columns "
                        f"{','.join(columns)}.") from error
