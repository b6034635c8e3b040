"""Tables of text: columns by name, decimal marks, dates and times of day."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from backend.identification import messages
from backend.identification.records import DataFileError, FileFault, Signal

# Dates ---------------------------------------------------------------------------------------------
# Dates and times of day in usual formats, converted to seconds from the first one.
#
# No library parser is used, because they guess missing parts and ambiguous orders.


DAY_FIRST, MONTH_FIRST = "dmy", "mdy"
"""Values in place of a unit that define which number of 03/04/2026 is the day."""
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,](?P<fraction>\d+))?)?"
    r"(?:\s?(?P<half>[ap])\.?m\.?)?"
)
_ZONE = r"(?:\s?(?P<zone>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?))?"
_DATES = {
    "year first": r"(?P<year>\d{4})(?P<mark>[-/.])(?P<month>\d{1,2})(?P=mark)(?P<day>\d{1,2})",
    "day first": r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})",
    "named month": r"(?P<day>\d{1,2})[- ](?P<name>[A-Za-z]{3})[- ](?P<year>\d{4})",
    "doubtful order": r"(?P<one>\d{1,2})(?P<mark>[-/])(?P<other>\d{1,2})(?P=mark)(?P<year>\d{4})",
}
_FORMS = {
    **{
        name: re.compile(rf"{words}(?:(?:[T ]|,\s)\s*{_CLOCK})?{_ZONE}", re.IGNORECASE | re.ASCII)
        for name, words in _DATES.items()
    },
    "compact": re.compile(
        r"(?P<year>\d{4})(?P<month>\d{2})(?P<day>\d{2})T(?P<hour>\d{2})(?P<minute>\d{2})(?P<second>\d{2})"
        rf"(?:[.,](?P<fraction>\d+))?(?P<half>(?!))?{_ZONE}",
        re.IGNORECASE | re.ASCII,
    ),
    "time of day": re.compile(rf"{_CLOCK}{_ZONE}", re.IGNORECASE | re.ASCII),
}


@dataclass(frozen=True)
class Dates:
    """Seconds from the first date on, shape (n,), and the form of the dates."""

    seconds: Signal
    form: str
    has_zone: bool


def read_dates(name: str, texts: Sequence[str], order: str | None = None) -> Dates:
    """Read a column of dates; ``order`` is DAY_FIRST or MONTH_FIRST.

    ``order`` resolves ambiguous dates such as 03/04/2026. Raises DataFileError for invalid dates, for forms or zones
    that change, and for an ambiguous order.
    """
    cells = [text.strip() for text in texts]
    form = next((form for form, pattern in _FORMS.items() if cells and pattern.fullmatch(cells[0])), None)
    if form is None:
        raise _no_date(name, cells[0] if cells else "", 0)
    matches = []
    for row, cell in enumerate(cells):
        match = _FORMS[form].fullmatch(cell)
        if match is None:
            raise _no_date(name, cell, row)
        matches.append(match)
    zones = {match["zone"] is not None for match in matches}
    if len(zones) == 2:
        row = next(at for at, match in enumerate(matches) if match["zone"] is None)
        raise DataFileError(
            messages.dates_with_and_without_zone(name=name, date=cells[row]),
            FileFault.DATES,
            column=name,
        )
    day_of = _make_day_reader(name, form, matches, order)
    first: int | None = None
    elapsed = []
    for row, match in enumerate(matches):
        try:
            day, nanoseconds = day_of(match), _of_day_ns(match)
        except ValueError:
            raise _no_date(name, cells[row], row) from None
        first = day if first is None else first
        elapsed.append((day - first) * 86_400_000_000_000 + nanoseconds)
    return Dates(np.array([(value - elapsed[0]) * 1e-9 for value in elapsed]), form, zones == {True})


def _no_date(name: str, cell: str, row: int) -> DataFileError:
    return DataFileError(messages.not_a_date(name=name, cell=cell, row=row + 1), FileFault.DATES, column=name)


def _make_day_reader(
    name: str, form: str, matches: Sequence[re.Match[str]], order: str | None
) -> Callable[[re.Match[str]], int]:
    """Return the function from a date to the number of its day."""
    if form == "time of day":
        return lambda _: 0
    if form == "named month":
        return lambda match: _ordinal(match["year"], _MONTHS.index(match["name"].lower()) + 1, match["day"])
    if form != "doubtful order":
        return lambda match: _ordinal(match["year"], match["month"], match["day"])
    days = {(match["one"], match["other"], match["year"]) for match in matches}
    is_day_first = any(int(one) > 12 for one, _, _ in days)
    is_month_first = any(int(other) > 12 for _, other, _ in days)
    if order is None and not (is_day_first or is_month_first) and len(days) > 1:
        raise DataFileError(
            messages.ambiguous_date(name=name, date=matches[0].string),
            FileFault.DATES,
            column=name,
            option="--time-unit",
        )
    if order == DAY_FIRST or (order is None and is_day_first):
        return lambda match: _ordinal(match["year"], match["other"], match["one"])
    return lambda match: _ordinal(match["year"], match["one"], match["other"])


@cache
def _ordinal(year: str, month: str | int, day: str) -> int:
    """Return the days since 1970. Raises ValueError for a day that does not exist."""
    return int(np.datetime64(f"{year}-{int(month):02d}-{int(day):02d}", "D").astype(np.int64))


def _of_day_ns(match: re.Match[str]) -> int:
    """Return the nanoseconds from midnight in UTC, or in the omitted time zone.

    Raises ValueError.
    """
    hour, minute, second = (int(match[part] or 0) for part in ("hour", "minute", "second"))
    if match["half"]:
        if not 1 <= hour <= 12:
            raise ValueError
        hour = hour % 12 + (12 if match["half"].lower() == "p" else 0)
    if hour > 23 or minute > 59 or second > 59:
        raise ValueError
    ahead = 0
    zone = match["zone"] or ""
    if zone[:1] in ("+", "-"):
        ahead = 3600 * int(zone[1:3]) + 60 * int(zone[3:].lstrip(":") or 0)
        ahead = -ahead if zone[0] == "-" else ahead
    fraction = (match["fraction"] or "0").ljust(9, "0")[:9]
    return (3600 * hour + 60 * minute + second - ahead) * 1_000_000_000 + int(fraction)


# Decimals ------------------------------------------------------------------------------------------
# Decimal mark of a table of text: a point or a comma; the other one groups thousands.
#
# A single cell is often ambiguous: "8,019" is 8019 or 8.019. The table is unambiguous if some cell has one reading
# only, such as "0,5" or "1,234.5". If there is none, or if cells contradict each other, the table is rejected.


MISSING = ("", "na", "nan", "n/a", "null", "none", "-")
"""Cells without a value, in lower case."""


class DecimalMark(StrEnum):
    """Decimal mark."""

    POINT = "point"
    COMMA = "comma"

    @property
    def character(self) -> str:
        """The character of the mark."""
        return "." if self is DecimalMark.POINT else ","

    @property
    def other(self) -> "DecimalMark":
        """The mark that groups thousands."""
        return DecimalMark.COMMA if self is DecimalMark.POINT else DecimalMark.POINT


def _pattern(decimal: str, group: str) -> re.Pattern[str]:
    grouped = rf"[1-9]\d{{0,2}}(?:{group}\d{{3}})+"
    return re.compile(
        rf"[+-]?(?:(?P<grouped>{grouped})|\d+)?(?:{decimal}\d*)?(?:[eE][+-]?\d+)?|[+-]?(?:inf|infinity)",
        re.ASCII | re.IGNORECASE,
    )


_PATTERNS = {DecimalMark.POINT: _pattern(r"\.", ","), DecimalMark.COMMA: _pattern(",", r"\.")}
_POINT_ONLY = re.compile(r"(?<![\d.,])[+-]?(?:0|\d{4,})?\.\d|(?<![\d.,])[+-]?\d+\.(?!\d{3}(?![\d.,]))", re.ASCII)
_COMMA_ONLY = re.compile(r"(?<![\d.,])[+-]?(?:0|\d{4,})?,\d|(?<![\d.,])[+-]?\d+,(?!\d{3}(?![\d.,]))", re.ASCII)


def is_missing(cell: str) -> bool:
    """Return whether a cell has no value."""
    return cell.strip().lower() in MISSING


def number(cell: str, mark: DecimalMark) -> float | None:
    """Return the number in a cell, NaN without a value, None for text."""
    text = cell.strip()
    if text.lower() in MISSING:
        return float("nan")
    if _PATTERNS[mark].fullmatch(text) is None:
        return None
    try:
        return float(text.replace(mark.other.character, "").replace(mark.character, "."))
    except ValueError:  # a sign or a mark alone
        return None


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number with either mark."""
    return not is_missing(cell) and any(number(cell, mark) is not None for mark in DecimalMark)


