"""A report as plain data: what it says, in order. HTML and PDF are two renderings of the same document.

Text may hold symbols in the spelling of the notation, ``S_ref``; the renderings set them as letter and index.
"""

from dataclasses import dataclass
from datetime import datetime

from backend.units import percent


@dataclass(frozen=True)
class Fact:
    """One line of the heading: a label and what it says; what is ``quoted`` are a person's own words."""

    label: str
    text: str
    quoted: bool = False


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class Column:
    """A column of a table; numbers are set flush right; a wide column takes the room that the others leave.

    In a ``quoted`` one stand a person's own words.
    """

    title: str
    unit: str = ""
    number: bool = True
    wide: bool = False
    quoted: bool = False


@dataclass(frozen=True)
class Table:
    """Cells as text, row by row, as many as there are columns."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Figure:
    """An SVG drawing with its caption; ``name`` tells it from the others of the report."""

    name: str
    svg: str
    caption: str


@dataclass(frozen=True)
class Code:
    """Lines to copy, set in a fixed-width font letter by letter; ``caption`` says what they are for."""

    caption: str
    text: str


Block = Paragraph | Table | Figure | Code


@dataclass(frozen=True)
class Section:
    """A heading and what follows it."""

    heading: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report.

    ``outcome`` is passed, failed, incomplete or neutral; ``verdict`` says it in a sentence; ``date`` is the run's, so
    that the same run always gives the same report. ``evidence`` is what the page carries for programs to verify it by.
    """

    title: str
    subtitle: str
    outcome: str
    verdict: str
    facts: tuple[Fact, ...]
    sections: tuple[Section, ...]
    footer: str
    date: datetime
    evidence: str = ""


NO_FIGURE = "–"
"""Stands in a table where there is no figure; the table's caption says what it means."""


def shown(value: float | None, digits: int = 3) -> str:
    """Write a measured number with so many significant digits (whole ones are all kept); a dash stands for none."""
    if value is None or value != value:
        return NO_FIGURE
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if not -4 <= int(exponent) < 5:
        return f"{mantissa}·10^{int(exponent)}".replace("-", "−")
    return f"{value:.{max(0, digits - 1 - int(exponent))}f}".replace("-", "−")


def share(value: float | None) -> str:
    """Write a fit in %: never "100" of less."""
    return shown(value) if value is None or not 99.0 < value < 100.0 else percent(value)


def exact(value: float) -> str:
    """Write a number that somebody chose: up to six significant digits, no trailing zeros."""
    return f"{value:.6g}".replace("-", "−")
