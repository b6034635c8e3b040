"""Dates and times of day as people and instruments write them, to seconds from the first one on.

No library's parser is asked: each of them guesses what a missing part or an ambiguous order means.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from backend.identification.errors import DataFileError, FileFault
from backend.identification.record import Signal

DAY_FIRST, MONTH_FIRST = "dmy", "mdy"
"""What says which of 03/04/2026 is the day, in place of a unit."""
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
    """Seconds from the first date on, shape (n,), and in which form the dates are written."""

    seconds: Signal
    form: str
    has_zone: bool


def read_dates(name: str, texts: Sequence[str], order: str | None = None) -> Dates:
    """Read a column of dates; ``order`` is DAY_FIRST or MONTH_FIRST where 03/04/2026 needs it.

    Raises DataFileError for what is no date, for forms or zones that change, and for an order that cannot be told.
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
            f"some dates of the time column '{name}' have an offset from UTC and some have none, as '{cells[row]}':"
            " write all of them in one zone",
            FileFault.DATES,
            column=name,
        )
    day_of = _day_of(name, form, matches, order)
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
    return DataFileError(
        f"the time column '{name}' holds '{cell}' in row {row + 1}: write numbers, or dates of one form like"
        " 2026-03-04T10:20:30.125",
        FileFault.DATES,
        column=name,
    )


def _day_of(
    name: str, form: str, matches: Sequence[re.Match[str]], order: str | None
) -> Callable[[re.Match[str]], int]:
    """Return what gives the number of the day of a date."""
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
            f"in '{matches[0].string}' of the time column '{name}' day and month cannot be told apart: say which comes"
            f" first by --time-unit {DAY_FIRST} or {MONTH_FIRST}",
            FileFault.DATES,
            column=name,
            option="--time-unit",
        )
    if order == DAY_FIRST or (order is None and is_day_first):
        return lambda match: _ordinal(match["year"], match["other"], match["one"])
    return lambda match: _ordinal(match["year"], match["one"], match["other"])


@cache
def _ordinal(year: str, month: str | int, day: str) -> int:
    """Days since 1970. Raises ValueError for a day that does not exist."""
    return int(np.datetime64(f"{year}-{int(month):02d}-{int(day):02d}", "D").astype(np.int64))


def _of_day_ns(match: re.Match[str]) -> int:
    """Nanoseconds from midnight in UTC on, or in the zone that the dates leave out. Raises ValueError."""
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
