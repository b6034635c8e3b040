"""A table as people save it, as text: columns by name, and why one of them cannot be used.

Separators are comma, semicolon, tab, vertical bar or blanks, or what a line ``sep=;`` says. Lines that begin with # or
% are comments. Lines above the heading, a row of units below it, an index without a name and columns of text are not
read as numbers, and :class:`Columns` says so. :mod:`backend.identification.decimals` finds the decimal mark.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.identification.decimals import (
    DecimalMark,
    decimals_of,
    is_missing,
    is_number,
    number,
    tells_by_itself,
)
from backend.identification.errors import DataFileError, FileFault
from backend.identification.record import Signal

MAX_SAMPLES = 5_000_000
NOT_ASKED_FOR = "not asked for"
LARGEST_EXACT = 2.0**53
"""Whole numbers beyond it are rounded as 64-bit floating-point numbers."""
_HEADING = re.compile(r"^\s*(?P<name>[^\[\(]*?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?\s*$")
_COMMENTS = ("#", "%")
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "vertical bar", " ": "blanks"}
_DIRECTIVE = re.compile(r'^\s*"?sep=(?P<separator>.)"?[\s;,]*$', re.IGNORECASE)
_ONE_UNIT = (
    r"(?:[pnuµμmcdkMG]?(?:s|V|A|N|m|rad|g|Pa|Hz|W|J|K|C|F|H|T|Ω|l|L)|deg|°C?|%|ohm|bar|Nm|sec|seconds?|min|h|rpm|counts?|"
    r"cnt|ticks?|steps?|volts?|amp(?:ere)?s?|radians?|degrees?|newtons?|met(?:er|re)s?|milliseconds?|1|-|)(?:\^?-?[0-9²³])?"
)
_UNIT = re.compile(rf"\[[^\]]*\]|\([^)]*\)|{_ONE_UNIT}(?:[·*/ .]{_ONE_UNIT})*")
_TIME_NAME = re.compile(r"\s*(?:t|x_value|(?:date)?time(?:stamp)?s?)\b", re.IGNORECASE)
_SAMPLE = 9
"""Rows from the middle of a table that tell its separator and which columns hold numbers."""

Line = tuple[int, str]
Row = tuple[int, list[str]]
Whole = NDArray[np.int64]


class Columns(dict[str, Signal]):
    """Numeric columns by name, and what is known of the file they come from.

    ``units`` of those that carry one, ``texts`` the cells of columns that hold words, ``whole`` the exact numbers of
    columns that rounding changes. ``reasons`` say why another column is not here, ``faults`` which kind of reason it
    is. ``layout`` says how the file was read, for people and programs; ``notes`` what else there is to say. ``holes``
    are lines between rows that may be samples that are missing.
    """

    def __init__(self, columns: dict[str, Signal] | None = None) -> None:
        super().__init__(columns or {})
        self.units: dict[str, str] = {}
        self.texts: dict[str, list[str]] = {}
        self.whole: dict[str, Whole] = {}
        self.reasons: dict[str, str] = {}
        self.faults: dict[str, FileFault] = {}
        self.layout: dict[str, str | int] = {}
        self.notes: list[str] = []
        self.holes = 0

    def column(self, name: str) -> Signal:
        """Return a column. Raises DataFileError saying why there is none of that name."""
        if name in self.reasons:
            raise DataFileError(self.reasons[name], self.faults.get(name, FileFault.NOT_A_NUMBER), column=name)
        if name not in self:
            heading = self.layout.get("heading_line")
            raise DataFileError(
                f"there is no column '{name}'; the file has {', '.join(self) or 'no column of numbers'}"
                + (f" (names in line {heading}; --header LINE takes those of another)" if heading else "")
                + "".join(f"; {note}" for note in self.notes),
                FileFault.NO_COLUMN,
                column=name,
                option="--header" if heading else None,
            )
        return self[name]

    def not_read(self) -> dict[str, str]:
        """Return all columns of the file, each with why it would not be read."""
        return dict.fromkeys(self, NOT_ASKED_FOR) | self.reasons

    def leave_out(self, name: str, reason: str, fault: FileFault = FileFault.NOT_A_NUMBER) -> None:
        """Say why a column of the file is not read."""
        self.pop(name, None)
        self.reasons[name], self.faults[name] = reason, fault


def read_csv(text: str, *, header: int | None = None, decimal: DecimalMark | None = None) -> Columns:
    """Columns of a table of text; names may carry a unit, as in ``u [V]``.

    ``header`` is the line that holds the names, ``decimal`` the mark before decimals; both are found where they are
    not given. Raises DataFileError.
    """
    table = _Table(text)
    heading, first = table.given_heading(header) if header is not None else table.heading()
    return table.columns(heading, first, decimal)


def _no_heading() -> DataFileError:
    return DataFileError("the file holds no heading line with rows of numbers below it", FileFault.NO_HEADING)


@dataclass(frozen=True)
class _Heading:
    """Names of the columns, the number of their line, and the units of a row of its own."""

    line: int
    names: list[str]
    units: list[str]


class _Table:
    """Numbered lines of a text, apart: comments, and all others that are not empty."""

    def __init__(self, text: str) -> None:
        self.comments: list[Line] = []
        self.lines: list[Line] = []
        self.blank: list[int] = []
        self.directive: str | None = None
        for at, line in enumerate(re.split(r"\r\n|\n|\r", text.lstrip("\ufeff")), start=1):
            if line.lstrip().startswith(_COMMENTS):
                self.comments.append((at, line))
            elif line.strip():
                self.lines.append((at, line))
            else:
                self.blank.append(at)
        if self.lines and (match := _DIRECTIVE.match(self.lines[0][1])):
            self.directive = match["separator"]
            self.lines.pop(0)
        self.separator = self.directive or self._separator()
        self.width, self.numeric, self.is_open = self._form()

    def _middle(self) -> list[str]:
        start = max(len(self.lines) // 2 - _SAMPLE // 2, 1 if len(self.lines) > 1 else 0)
        return [line for _, line in self.lines[start : start + _SAMPLE]]

    def _separator(self) -> str:
        """Return the separator by which most cells of the middle of the table are numbers."""
        best, found = (0.0, 0), " "
        for separator in _NAMES:
            rows = [_cells(line, separator) for line in self._middle()]
            width = _usual([len(cells) for cells in rows])
            cells = [cell for row in rows if len(row) == width for cell in row]
            if width < 2:
                continue
            score = sum(is_number(cell) or is_missing(cell) for cell in cells) / len(cells), width
            if score > best:
                best, found = score, separator
        return found

    def _form(self) -> tuple[int, frozenset[int], bool]:
        """Return how many columns there are and which hold numbers, by the middle of the table.

        Also whether the last one is empty there, so that it may be what a separator at the end of each row makes.
        """
        rows = [_cells(line, self.separator) for line in self._middle()]
        width = _usual([len(cells) for cells in rows])
        rows = [cells for cells in rows if len(cells) == width]
        numeric = (
            at
            for at in range(width)
            if all(is_number(cells[at]) or is_missing(cells[at]) for cells in rows)
            and any(is_number(cells[at]) for cells in rows)
        )
        return width, frozenset(numeric), width > 1 and not any(cells[-1] for cells in rows)

    def cells(self, line: str) -> list[str]:
        """Cells of a line, without the empty one that a separator at the end makes."""
        cells = _cells(line, self.separator)
        if len(cells) == self.width + 1 and not cells[-1]:
            cells.pop()
        return cells

    def _holds_numbers(self, line: str) -> bool:
        cells = self.cells(line)
        fits = len(cells) == self.width and all(is_number(cells[at]) or is_missing(cells[at]) for at in self.numeric)
        return fits and any(is_number(cells[at]) for at in self.numeric)

    def _holds_words(self, line: str) -> bool:
        """Whether a line may name the columns."""
        cells = self._names(line)
        fits = len(cells) == self.width or (self.is_open and len(cells) == self.width - 1)
        words = fits and not any(is_number(cells[at]) for at in self.numeric)
        return words and any(cells) and not line.lstrip().startswith("***")

    def _names(self, line: str) -> list[str]:
        """Cells of a heading: LabVIEW has a column of comments that most rows do not fill."""
        names = self.cells(line)
        if len(names) == self.width + 1 and names[-1].lower() == "comment":
            names.pop()
        return names

    def heading(self) -> tuple[_Heading, int]:
        """Find the names of the columns; also the index of the first row. Raises DataFileError."""
        if not self.lines:
            raise _no_heading()
        first = next((at for at, (_, line) in enumerate(self.lines) if self.numeric and self._holds_numbers(line)), 1)
        start = first
        while start > 0 and self._holds_words(self.lines[start - 1][1]):
            start -= 1
        above = self.lines[start:first]
        units: list[str] = []
        if len(above) > 1 and all(_UNIT.fullmatch(cell) for cell in self.cells(above[-1][1])):
            units = [cell.strip("[]() ") for cell in self.cells(above.pop()[1])]
        if len(above) == 1 or (above and any(_TIME_NAME.match(cell) for cell in self.cells(above[-1][1]))):
            line, words = above[-1]
            return _Heading(line, self._names(words), units), first
        if above:
            options = " or ".join(f"--header {line}" for line, _ in above)
            raise DataFileError(
                f"lines {above[0][0]} to {above[-1][0]} may all name the columns: say which of them does by {options}",
                FileFault.AMBIGUOUS_HEADING,
                line=above[-1][0],
                option="--header",
            )
        for line, comment in reversed(self.comments):
            names = comment.lstrip().lstrip("".join(_COMMENTS)).strip()
            if first < len(self.lines) and line < self.lines[first][0] and self._holds_words(names):
                return _Heading(line, self._names(names), units), first
        if first > 0:
            line, words = self.lines[first - 1]
            raise DataFileError(
                f"line {line}, above the first row of numbers, does not name {self.width} columns: '{words[:60]}'."
                " --header LINE says which line does",
                FileFault.AMBIGUOUS_HEADING,
                line=line,
                option="--header",
            )
        raise DataFileError("the first line holds numbers: put the names of the columns there", FileFault.NO_HEADING)

    def given_heading(self, line: int) -> tuple[_Heading, int]:
        """Return the heading of a line, comment or not, and the index of the first row. Raises DataFileError."""
        words = dict((*self.comments, *self.lines)).get(line)
        if words is None:
            raise DataFileError(
                f"line {line} is empty or beyond the end of the file: --header takes the line that names the columns",
                FileFault.NO_HEADING,
                line=line,
                option="--header",
            )
        names = words.lstrip().lstrip("".join(_COMMENTS)).strip() if words.lstrip().startswith(_COMMENTS) else words
        below = next((at for at, (number_of, _) in enumerate(self.lines) if number_of > line), len(self.lines))
        first = next((at for at in range(below, len(self.lines)) if self._holds_numbers(self.lines[at][1])), below)
        between = self.lines[below:first]
        units: list[str] = []
        if between and all(_UNIT.fullmatch(cell) for cell in self.cells(between[0][1])):
            units = [cell.strip("[]() ") for cell in self.cells(between[0][1])]
        return _Heading(line, self._names(names), units), first

    def columns(self, heading: _Heading, first: int, decimal: DecimalMark | None) -> Columns:
        """Return the columns below a heading. Raises DataFileError."""
        self.width = len(heading.names)
        rows, empty = self.lines[first:], 0
        while rows and not any(self.cells(rows[-1][1])):
            rows, empty = rows[:-1], empty + 1
        if not rows:
            raise _no_heading()
        if len(rows) > MAX_SAMPLES:
            raise DataFileError(
                f"the file holds {len(rows)} rows, at most {MAX_SAMPLES} are read: cut it", FileFault.TOO_LONG
            )
        fast = self._plain(rows, decimal)
        if fast is not None and fast[0].shape[1] == len(heading.names):
            values, mark = fast
            columns = _named(heading, list(values.T), [], {})
            for at, name in enumerate(heading.names):
                if (name := _parted(name)[0]) in columns and float(np.max(np.abs(values[:, at]))) > LARGEST_EXACT:
                    _keep_whole(columns, name, [self.cells(line)[at] for _, line in rows])
        else:
            columns, mark = self._read_by_cell(heading, rows, decimal)
        self._say(columns, heading, mark, rows=len(rows), empty=empty)
        return columns

    def _read_by_cell(
        self, heading: _Heading, rows: list[Line], decimal: DecimalMark | None
    ) -> tuple[Columns, DecimalMark]:
        width = len(heading.names)
        table = [(line, self.cells(words)) for line, words in rows]
        for line, cells in table:
            if len(cells) != width:
                raise DataFileError(
                    f"line {line} has {len(cells)} columns, the heading (line {heading.line}) has {width};"
                    " --header LINE takes another line as the heading",
                    FileFault.ROW_WIDTH,
                    line=line,
                    option="--header",
                )
        lines, cells_of = [line for line, _ in table], [[cells[at] for _, cells in table] for at in range(width)]
        found = decimals_of(cells_of, heading.names, lines, decimal, is_point_usual=self.separator != ";")
        values = [_values(cells, found.mark) for cells in cells_of]
        misfits = {
            at: f"column '{_parted(heading.names[at])[0]}' holds '{cells_of[at][row]}' in line {lines[row]}, whose"
            f" decimal mark is not that of the table, a {found.mark}"
            for at, row in (found.misfits or {}).items()
        }
        columns = _named(heading, values, lines, misfits)
        for at in found.grouped:
            name = _parted(heading.names[at])[0]
            columns.notes.append(f"thousands of '{name}' are grouped by '{found.mark.other.character}'")
        for at, column in enumerate(values):
            name = _parted(heading.names[at])[0]
            if not isinstance(column, list) and name in columns and float(np.max(np.abs(column))) > LARGEST_EXACT:
                _keep_whole(columns, name, cells_of[at])
        return columns, found.mark

    def _plain(self, rows: list[Line], decimal: DecimalMark | None) -> tuple[Signal, DecimalMark] | None:
        """Numbers of a table without quotes, words and holes, read in one go; None where it is not one."""
        texts = [line for _, line in rows]
        whole = "\n".join(texts)
        mark = DecimalMark.POINT
        if self.separator != ",":
            has_point, has_comma = "." in whole, "," in whole
            mark = DecimalMark.COMMA if has_comma else DecimalMark.POINT
            told = tells_by_itself(whole, mark) or not (has_point or has_comma)
            if (has_point and has_comma) or not (told or (mark is DecimalMark.POINT and self.separator != ";")):
                return None
            texts = whole.replace(",", ".").split("\n")
        if decimal not in (None, mark) or not rows:
            return None
        try:
            with np.errstate(all="ignore"):
                delimiter = None if self.separator == " " else self.separator
                return np.loadtxt(texts, delimiter=delimiter, ndmin=2, comments=None), mark
        except ValueError:
            return None

    def _say_holes(self, columns: Columns, *, rows: int, empty: int) -> None:
        """Say which lines between rows may be samples that are missing."""
        lines = [line for line, _ in self.lines[len(self.lines) - empty - rows : len(self.lines) - empty]]
        first, last = (lines[0], lines[-1]) if lines else (0, 0)
        blank = sum(first < line < last for line in self.blank)
        # Some programs end each line twice.
        columns.holes = 0 if blank == rows - 1 else blank
        if columns.holes:
            columns.notes.append(f"{blank} lines between rows are empty")
        between = [words for line, words in self.comments if first < line < last]
        commented = sum(self._holds_numbers(words.lstrip().lstrip("".join(_COMMENTS))) for words in between)
        columns.holes += commented
        if commented:
            columns.notes.append(f"{commented} comments between rows hold numbers like a row and are not read")

    def _say(self, columns: Columns, heading: _Heading, mark: DecimalMark, *, rows: int, empty: int) -> None:
        above = sum(line < heading.line for line, _ in self.lines) + (self.directive is not None)
        below = len(self.lines) - rows - empty - sum(line <= heading.line for line, _ in self.lines)
        comments = len(self.comments) - sum(line == heading.line for line, _ in self.comments)
        columns.layout |= {
            "format": "table of text",
            "heading_line": heading.line,
            "separator": _NAMES.get(self.separator, self.separator),
            "decimal_mark": mark.value,
            "rows": rows,
            "lines_above_heading": above,
            "lines_of_units": 1 if heading.units else 0,
            "comment_lines": comments,
        }
        self._say_holes(columns, rows=rows, empty=empty)
        if empty:
            columns.notes.append(f"{empty} rows without a value at the end of the file are not read")
        if below > (1 if heading.units else 0):
            unread = below - (1 if heading.units else 0)
            columns.notes.append(f"{unread} lines below the heading, above the first row of numbers, are not read")
        # LabVIEW tells in its preamble what X_Value is.
        dimensions = [line for number_of, line in self.lines if number_of < heading.line and "X_Dimension" in line]
        if "X_Value" in columns and any("Time" in line for line in dimensions):
            columns.units["X_Value"] = columns.units.get("X_Value") or "s"


def _usual(widths: Sequence[int]) -> int:
    return Counter(widths).most_common(1)[0][0] if widths else 0


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return [cell.strip('"') for cell in re.sub(r"\s+(?=[\[\(])", "", line).split()]  # a unit belongs to its name
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except csv.Error:  # a cell longer than the reader takes
        return [line]


def _parted(heading: str) -> tuple[str, str]:
    """Name and unit of a cell of the heading."""
    match = _HEADING.match(heading)
    return (match["name"], match["unit"] or "") if match else (heading, "")


def _values(cells: list[str], mark: DecimalMark) -> Signal | list[str]:
    """Numbers of a column, 1 and 0 for true and false; its words where one of them is neither."""
    values = [number(cell, mark) for cell in cells]
    if None not in values:
        return np.array(values, dtype=np.float64)
    words = [cell.lower() for cell in cells]
    if all(word in ("true", "false") or is_missing(word) for word in words):
        return np.array([float("nan") if is_missing(word) else word == "true" for word in words], dtype=np.float64)
    return cells


def _keep_whole(columns: Columns, name: str, cells: list[str]) -> None:
    """Keep the exact numbers of a column of whole numbers that are too large for floating point."""
    try:
        columns.whole[name] = np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        return


def _named(
    heading: _Heading, values: Sequence[Signal | list[str]], lines: list[int], misfits: dict[int, str]
) -> Columns:
    columns = Columns()
    for index, (cell, column) in enumerate(zip(heading.names, values, strict=True)):
        name, unit = _parted(cell)
        if not name:
            if isinstance(column, list) or not np.all(np.isnan(column)):
                columns.notes.append(f"column {index + 1} has no name and is not read")
            continue
        if name in columns or name in columns.reasons:
            reason = f"two columns are called '{name}': give one of them another name"
            columns.leave_out(name, reason, FileFault.AMBIGUOUS_COLUMN)
            columns.texts.pop(name, None)
        elif index in misfits:
            columns.leave_out(name, misfits[index], FileFault.MIXED_DECIMALS)
        elif isinstance(column, list):
            wrong = next((at for at, one in enumerate(column) if not (is_number(one) or is_missing(one))), 0)
            columns.texts[name] = column
            repeated = column[wrong] in heading.names
            columns.leave_out(
                name,
                f"column '{name}' holds '{column[wrong]}' in line {lines[wrong]}, which is not a number"
                + (": the heading is repeated there, so split the file" if repeated else ""),
            )
        else:
            columns[name] = column
            columns.units[name] = unit or (heading.units[index] if index < len(heading.units) else "")
    return columns
