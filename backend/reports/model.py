"""A report as plain data, and its renderings as HTML and PDF."""

import html
import re
from dataclasses import dataclass
from datetime import datetime
from importlib import resources

from backend.plain_text import escape_lines
from backend.units import format_percent

# Document ------------------------------------------------------------------------------------------
#
# A report as plain data: what it says, in order. HTML and PDF are two renderings of the same
# document.
#
# Text may hold symbols in the spelling of the notation, ``S_ref``; the renderings set them as
# letter and index.


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
class ReportSection:
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
    sections: tuple[ReportSection, ...]
    footer: str
    date: datetime
    evidence: str = ""


NO_FIGURE = "–"
"""Stands in a table where there is no figure; the table's caption says what it means."""


def format_measured(value: float | None, digits: int = 3) -> str:
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
    return format_measured(value) if value is None or not 99.0 < value < 100.0 else format_percent(value)


def exact(value: float) -> str:
    """Write a number that somebody chose: up to six significant digits, no trailing zeros."""
    return f"{value:.6g}".replace("-", "−")


# HTML ----------------------------------------------------------------------------------------------
#
# A report as one HTML page: nothing loaded from elsewhere, readable on screen and on paper.


_SYMBOL = r"\b(?P<letter>[A-Za-zθλ])_(?P<index>[A-Za-z0-9]+(?:,ref)?)(?P<hat>_hat)?\b|·10\^(?P<power>−?\d+)"
_SYMBOLS = re.compile(_SYMBOL)
_SIZES = 1, 2, 4, 8
"""How many times as large a figure can be looked at; ``report.css`` has a rule for each."""
_SYMBOLS_AND_LETTERS = re.compile(_SYMBOL + r"|\b(?P<lone>[qSKTλ])\b")


def escape(text: str) -> str:
    """Return a text as HTML; what nobody sees, or what turns the text around, is written as an escape."""
    return html.escape(escape_lines(text))


def to_html(report: Report) -> str:
    """Return the page."""
    style = resources.files("backend.reports").joinpath("report.css").read_text(encoding="utf-8")
    facts = "".join(f"<dt>{_text(fact.label)}</dt><dd>{_text(fact.text)}</dd>" for fact in report.facts)
    numbering = _Numbering()
    sections = "\n".join(_section(section, numbering) for section in report.sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(report.title)} – {escape(report.subtitle)}</title>
<style>
{style}</style>
</head>
<body>
<header>
<h1>{_text(report.title)}</h1>
<p class="subtitle">{_text(report.subtitle)}</p>
<p class="verdict {escape(report.outcome)}">{_text(report.verdict)}</p>
<dl>{facts}</dl>
</header>
<main>
{sections}
</main>
<footer>{_text(report.footer)}</footer>
{report.evidence}
</body>
</html>
"""


class _Numbering:
    def __init__(self) -> None:
        self.tables = 0
        self.figures = 0


def _section(section: ReportSection, numbering: _Numbering) -> str:
    blocks = "\n".join(_block(block, numbering) for block in section.blocks)
    return f"<section>\n<h2>{_prose(section.heading)}</h2>\n{blocks}\n</section>"


def _block(block: Block, numbering: _Numbering) -> str:
    match block:
        case Paragraph(text):
            return f"<p>{_prose(text)}</p>"
        case Table():
            numbering.tables += 1
            return _table(block, numbering.tables)
        case Figure(_, svg, caption):
            numbering.figures += 1
            return _figure(svg, caption, numbering.figures)
        case Code(caption, text):
            return f'<p class="code">{_prose(caption)}</p>\n<pre tabindex="0"><code>{escape(text)}</code></pre>'


def _figure(svg: str, caption: str, number: int) -> str:
    """Return a drawing that can be looked at closely: a page that runs no script zooms by the choice of a size."""
    drawing = svg.replace("<svg ", f'<svg role="img" aria-label="{escape(caption)}" ', 1)
    sizes = "".join(
        f'<label><input type="radio" name="size-{number}" value="{size}"{" checked" if size == 1 else ""}>'
        f"<span>{size}×</span></label>"
        for size in _SIZES
    )
    choice = f'<fieldset class="sizes"><legend>Size of figure {number}</legend>{sizes}</fieldset>'
    sheet = f'<div class="sheet" tabindex="0" role="region" aria-label="Figure {number}">\n{drawing}\n</div>'
    words = f"<figcaption><b>Figure {number}.</b> {_prose(caption)}</figcaption>"
    return f"<figure>\n{choice}\n{sheet}\n{words}\n</figure>"


def _table(table: Table, number: int) -> str:
    kinds = ["number" if column.number else "text" for column in table.columns]
    titles = [f"{column.title} [{column.unit}]" if column.unit else column.title for column in table.columns]
    head = "".join(
        f'<th scope="col" class="{kind}">{_prose(title)}</th>' for kind, title in zip(kinds, titles, strict=True)
    )
    body = "\n".join(
        "<tr>"
        + "".join(f'<td class="{kind}">{_prose(cell)}</td>' for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in table.rows
    )
    caption = f"<caption><b>Table {number}.</b> {_prose(table.caption)}</caption>"
    rows = f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>"
    return f'<div class="table"><table>\n{caption}\n{rows}\n</table></div>'


def _text(text: str) -> str:
    """Escape text and set symbols in it as letter and index, powers of ten raised."""
    return _typeset_symbols(text, _SYMBOLS)


def _prose(text: str) -> str:
    """Like ``_text``; lone letters are symbols too. For text in which no person's name stands."""
    return _typeset_symbols(text, _SYMBOLS_AND_LETTERS)


def _typeset_symbols(text: str, symbols: re.Pattern[str]) -> str:
    parts, end = [], 0
    for found in symbols.finditer(text):
        parts += [escape(text[end : found.start()]), _symbol(found.groupdict())]
        end = found.end()
    return "".join([*parts, escape(text[end:])])


def _symbol(found: dict[str, str | None]) -> str:
    if found["power"]:
        return f"·10<sup>{found['power']}</sup>"
    if found["letter"]:
        hat = "\N{COMBINING CIRCUMFLEX ACCENT}" if found["hat"] else ""
        return f"<i>{found['letter']}{hat}</i><sub>{found['index']}</sub>"
    return f"<i>{found['lone']}</i>"
