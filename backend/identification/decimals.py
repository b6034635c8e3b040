"""Which mark separates decimals in a table of text: a point or a comma; the other one groups thousands.

One cell often does not tell: "8,019" is 8019 or 8.019. The table tells where some cell has one reading only, as
"0,5" or "1,234.5". Where none does, or where cells contradict each other, the table is refused.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from backend.identification.errors import DataFileError, FileFault

MISSING = ("", "na", "nan", "n/a", "null", "none", "-")
"""Cells that hold no value, in lower case."""


class DecimalMark(StrEnum):
    """The character before the decimals."""

    POINT = "point"
    COMMA = "comma"

    @property
    def character(self) -> str:
        """The mark itself."""
        return "." if self is DecimalMark.POINT else ","

    @property
    def other(self) -> "DecimalMark":
        """The one that groups thousands."""
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
    """Whether a cell holds no value."""
    return cell.strip().lower() in MISSING


def number(cell: str, mark: DecimalMark) -> float | None:
    """Return the number in a cell, NaN for one without a value, None for words."""
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
    """Whether a cell holds a number with either mark."""
    return not is_missing(cell) and any(number(cell, mark) is not None for mark in DecimalMark)


def tells_by_itself(text: str, mark: DecimalMark) -> bool:
    """Whether a text without the other mark holds a number that only this mark allows, such as 0.5 or 12.25."""
    pattern = _POINT_ONLY if mark is DecimalMark.POINT else _COMMA_ONLY
    return pattern.search(text) is not None


@dataclass(frozen=True)
class _Column:
    """What the cells of a column allow: readings of all of them, and a cell that has one reading only."""

    readings: frozenset[DecimalMark]
    only: dict[DecimalMark, int]
    doubtful: int | None

    @property
    def is_mixed(self) -> bool:
        """Whether each cell is a number, though not with one mark."""
        return not self.readings and len(self.only) == 2


def _looked_over(cells: Sequence[str]) -> _Column:
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
    """The mark of a table, columns whose thousands are grouped, and columns that do not fit, with the row."""

    mark: DecimalMark
    grouped: tuple[int, ...] = ()
    misfits: dict[int, int] | None = None


def decimals_of(
    columns: Sequence[Sequence[str]],
    names: Sequence[str],
    lines: Sequence[int],
    asked: DecimalMark | None,
    *,
    is_point_usual: bool,
) -> Decimals:
    """Return the decimal mark of a table from its cells, column by column; ``asked`` is believed.

    ``names`` and ``lines`` say where a cell is. ``is_point_usual`` where a point as in 8.019 needs no other evidence.
    Raises DataFileError where the cells do not tell, or contradict each other.
    """
    looked = [_looked_over(cells) for cells in columns]
    told = {
        mark: next((at for at, column in enumerate(looked) if mark in column.only and mark in column.readings), None)
        for mark in DecimalMark
    }
    if asked is None and None not in told.values():
        places = [(told[mark], looked[told[mark] or 0].only[mark]) for mark in DecimalMark]
        (one, row), (other, other_row) = ((column or 0, row) for column, row in places)
        raise DataFileError(
            f"column '{names[one]}' has a decimal point, as '{columns[one][row]}' in line {lines[row]}, and column"
            f" '{names[other]}' a decimal comma, as '{columns[other][other_row]}' in line {lines[other_row]}:"
            " write one of them throughout, or choose the columns that are read by --decimal point or comma",
            FileFault.MIXED_DECIMALS,
            column=names[other],
            line=lines[other_row],
            option="--decimal",
        )
    mark = asked or next((mark for mark in DecimalMark if told[mark] is not None), None)
    if mark is None:
        unclear = [at for at, column in enumerate(looked) if column.doubtful is not None and column.readings]
        commas = [at for at in unclear if any("," in cell for cell in columns[at])]
        if commas or (unclear and not is_point_usual):
            _refuse((commas or unclear)[0], looked, columns, names, lines)
        mark = DecimalMark.POINT
    grouped = [
        at
        for at, column in enumerate(looked)
        if mark in column.readings and any(mark.other.character in cell for cell in columns[at])
    ]
    for at in grouped:
        if asked is None and not _groups_throughout(columns[at], mark):
            _refuse(at, looked, columns, names, lines)
    misfits = {at: max(column.only.values()) for at, column in enumerate(looked) if column.is_mixed}
    misfits |= {
        at: column.only[mark.other]
        for at, column in enumerate(looked)
        if mark not in column.readings and mark.other in column.readings and mark.other in column.only
    }
    return Decimals(mark, tuple(grouped), misfits)


def _groups_throughout(cells: Sequence[str], mark: DecimalMark) -> bool:
    """Whether a column groups each number from 1000 on, and some cell shows that it is no decimal mark."""
    group, shown = mark.other.character, False
    for cell in cells:
        value = number(cell, mark)
        if value is None or value != value:
            continue
        if group not in cell and abs(value) >= 1000.0:
            return False
        shown |= cell.count(group) > 1 or mark.character in cell or (group not in cell and value != 0.0)
    return shown


def _refuse(
    at: int, looked: Sequence[_Column], columns: Sequence[Sequence[str]], names: Sequence[str], lines: Sequence[int]
) -> None:
    row = looked[at].doubtful or 0
    cell = columns[at][row]
    values = " or ".join(f"{number(cell, mark):.10g} with a decimal {mark}" for mark in DecimalMark)
    raise DataFileError(
        f"column '{names[at]}' holds '{cell}' in line {lines[row]}, which is {values}: say which by --decimal point or"
        " --decimal comma",
        FileFault.AMBIGUOUS_DECIMALS,
        column=names[at],
        line=lines[row],
        option="--decimal",
    )
