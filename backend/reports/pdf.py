"""A report as PDF, set by typst. The template reads the document as data, so nothing in it is ever markup."""

import json
from dataclasses import asdict
from importlib import resources
from typing import Any

import typst

from backend.plain_text import as_lines
from backend.reports.document import Block, Report
from backend.reports.missing_letters import missing_letters, sentence, texts_of, with_boxes

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