def is_unambiguous(text: str, mark: DecimalMark) -> bool:
    """Return whether a text has a number that only this mark allows.

    With a point, these are numbers such as 0.5 or 12.25. The text does not contain the other mark.
    """
    pattern = _POINT_ONLY if mark is DecimalMark.POINT else _COMMA_ONLY
    return pattern.search(text) is not None


@dataclass(frozen=True)
class _Column:
    """Possible readings of a column's cells, and cells with one reading only."""

    readings: frozenset[DecimalMark]
    only: dict[DecimalMark, int]
    doubtful: int | None

    @property
    def is_mixed(self) -> bool:
        """Whether each cell is a number, though not with the same mark."""
        return not self.readings and len(self.only) == 2


def _scan_column(cells: Sequence[str]) -> _Column:
    readings, doubtful = set(DecimalMark), None
    only: dict[DecimalMark, int] = {}
    for at, cell in enumerate(cells):
        if "," not in cell and "." not in cell:
            if number(cell, DecimalMark.POINT) is None:
                return _Column(frozenset(), {}, None)
            continue
        read = {mark for mark in DecimalMark if number(cell, mark) is not None}
        if not read:
            return _Column(frozenset(), {}, None)
        if len(read) == 1:
            only.setdefault(next(iter(read)), at)
        elif doubtful is None and number(cell, DecimalMark.POINT) != number(cell, DecimalMark.COMMA):
            doubtful = at
        readings &= read
    return _Column(frozenset(readings), only, doubtful)


