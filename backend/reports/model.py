"""The document model of a report, and its rendering as HTML."""

import html
import re
from dataclasses import dataclass
from datetime import datetime
from importlib import resources

from backend.plain_text import escape_lines
from backend.units import format_percent

# Document ------------------------------------------------------------------------------------------
# A report as plain data in reading order. HTML and PDF are two renderings of the same document.
#
# Text may contain symbols in the spelling of the notation, ``S_ref``; the renderings set them as letter and index.


@dataclass(frozen=True)
class Fact:
    """One line of the heading: label and text; ``quoted`` marks words of a person."""

    label: str
    text: str
    quoted: bool = False


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Numbers are aligned right. A ``wide`` column takes the remaining width. A ``quoted`` column holds words of a person.
    """

    title: str
    unit: str = ""
    number: bool = True
    wide: bool = False
    quoted: bool = False


@dataclass(frozen=True)
class Table:
    """A table of text cells; each row has as many cells as there are columns."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Figure:
    """An SVG drawing with its caption; ``name`` is unique within the report."""

    name: str
    svg: str
    caption: str


@dataclass(frozen=True)
class Code:
    """Lines to copy, in a fixed-width font; ``caption`` says what they are for."""

    caption: str
    text: str


Block = Paragraph | Table | Figure | Code


@dataclass(frozen=True)
class ReportSection:
    """A heading and the blocks below it."""

    heading: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report.

    ``outcome`` is passed, failed, incomplete or neutral; ``verdict`` says it in a sentence. ``date`` is that of the
    run, so that the same run always gives the same report. ``evidence`` is the manifest element for verification by
    programs.
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
"""Text of a table cell without a figure; the caption of the table explains it."""


def format_measured(value: float | None, digits: int = 3) -> str:
    """Format a measured number to significant digits; a dash for None and NaN.

    Integer digits are kept up to five.
    """
    if value is None or value != value:
        return NO_FIGURE
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if not -4 <= int(exponent) < 5:
        return f"{mantissa}·10^{int(exponent)}".replace("-", "−")
    return f"{value:.{max(0, digits - 1 - int(exponent))}f}".replace("-", "−")


def share(value: float | None) -> str:
    """Format a fit in %; a fit below 100 % is never rounded to "100"."""
    return format_measured(value) if value is None or not 99.0 < value < 100.0 else format_percent(value)


def exact(value: float) -> str:
    """Format a chosen number: up to six significant digits, no trailing zeros."""
    return f"{value:.6g}".replace("-", "−")


# HTML ----------------------------------------------------------------------------------------------
# A report as one HTML page that loads nothing from elsewhere and is readable on screen and on paper.


_SYMBOL = r"\b(?P<letter>[A-Za-zθλ])_(?P<index>[A-Za-z0-9]+(?:,ref)?)(?P<hat>_hat)?\b|·10\^(?P<power>−?\d+)"
_SYMBOLS = re.compile(_SYMBOL)
_SIZES = 1, 2, 4, 8
"""Zoom factors of a figure; ``report.css`` has a rule for each."""
_SYMBOLS_AND_LETTERS = re.compile(_SYMBOL + r"|\b(?P<lone>[qSKTλ])\b")


def escape(text: str) -> str:
    """Return a text as HTML, with invisible characters escaped.

    Characters that change the direction of text are escaped as well.
    """
    return html.escape(escape_lines(text))


def to_html(report: Report) -> str:
    """Return the HTML page."""
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
    """Return a drawing with a choice of zoom factors that works without scripts."""
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
    """Escape text and set symbols as letter and index, powers of ten raised."""
    return _typeset_symbols(text, _SYMBOLS)


def _prose(text: str) -> str:
    """Like ``_text``, and set single letters as symbols.

    Not for text that contains names of people.
    """
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
