"""A report as PDF, typeset by typst from the document model."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from importlib import resources
from typing import TYPE_CHECKING, Any

from backend.plain_text import escape_lines
from backend.reports import messages
from backend.reports.model import Block, Report

if TYPE_CHECKING:
    import typst


# Missing letters -----------------------------------------------------------------------------------
# Characters that the fonts of a PDF lack: the PDF shows a box for each and names them in a sentence.
#
# Only the fonts embedded in typst are used, so that a report looks the same everywhere. They have neither Chinese,
# Japanese and Korean characters nor emoji.


BOX = "\u25a1"
MOST = 5_000
"""Maximum number of distinct characters that are checked per document; any others count as missing."""

_NAMED = 30
"""Maximum number of missing characters that the sentence names."""

_NOBODYS = "\U0010ffff"
"""A character that no font has: any character drawn like it is missing as well."""

_TEMPLATE = b"""
#set page(width: 40pt, height: 40pt, margin: 4pt)
#set text(font: "Libertinus Serif")
#for letter in json(bytes(sys.inputs.letters)) { text(letter); pagebreak(weak: true) }
"""
_RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x391, 0x3A2), (0x3A3, 0x3CA))
_PLAIN = frozenset("\n").union(*(map(chr, range(*ends)) for ends in _RANGES))
"""Characters that the fonts have, as tests/reports/test_pdf.py checks."""


def missing_letters(texts: Iterable[str]) -> frozenset[str]:
    """Return the characters of texts that the fonts lack."""
    import typst  # slow to import

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
    """Return a document of mappings, lists and texts with boxes for ``missing``."""
    if isinstance(document, str):
        return document.translate(dict.fromkeys(map(ord, missing), BOX))
    if isinstance(document, dict):
        return {name: with_boxes(part, missing) for name, part in document.items()}
    return [with_boxes(part, missing) for part in document] if isinstance(document, list | tuple) else document


def sentence(missing: frozenset[str], elsewhere: str) -> str:
    """Return a sentence that names the characters shown as boxes.

    Returns "" if there are none. ``elsewhere`` says where they can be read.
    """
    if not missing:
        return ""
    return messages.characters_replaced(box=BOX, characters=missing, named=_NAMED, elsewhere=elsewhere)


def iterate_texts(document: Any) -> Iterable[str]:
    """Yield the texts of a document of mappings and lists, except its drawings."""
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
# A report as PDF, typeset by typst. The template reads the document as data, so that nothing in it acts as markup.


_LAYOUTS = (
    *((width, 2.6) for width in (1.0, 0.96, 0.92, 0.88, 0.84)),
    *((1.0, inset) for inset in (3.0, 3.4, 3.8, 4.2)),
    *((width, 2.2) for width in (0.96, 0.9, 0.84, 0.78)),
    *((0.88, inset) for inset in (3.0, 3.8, 4.6)),
)
"""Widths of figures as shares of the text width, and space above and below table rows [pt], in order of preference."""

_TOP_MM, _BOTTOM_MM = 22.0, 277.0
"""Top and bottom of the text area from the upper edge of the page [mm]: the margins of the template."""

_LEAST_FILLED = 0.55
"""Minimum filled share of the last page. The pages before it fill because figures float and tables break."""


def to_pdf(report: Report) -> bytes:
    """Return the PDF file. It uses only the fonts embedded in typst."""
    import typst  # slow to import

    template, inputs = typeset(report)
    moment = report.date.replace(microsecond=0)
    pdf: bytes = typst.compile(template, font_paths=fonts(), sys_inputs=inputs, timestamp=moment)
    return pdf


def typeset(report: Report) -> tuple[bytes, dict[str, str]]:
    """Return the template and its inputs, with a layout chosen.

    The layout is the first of ``_LAYOUTS`` that fills the last page to at least ``_LEAST_FILLED``, or else the one that
    fills it most.
    """
    import typst  # slow to import

    document = {**asdict(report), "date": report.date.isoformat(), "evidence": ""}
    for section, plain in zip(report.sections, document["sections"], strict=True):
        plain["blocks"] = [{"kind": _kind(block), **asdict(block)} for block in section.blocks]
    template = resources.files("backend.reports").joinpath("report.typ").read_bytes()
    document = escape_document(document)
    missing = missing_letters(iterate_texts(document))
    missing_note = sentence(missing, messages.html_report_shows_text())
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
    """Return a document with invisible and text-direction characters escaped."""
    if isinstance(document, dict):
        return {name: part if name == "svg" else escape_document(part) for name, part in document.items()}
    if isinstance(document, list | tuple):
        return [escape_document(part) for part in document]
    return escape_lines(document) if isinstance(document, str) else document


def fonts() -> "typst.Fonts":
    """Return the fonts embedded in typst, without those of the machine."""
    import typst  # slow to import

    return typst.Fonts(include_system_fonts=False)


def _inputs(data: str, figure_width: float, row_inset: float) -> dict[str, str]:
    return {"data": data, "figure_width": str(figure_width), "row_inset": str(row_inset)}


def _measure_last_page(end: str) -> float:
    """Return the filled share of the last page; 1 for a report of one page."""
    place = json.loads(end)
    return 1.0 if place["page"] == 1 else (place["y"] - _TOP_MM) / (_BOTTOM_MM - _TOP_MM)


def _kind(block: Block) -> str:
    return type(block).__name__.lower()