@dataclass(frozen=True)
class Decimals:
    """Decimal mark of a table, grouped columns, and misfit columns with the row."""

    mark: DecimalMark
    grouped: tuple[int, ...] = ()
    misfits: dict[int, int] | None = None


def detect_decimal_mark(
    columns: Sequence[Sequence[str]],
    names: Sequence[str],
    lines: Sequence[int],
    asked: DecimalMark | None,
    *,
    is_point_usual: bool,
) -> Decimals:
    """Return the decimal mark of a table from its cells; ``asked`` has priority.

    ``names`` and ``lines`` locate a cell. ``is_point_usual``: a point as in 8.019 needs no other evidence. Raises
    DataFileError if the cells are ambiguous or contradict each other.
    """
    scanned = [_scan_column(cells) for cells in columns]
    marks = {
        mark: next((at for at, column in enumerate(scanned) if mark in column.only and mark in column.readings), None)
        for mark in DecimalMark
    }
    if asked is None and None not in marks.values():
        places = [(marks[mark], scanned[marks[mark] or 0].only[mark]) for mark in DecimalMark]
        (one, row), (other, other_row) = ((column or 0, row) for column, row in places)
        raise DataFileError(
            messages.two_decimal_marks(
                point=names[one],
                point_cell=columns[one][row],
                point_line=lines[row],
                comma=names[other],
                comma_cell=columns[other][other_row],
                comma_line=lines[other_row],
            ),
            FileFault.MIXED_DECIMALS,
            column=names[other],
            line=lines[other_row],
            option="--decimal",
        )
    mark = asked or next((mark for mark in DecimalMark if marks[mark] is not None), None)
    if mark is None:
        unclear = [at for at, column in enumerate(scanned) if column.doubtful is not None and column.readings]
        commas = [at for at in unclear if any("," in cell for cell in columns[at])]
        if commas or (unclear and not is_point_usual):
            _make_ambiguity_error((commas or unclear)[0], scanned, columns, names, lines)
        mark = DecimalMark.POINT
    grouped = [
        at
        for at, column in enumerate(scanned)
        if mark in column.readings and any(mark.other.character in cell for cell in columns[at])
    ]
    for at in grouped:
        if asked is None and not _has_groups_only(columns[at], mark):
            _make_ambiguity_error(at, scanned, columns, names, lines)
    misfits = {at: max(column.only.values()) for at, column in enumerate(scanned) if column.is_mixed}
    misfits |= {
        at: column.only[mark.other]
        for at, column in enumerate(scanned)
        if mark not in column.readings and mark.other in column.readings and mark.other in column.only
    }
    return Decimals(mark, tuple(grouped), misfits)


