"""A report as PDF, set by typst from the report as data; characters that its fonts lack are named."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from importlib import resources
from typing import TYPE_CHECKING, Any

from backend.plain_text import escape_lines
from backend.reports.model import Block, Report

if TYPE_CHECKING:
    import typst


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
    checked, rest = asked[:MOST], asked[MOST:]
    pages = typst.compile(
        _TEMPLATE,
        format="svg",
        font_paths=typst.Fonts(include_system_fonts=False),
        sys_inputs={"letters": json.dumps([_NOBODYS, *checked])},
    )
    nothing, *drawn = pages
    return frozenset(letter for letter, page in zip(checked, drawn, strict=True) if page == nothing) | frozenset(rest)


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


def iterate_texts(document: Any) -> Iterable[str]:
    """Yield the texts of a document of mappings and lists, but for its drawings."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for name, part in document.items():
            if name != "svg":
                yield from iterate_texts(part)
    elif isinstance(document, list | tuple):
        for part in document:
            yield from iterate_texts(part)


# PDF -----------------------------------------------------------------------------------------------
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
    import typst  # takes its time to load

    template, inputs = typeset(report)
    moment = report.date.replace(microsecond=0)
    pdf: bytes = typst.compile(template, font_paths=fonts(), sys_inputs=inputs, timestamp=moment)
    return pdf


def typeset(report: Report) -> tuple[bytes, dict[str, str]]:
    """Return the template and its inputs, with the layout chosen.

    That is the first of ``_LAYOUTS`` at which the last page is more than half full, else the one that fills it most.
    """
    import typst  # takes its time to load

    document = {**asdict(report), "date": report.date.isoformat(), "evidence": ""}
    for section, plain in zip(report.sections, document["sections"], strict=True):
        plain["blocks"] = [{"kind": _kind(block), **asdict(block)} for block in section.blocks]
    template = resources.files("backend.reports").joinpath("report.typ").read_bytes()
    document = escape_document(document)
    missing = missing_letters(iterate_texts(document))
    missing_note = sentence(missing, "The report as a page (HTML) shows it.")
    data = json.dumps(with_boxes(document, missing) | {"missing": missing_note})
    filled: dict[tuple[float, float], float] = {}
    for layout in _LAYOUTS:
        inputs = _inputs(data, *layout)
        end = typst.query(template, "<end>", field="value", one=True, font_paths=fonts(), sys_inputs=inputs)
        filled[layout] = _measure_last_page(end)
        if filled[layout] >= _LEAST_FILLED:
            break
    return template, _inputs(data, *max(filled, key=lambda layout: filled[layout]))


def escape_document(document: Any) -> Any:
    """Return a document with escapes for what nobody sees, or what turns the text around."""
    if isinstance(document, dict):
        return {name: part if name == "svg" else escape_document(part) for name, part in document.items()}
    if isinstance(document, list | tuple):
        return [escape_document(part) for part in document]
    return escape_lines(document) if isinstance(document, str) else document


def fonts() -> "typst.Fonts":
    """Return the fonts that typst carries, and none of the machine."""
    import typst  # takes its time to load

    return typst.Fonts(include_system_fonts=False)


def _inputs(data: str, figure_width: float, row_inset: float) -> dict[str, str]:
    return {"data": data, "figure_width": str(figure_width), "row_inset": str(row_inset)}


def _measure_last_page(end: str) -> float:
    """Return the share of the last page down to where the text ends; 1 of a report of one page, which is short."""
    place = json.loads(end)
    return 1.0 if place["page"] == 1 else (place["y"] - _TOP_MM) / (_BOTTOM_MM - _TOP_MM)


def _kind(block: Block) -> str:
    return type(block).__name__.lower()
