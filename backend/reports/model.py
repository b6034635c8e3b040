"""A report as plain data, and its renderings as HTML and PDF."""

import html
import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib import resources
from typing import Any

import typst

from backend.plain_text import as_lines
from backend.units import percent

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


# Html ----------------------------------------------------------------------------------------------
#
# A report as one HTML page: nothing loaded from elsewhere, readable on screen and on paper.


_SYMBOL = r"\b(?P<letter>[A-Za-zθλ])_(?P<index>[A-Za-z0-9]+(?:,ref)?)(?P<hat>_hat)?\b|·10\^(?P<power>−?\d+)"
_SYMBOLS = re.compile(_SYMBOL)
_SIZES = 1, 2, 4, 8
"""How many times as large a figure can be looked at; ``report.css`` has a rule for each."""
_SYMBOLS_AND_LETTERS = re.compile(_SYMBOL + r"|\b(?P<lone>[qSKTλ])\b")


def escape(text: str) -> str:
    """Return a text as HTML; what nobody sees, or what turns the text around, is written as an escape."""
    return html.escape(as_lines(text))


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
    return _set(text, _SYMBOLS)


def _prose(text: str) -> str:
    """Like ``_text``; lone letters are symbols too. For text in which no person's name stands."""
    return _set(text, _SYMBOLS_AND_LETTERS)


def _set(text: str, symbols: re.Pattern[str]) -> str:
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


# Missing letters -----------------------------------------------------------------------------------
#
# Letters that the fonts of a PDF do not have: the PDF shows a box for each, and says in a sentence
# which they are.
#
# Only fonts that typst carries are used, so that a report looks the same everywhere; they have
# neither Chinese, Japanese and Korean letters nor emoji.


BOX = "\u25a1"
MOST = 5_000
"""Different letters of one document that are looked at; what is beyond them is taken for missing."""

_NAMED = 30
"""Missing letters that the sentence names."""

_NOBODYS = "\U0010ffff"
"""Has no letter in any font: whatever is drawn like it has none either."""

_TEMPLATE = b"""
#set page(width: 40pt, height: 40pt, margin: 4pt)
#set text(font: "Libertinus Serif")
#for letter in json(bytes(sys.inputs.letters)) { text(letter); pagebreak(weak: true) }
"""
_RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x391, 0x3A2), (0x3A3, 0x3CA))
_PLAIN = frozenset("\n").union(*(map(chr, range(*ends)) for ends in _RANGES))
"""Letters that the fonts have, as tests/reports/test_missing_letters.py sees."""


def missing_letters(texts: Iterable[str]) -> frozenset[str]:
    """Return the letters of texts that the fonts do not have."""
    import typst  # takes its time to load

    asked = sorted(set[str]().union(*texts) - _PLAIN)
    if not asked:
        return frozenset()
    looked_at, rest = asked[:MOST], asked[MOST:]
    pages = typst.compile(
        _TEMPLATE,
        format="svg",
        font_paths=typst.Fonts(include_system_fonts=False),
        sys_inputs={"letters": json.dumps([_NOBODYS, *looked_at])},
    )
    nothing, *drawn = pages
    return frozenset(letter for letter, page in zip(looked_at, drawn, strict=True) if page == nothing) | frozenset(rest)


def with_boxes(document: Any, missing: frozenset[str]) -> Any:
    """Return a document of mappings, lists and texts with a box for each letter that is missing."""
    if isinstance(document, str):
        return document.translate(dict.fromkeys(map(ord, missing), BOX))
    if isinstance(document, dict):
        return {name: with_boxes(part, missing) for name, part in document.items()}
    return [with_boxes(part, missing) for part in document] if isinstance(document, list | tuple) else document


def sentence(missing: frozenset[str], elsewhere: str) -> str:
    """Return which letters are boxes, and where they can be read; "" where none are."""
    if not missing:
        return ""
    codes = [f"U+{ord(letter):04X}" for letter in sorted(missing)]
    more = f" and {len(codes) - _NAMED} more" if len(codes) > _NAMED else ""
    named = f"{', '.join(codes[:_NAMED])}{more}"
    return f"{BOX} stands for a character that the fonts of this PDF do not have: {named}. {elsewhere}"