def _has_groups_only(cells: Sequence[str], mark: DecimalMark) -> bool:
    """Return whether a column groups each number from 1000 on, provably.

    A cell must show that the character is not a decimal mark.
    """
    group, shown = mark.other.character, False
    for cell in cells:
        value = number(cell, mark)
        if value is None or value != value:
            continue
        if group not in cell and abs(value) >= 1000.0:
            return False
        shown |= cell.count(group) > 1 or mark.character in cell or (group not in cell and value != 0.0)
    return shown


def _make_ambiguity_error(
    at: int, scanned: Sequence[_Column], columns: Sequence[Sequence[str]], names: Sequence[str], lines: Sequence[int]
) -> None:
    row = scanned[at].doubtful or 0
    cell = columns[at][row]
    values = {mark.value: number(cell, mark) for mark in DecimalMark}
    raise DataFileError(
        messages.ambiguous_decimal_mark(name=names[at], cell=cell, line=lines[row], values=values),
        FileFault.AMBIGUOUS_DECIMALS,
        column=names[at],
        line=lines[row],
        option="--decimal",
    )


# Table ---------------------------------------------------------------------------------------------
# A table of text: columns by name, and reasons why a column is unusable.
#
# Separators are comma, semicolon, tab, vertical bar or blanks, or that of a line ``sep=;``. Lines that begin with # or
# % are comments. Lines above the heading, a row of units below it, an index without a name and columns of text are not
# read as numbers, and :class:`Columns` lists them.


MAX_SAMPLES = 5_000_000
LARGEST_EXACT = 2.0**53
"""Integers beyond it are rounded as 64-bit floating-point numbers."""
_HEADING = re.compile(r"^\s*(?P<name>[^\[\(]*?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?\s*$")
_COMMENTS = ("#", "%")
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "vertical bar", " ": "blanks"}
_DIRECTIVE = re.compile(r'^\s*"?sep=(?P<separator>.)"?[\s;,]*$', re.IGNORECASE)
_ONE_UNIT = (
    r"(?:[pnuµμmcdkMG]?(?:s|V|A|N|m|rad|g|Pa|Hz|W|J|K|C|F|H|T|Ω|l|L)|deg|°C?|%|ohm|bar|Nm|sec|seconds?|min|h|rpm|counts?|"
    r"cnt|ticks?|steps?|volts?|amp(?:ere)?s?|radians?|degrees?|newtons?|met(?:er|re)s?|milliseconds?|1|-|)(?:\^?-?[0-9²³])?"
)
_TABLE_UNIT = re.compile(rf"\[[^\]]*\]|\([^)]*\)|{_ONE_UNIT}(?:[·*/ .]{_ONE_UNIT})*")
_TIME_NAME = re.compile(r"\s*(?:t|x_value|(?:date)?time(?:stamp)?s?)\b", re.IGNORECASE)
_SAMPLE = 9
"""Rows from the middle of a table that determine its separator and its columns of numbers."""

Line = tuple[int, str]
Row = tuple[int, list[str]]
Whole = NDArray[np.int64]


