"""A table as people save it, as text: columns by name, and why one of them cannot be used.

Separators are comma, semicolon, tab or blanks; numbers may have decimal commas where the comma does not separate.
Lines that begin with # or % are comments. A row of units below the heading, an index without a name and columns of
text are read over; who asks for such a column is told what it holds.
"""

import csv
import re
from collections.abc import Iterator

import numpy as np

from backend.identification.errors import DataFileError
from backend.identification.record import Signal

MAX_SAMPLES = 5_000_000
_HEADING = re.compile(r"^\s*(?P<name>[^\[\(]*?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?\s*$")
_MISSING = ("", "na", "nan", "n/a", "null", "none", "-")
_COMMENTS = ("#", "%")

Line = tuple[int, str]
Row = tuple[int, list[str]]


class Columns(dict[str, Signal]):
    """Numeric columns by name; ``units`` of those that carry one, ``reasons`` why another is not here.

    ``texts`` are the cells of columns that hold words.
    """

    def __init__(self, columns: dict[str, Signal] | None = None) -> None:
        super().__init__(columns or {})
        self.units: dict[str, str] = {}
        self.texts: dict[str, list[str]] = {}
        self.reasons: dict[str, str] = {}

    def column(self, name: str) -> Signal:
        """Return a column. Raises DataFileError saying why there is none of that name."""
        if name in self.reasons:
            raise DataFileError(self.reasons[name])
        if name not in self:
            raise DataFileError(
                f"there is no column '{name}'; the file has {', '.join(self) or 'no column of numbers'}"
            )
        return self[name]


def read_csv(text: str) -> Columns:
    """Columns of a table with one heading line; names may carry a unit, as in ``u [V]``. Raises DataFileError."""
    lines, comment = _lines(text)
    if not lines:
        raise DataFileError("the file holds no heading line with rows of numbers below it")
    separator = max(";\t,", key=lines[0][1].count)
    if separator not in lines[0][1]:
        separator = " "
    heading = _cells(lines[0][1], separator)
    if all(_number(cell, separator) is not None for cell in heading):
        named = _cells(comment, separator)
        if len(named) != len(heading) or any(_number(cell, separator) is not None for cell in named):
            raise DataFileError("the first line holds numbers: put the names of the columns there")
        heading, lines = named, [(0, ""), *lines]
    if len(lines) < 2:
        raise DataFileError("the file holds no heading line with rows of numbers below it")
    if len(lines) - 1 > MAX_SAMPLES:
        raise DataFileError(f"the file holds {len(lines) - 1} rows, at most {MAX_SAMPLES} are read: cut it")
    plain = _plain(lines[1:], separator)
    if plain is not None and plain.shape[1] == len(heading):
        return _named(heading, [], list(plain.T), [])
    rows = list(_rows(lines[1:], separator, len(heading)))
    units = _units_row(rows, separator)
    rows = rows[1:] if units else rows
    columns = [[cells[index] for _, cells in rows] for index in range(len(heading))]
    return _named(heading, units, [_values(column, separator) for column in columns], [number for number, _ in rows])


def _lines(text: str) -> tuple[list[Line], str]:
    """Return numbered lines without comments and blank ones, and the last comment before the first of them."""
    lines: list[Line] = []
    comment = ""
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        if line.lstrip().startswith(_COMMENTS):
            comment = line.lstrip().lstrip("".join(_COMMENTS)).strip() if not lines else comment
        elif line.strip():
            lines.append((number, line))
    return lines, comment


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return re.sub(r"\s+(?=[\[\(])", "", line).split()  # a unit belongs to its name
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _rows(lines: list[Line], separator: str, width: int) -> Iterator[Row]:
    for number, line in lines:
        cells = _cells(line, separator)
        if len(cells) == width + 1 and not cells[-1]:
            cells.pop()  # a separator at the end of each row
        if len(cells) != width:
            raise DataFileError(f"line {number} has {len(cells)} columns, the heading has {width}")
        yield number, cells


def _units_row(rows: list[Row], separator: str) -> list[str]:
    """Return the units where the first row holds no number and the second does, else nothing."""
    if len(rows) < 2:
        return []
    first, second = (sum(_number(cell, separator) is not None for cell in cells) for _, cells in rows[:2])
    return [cell.strip("[]() ") for cell in rows[0][1]] if first == 0 and second > 0 else []


def _plain(lines: list[Line], separator: str) -> Signal | None:
    """Numbers of a table without quotes, words and holes, read in one go; None where it is not one."""
    texts = [line if separator == "," else line.replace(",", ".") for _, line in lines]
    try:
        return np.loadtxt(texts, delimiter=None if separator == " " else separator, ndmin=2, comments=None)
    except ValueError:
        return None


def _values(cells: list[str], separator: str) -> Signal | list[str]:
    """Numbers of a column; its words where one of them is not a number."""
    values = [_number(cell, separator) for cell in cells]
    return cells if None in values else np.array(values, dtype=np.float64)


def _named(headings: list[str], units: list[str], values: list[Signal | list[str]], numbers: list[int]) -> Columns:
    columns = Columns()
    for index, (heading, column) in enumerate(zip(headings, values, strict=True)):
        match = _HEADING.match(heading)
        name, unit = (match["name"], match["unit"] or "") if match else (heading, "")
        if not name:
            continue  # an index, or what a separator at the end of the heading makes
        if name in columns or name in columns.reasons:
            columns.pop(name, None)
            columns.reasons[name] = f"two columns are called '{name}': give one of them another name"
        elif isinstance(column, list):
            wrong = next(at for at, cell in enumerate(column) if _number(cell, ";") is None)
            columns.texts[name] = column
            columns.reasons[name] = (
                f"column '{name}' holds '{column[wrong]}' in line {numbers[wrong]}, which is not a number"
            )
        else:
            columns[name] = column
            columns.units[name] = unit or (units[index] if units else "")
    return columns


def _number(cell: str, separator: str) -> float | None:
    text = cell.strip().strip('"')
    if text.lower() in _MISSING:
        return float("nan")
    if "," in text and (separator != "," or text.count(",") == 1):
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return None