def texts_of(document: Any) -> Iterable[str]:
    """Yield the texts of a document of mappings and lists, but for its drawings."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for name, part in document.items():
            if name != "svg":
                yield from texts_of(part)
    elif isinstance(document, list | tuple):
        for part in document:
            yield from texts_of(part)


# Pdf -----------------------------------------------------------------------------------------------
#
# A report as PDF, set by typst. The template reads the document as data, so nothing in it is ever
# markup.


_LAYOUTS = (
    *((width, 2.6) for width in (1.0, 0.96, 0.92, 0.88, 0.84)),
    *((1.0, inset) for inset in (3.0, 3.4, 3.8, 4.2)),
    *((width, 2.2) for width in (0.96, 0.9, 0.84, 0.78)),
    *((0.88, inset) for inset in (3.0, 3.8, 4.6)),
)
"""Widths of figures, as shares of the text's width, and space above and below the rows of tables [pt]; best first."""

_TOP_MM, _BOTTOM_MM = 22.0, 277.0
"""Where the text of a page begins and ends, from its upper edge: the margins of the template."""

_LEAST_FILLED = 0.55
"""Share of the last page that is to be filled; the pages before it fill as figures float and tables break."""


def to_pdf(report: Report) -> bytes:
    """Return the PDF file; only fonts that typst carries are used, so that it looks the same everywhere."""
    template, inputs = typeset(report)
    moment = report.date.replace(microsecond=0)
    pdf: bytes = typst.compile(template, font_paths=fonts(), sys_inputs=inputs, timestamp=moment)
    return pdf


def typeset(report: Report) -> tuple[bytes, dict[str, str]]:
    """Return the template and its inputs, with the layout chosen.

    That is the first of ``_LAYOUTS`` at which the last page is more than half full, else the one that fills it most.
    """
    document = {**asdict(report), "date": report.date.isoformat(), "evidence": ""}
    for section, plain in zip(report.sections, document["sections"], strict=True):
        plain["blocks"] = [{"kind": _kind(block), **asdict(block)} for block in section.blocks]
    template = resources.files("backend.reports").joinpath("report.typ").read_bytes()
    document = escaped(document)
    missing = missing_letters(texts_of(document))
    missing_said = sentence(missing, "The report as a page (HTML) shows it.")
    data = json.dumps(with_boxes(document, missing) | {"missing": missing_said})
    filled: dict[tuple[float, float], float] = {}
    for layout in _LAYOUTS:
        inputs = _inputs(data, *layout)
        end = typst.query(template, "<end>", field="value", one=True, font_paths=fonts(), sys_inputs=inputs)
        filled[layout] = _filled(end)
        if filled[layout] >= _LEAST_FILLED:
            break
    return template, _inputs(data, *max(filled, key=lambda layout: filled[layout]))


def escaped(document: Any) -> Any:
    """Return a document with escapes for what nobody sees, or what turns the text around."""
    if isinstance(document, dict):
        return {name: part if name == "svg" else escaped(part) for name, part in document.items()}
    if isinstance(document, list | tuple):
        return [escaped(part) for part in document]
    return as_lines(document) if isinstance(document, str) else document


def fonts() -> typst.Fonts:
    """Return the fonts that typst carries, and none of the machine."""
    return typst.Fonts(include_system_fonts=False)


def _inputs(data: str, figure_width: float, row_inset: float) -> dict[str, str]:
    return {"data": data, "figure_width": str(figure_width), "row_inset": str(row_inset)}


def _filled(end: str) -> float:
    """Return the share of the last page down to where the text ends; 1 of a report of one page, which is short."""
    place = json.loads(end)
    return 1.0 if place["page"] == 1 else (place["y"] - _TOP_MM) / (_BOTTOM_MM - _TOP_MM)


def _kind(block: Block) -> str:
    return type(block).__name__.lower()