class Columns(dict[str, Signal]):
    """Numeric columns by name, with information about their file.

    - ``units``: units of columns that have one; ``texts``: cells of columns of text.
    - ``whole``: exact integers of columns that rounding changes.
    - ``reasons``: why another column is missing; ``faults``: the kind of the reason.
    - ``layout``: format of the file, for people and programs; ``notes``: further remarks.
    - ``holes``: number of lines between rows that may be missing samples.
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
        """Return a column. Raises DataFileError with the reason if it is missing."""
        if name in self.reasons:
            raise DataFileError(self.reasons[name], self.faults.get(name, FileFault.NOT_A_NUMBER), column=name)
        if name not in self:
            heading = self.layout.get("heading_line")
            raise DataFileError(
                messages.column_missing(name=name, known=list(self), heading_line=heading, notes=list(self.notes)),
                FileFault.NO_COLUMN,
                column=name,
                option="--header" if heading else None,
            )
        return self[name]

    def not_read(self) -> dict[str, str]:
        """Return all columns of the file, each with the reason for not reading it."""
        not_selected: str = messages.column_not_selected()
        return dict.fromkeys(self, not_selected) | self.reasons

    def leave_out(self, name: str, reason: str, fault: FileFault = FileFault.NOT_A_NUMBER) -> None:
        """Remove a column of the file, with a reason."""
        self.pop(name, None)
        self.reasons[name], self.faults[name] = reason, fault


def read_csv(text: str, *, header: int | None = None, decimal: DecimalMark | None = None) -> Columns:
    """Return the columns of a table of text; names may have a unit, as in ``u [V]``.

    ``header`` is the line with the names, ``decimal`` the decimal mark; both are detected if not given. Raises
    DataFileError.
    """
    table = _Table(text)
    heading, first = table.read_heading(header) if header is not None else table.find_heading()
    return table.columns(heading, first, decimal)


@dataclass(frozen=True)
class _Heading:
    """Names of the columns, the number of their line, and a row of units."""

    line: int
    names: list[str]
    units: list[str]


class _Table:
    """Numbered lines of a text: comments, and other lines that are not empty."""

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
        """Return the separator with the most numeric cells in the middle of the table."""
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
        """Return the number of columns and the numeric ones, from the middle of the table.

        The third value states whether the last column is empty there, so that it may result from a separator at the end
        of each row.
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
        """Return the cells of a line, without an empty one after a final separator."""
        cells = _cells(line, self.separator)
        if len(cells) == self.width + 1 and not cells[-1]:
            cells.pop()
        return cells

    def _has_numbers(self, line: str) -> bool:
        cells = self.cells(line)
        fits = len(cells) == self.width and all(is_number(cells[at]) or is_missing(cells[at]) for at in self.numeric)
        return fits and any(is_number(cells[at]) for at in self.numeric)

    def _has_words(self, line: str) -> bool:
        """Return whether a line may name the columns."""
        cells = self._names(line)
        fits = len(cells) == self.width or (self.is_open and len(cells) == self.width - 1)
        words = fits and not any(is_number(cells[at]) for at in self.numeric)
        return words and any(cells) and not line.lstrip().startswith("***")

    def _names(self, line: str) -> list[str]:
        """Return the cells of a heading.

        LabVIEW adds a column of comments that most rows do not fill.
        """
        names = self.cells(line)
        if len(names) == self.width + 1 and names[-1].lower() == "comment":
            names.pop()
        return names

    def find_heading(self) -> tuple[_Heading, int]:
        """Find the heading and the index of the first row. Raises DataFileError."""
        if not self.lines:
            raise DataFileError(messages.no_heading(), FileFault.NO_HEADING)
        first = next((at for at, (_, line) in enumerate(self.lines) if self.numeric and self._has_numbers(line)), 1)
        start = first
        while start > 0 and self._has_words(self.lines[start - 1][1]):
            start -= 1
        above = self.lines[start:first]
        units: list[str] = []
        if len(above) > 1 and all(_TABLE_UNIT.fullmatch(cell) for cell in self.cells(above[-1][1])):
            units = [cell.strip("[]() ") for cell in self.cells(above.pop()[1])]
        if len(above) == 1 or (above and any(_TIME_NAME.match(cell) for cell in self.cells(above[-1][1]))):
            line, words = above[-1]
            return _Heading(line, self._names(words), units), first
        if above:
            raise DataFileError(
                messages.ambiguous_heading(lines=[line for line, _ in above]),
                FileFault.AMBIGUOUS_HEADING,
                line=above[-1][0],
                option="--header",
            )
        for line, comment in reversed(self.comments):
            names = comment.lstrip().lstrip("".join(_COMMENTS)).strip()
            if first < len(self.lines) and line < self.lines[first][0] and self._has_words(names):
                return _Heading(line, self._names(names), units), first
        if first > 0:
            line, words = self.lines[first - 1]
            raise DataFileError(
                messages.no_names_above_numbers(line=line, columns=self.width, text=words[:60]),
                FileFault.AMBIGUOUS_HEADING,
                line=line,
                option="--header",
            )
        raise DataFileError(messages.first_line_holds_numbers(), FileFault.NO_HEADING)

    def read_heading(self, line: int) -> tuple[_Heading, int]:
        """Return the heading of a line, comment or not, and the index of the first row.

        Raises DataFileError.
        """
        words = dict((*self.comments, *self.lines)).get(line)
        if words is None:
            raise DataFileError(
                messages.heading_is_empty(line=line),
                FileFault.NO_HEADING,
                line=line,
                option="--header",
            )
        names = words.lstrip().lstrip("".join(_COMMENTS)).strip() if words.lstrip().startswith(_COMMENTS) else words
        below = next((at for at, (number_of, _) in enumerate(self.lines) if number_of > line), len(self.lines))
        first = next((at for at in range(below, len(self.lines)) if self._has_numbers(self.lines[at][1])), below)
        between = self.lines[below:first]
        units: list[str] = []
        if between and all(_TABLE_UNIT.fullmatch(cell) for cell in self.cells(between[0][1])):
            units = [cell.strip("[]() ") for cell in self.cells(between[0][1])]
        return _Heading(line, self._names(names), units), first

    def columns(self, heading: _Heading, first: int, decimal: DecimalMark | None) -> Columns:
        """Return the columns below a heading. Raises DataFileError."""
        self.width = len(heading.names)
        rows, empty = self.lines[first:], 0
        while rows and not any(self.cells(rows[-1][1])):
            rows, empty = rows[:-1], empty + 1
        if not rows:
            raise DataFileError(messages.no_heading(), FileFault.NO_HEADING)
        if len(rows) > MAX_SAMPLES:
            raise DataFileError(messages.too_many_rows(rows=len(rows), maximum=MAX_SAMPLES), FileFault.TOO_LONG)
        fast = self._plain(rows, decimal)
        if fast is not None and fast[0].shape[1] == len(heading.names):
            values, mark = fast
            columns = _make_columns(heading, list(values.T), [], {})
            for at, name in enumerate(heading.names):
                if (name := _split_cell(name)[0]) in columns and float(np.max(np.abs(values[:, at]))) > LARGEST_EXACT:
                    _store_integers(columns, name, [self.cells(line)[at] for _, line in rows])
        else:
            columns, mark = self._read_by_cell(heading, rows, decimal)
        self._note_format(columns, heading, mark, rows=len(rows), empty=empty)
        return columns

    def _read_by_cell(
        self, heading: _Heading, rows: list[Line], decimal: DecimalMark | None
    ) -> tuple[Columns, DecimalMark]:
        width = len(heading.names)
        table = [(line, self.cells(words)) for line, words in rows]
        for line, cells in table:
            if len(cells) != width:
                raise DataFileError(
                    messages.row_of_other_width(
                        line=line, columns=len(cells), heading_line=heading.line, expected=width
                    ),
                    FileFault.ROW_WIDTH,
                    line=line,
                    option="--header",
                )
        lines, cells_of = [line for line, _ in table], [[cells[at] for _, cells in table] for at in range(width)]
        found = detect_decimal_mark(cells_of, heading.names, lines, decimal, is_point_usual=self.separator != ";")
        values = [_values(cells, found.mark) for cells in cells_of]
        misfits = {
            at: messages.other_decimal_mark(
                name=_split_cell(heading.names[at])[0],
                cell=cells_of[at][row],
                line=lines[row],
                mark=found.mark.value,
            )
            for at, row in (found.misfits or {}).items()
        }
        columns = _make_columns(heading, values, lines, misfits)
        for at in found.grouped:
            name = _split_cell(heading.names[at])[0]
            columns.notes.append(messages.thousands_separated(name=name, separator=found.mark.other.character))
        for at, column in enumerate(values):
            name = _split_cell(heading.names[at])[0]
            if not isinstance(column, list) and name in columns and float(np.max(np.abs(column))) > LARGEST_EXACT:
                _store_integers(columns, name, cells_of[at])
        return columns, found.mark

    def _plain(self, rows: list[Line], decimal: DecimalMark | None) -> tuple[Signal, DecimalMark] | None:
        """Return the numbers of a table without quotes, text and gaps, parsed at once.

        The result is None if the table is not of this kind.
        """
        texts = [line for _, line in rows]
        whole = "\n".join(texts)
        mark = DecimalMark.POINT
        if self.separator != ",":
            has_point, has_comma = "." in whole, "," in whole
            mark = DecimalMark.COMMA if has_comma else DecimalMark.POINT
            is_known = is_unambiguous(whole, mark) or not (has_point or has_comma)
            if (has_point and has_comma) or not (is_known or (mark is DecimalMark.POINT and self.separator != ";")):
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

    def _note_gaps(self, columns: Columns, *, rows: int, empty: int) -> None:
        """Note lines between rows that may be missing samples."""
        lines = [line for line, _ in self.lines[len(self.lines) - empty - rows : len(self.lines) - empty]]
        first, last = (lines[0], lines[-1]) if lines else (0, 0)
        blank = sum(first < line < last for line in self.blank)
        # Some programs end each line twice.
        columns.holes = 0 if blank == rows - 1 else blank
        if columns.holes:
            columns.notes.append(messages.empty_lines(count=blank))
        between = [words for line, words in self.comments if first < line < last]
        commented = sum(self._has_numbers(words.lstrip().lstrip("".join(_COMMENTS))) for words in between)
        columns.holes += commented
        if commented:
            columns.notes.append(messages.comment_lines_with_numbers(count=commented))

    def _note_format(self, columns: Columns, heading: _Heading, mark: DecimalMark, *, rows: int, empty: int) -> None:
        above = sum(line < heading.line for line, _ in self.lines) + (self.directive is not None)
        below = len(self.lines) - rows - empty - sum(line <= heading.line for line, _ in self.lines)
        comments = len(self.comments) - sum(line == heading.line for line, _ in self.comments)
        columns.layout |= {
            "format": messages.table_of_text(),
            "heading_line": heading.line,
            "separator": _NAMES.get(self.separator, self.separator),
            "decimal_mark": mark.value,
            "rows": rows,
            "lines_above_heading": above,
            "lines_of_units": 1 if heading.units else 0,
            "comment_lines": comments,
        }
        self._note_gaps(columns, rows=rows, empty=empty)
        if empty:
            columns.notes.append(messages.rows_without_value(count=empty))
        if below > (1 if heading.units else 0):
            unread = below - (1 if heading.units else 0)
            columns.notes.append(messages.lines_below_heading(count=unread))
        # LabVIEW's preamble defines X_Value.
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
    except csv.Error:  # a cell longer than the reader's limit
        return [line]


