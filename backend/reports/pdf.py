"""A report as PDF, set by typst. The template reads the document as data, so nothing in it is ever markup."""

import json
from dataclasses import asdict
from importlib import resources

import typst

from backend.reports.document import Block, Report


def to_pdf(report: Report) -> bytes:
    """Return the PDF file; only fonts that typst carries are used, so that it looks the same everywhere."""
    document = {**asdict(report), "date": report.date.isoformat(), "evidence": ""}
    for section, plain in zip(report.sections, document["sections"], strict=True):
        plain["blocks"] = [{"kind": _kind(block), **asdict(block)} for block in section.blocks]
    template = resources.files("backend.reports").joinpath("report.typ").read_bytes()
    fonts = typst.Fonts(include_system_fonts=False)
    inputs = {"data": json.dumps(document)}
    pdf: bytes = typst.compile(
        template, font_paths=fonts, sys_inputs=inputs, timestamp=report.date.replace(microsecond=0)
    )
    return pdf


def _kind(block: Block) -> str:
    return type(block).__name__.lower()