def _split_cell(heading: str) -> tuple[str, str]:
    """Return name and unit of a cell of the heading."""
    match = _HEADING.match(heading)
    return (match["name"], match["unit"] or "") if match else (heading, "")


def _values(cells: list[str], mark: DecimalMark) -> Signal | list[str]:
    """Return the numbers of a column, 1 and 0 for true and false, or its texts."""
    values = [number(cell, mark) for cell in cells]
    if None not in values:
        return np.array(values, dtype=np.float64)
    words = [cell.lower() for cell in cells]
    if all(word in ("true", "false") or is_missing(word) for word in words):
        return np.array([float("nan") if is_missing(word) else word == "true" for word in words], dtype=np.float64)
    return cells


def _store_integers(columns: Columns, name: str, cells: list[str]) -> None:
    """Store the exact integers of a column that are too large for floating point."""
    try:
        columns.whole[name] = np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        return


def _make_columns(
    heading: _Heading, values: Sequence[Signal | list[str]], lines: list[int], misfits: Mapping[int, str]
) -> Columns:
    columns = Columns()
    for index, (cell, column) in enumerate(zip(heading.names, values, strict=True)):
        name, unit = _split_cell(cell)
        if not name:
            if isinstance(column, list) or not np.all(np.isnan(column)):
                columns.notes.append(messages.column_without_name(position=index + 1))
            continue
        if name in columns or name in columns.reasons:
            columns.leave_out(name, messages.two_columns_of_table(name=name), FileFault.AMBIGUOUS_COLUMN)
            columns.texts.pop(name, None)
        elif index in misfits:
            columns.leave_out(name, misfits[index], FileFault.MIXED_DECIMALS)
        elif isinstance(column, list):
            wrong = next((at for at, one in enumerate(column) if not (is_number(one) or is_missing(one))), 0)
            columns.texts[name] = column
            text, line = column[wrong], lines[wrong]
            if text in heading.names:
                columns.leave_out(name, messages.heading_repeated(name=name, cell=text, line=line))
            else:
                columns.leave_out(name, messages.not_a_number(name=name, cell=text, line=line))
        else:
            columns[name] = column
            columns.units[name] = unit or (heading.units[index] if index < len(heading.units) else "")
    return columns
