"""Reports as PDF: letters that fonts lack, and full pages."""

import io
from collections.abc import Callable
from dataclasses import replace

import pytest
from pypdf import PdfReader

from backend.reports import messages, pdf
from backend.reports.build import build_report
from backend.reports.model import Code, Paragraph, Report, ReportSection, to_html
from backend.reports.pdf import BOX, missing_letters, sentence, to_pdf, with_boxes
from backend.reports.run_data import RunData
from backend.reports.sheet import render_sheet_pdf
from tests.reports.pages import filled_shares
from tests.reports.test_identification_report import PLAYED, identification
from tests.reports.test_identification_report import source as actuator_source
from tests.reports.test_other_reports import compliance_source
from tests.reports.tracking_run import PLAN, samples, source_of

# Letters that the fonts of a PDF lack become boxes, and a sentence lists them.

TITLE = "阻抗 λ 測試 😀"
THERE = "aäλφЖعﻉ−≈′₂²·…“”"


def test_available_letters_are_not_reported_as_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert missing_letters([THERE, "λ_q′"]) == set()
    plain = "".join(pdf._PLAIN - {"\n"})
    monkeypatch.setattr(pdf, "_PLAIN", frozenset("\n"))
    assert missing_letters([plain]) == set()
    assert missing_letters([TITLE, THERE]) == set("阻抗測試😀")


def test_letters_missing_from_all_fonts_are_replaced_by_boxes() -> None:
    assert missing_letters([TITLE, THERE]) == set("阻抗測試😀")
    assert missing_letters([BOX]) == set()
    assert with_boxes({"a": [TITLE, 1.5]}, missing_letters([TITLE])) == {"a": ["□□ λ □□ □", 1.5]}
    assert sentence(frozenset(), "x") == ""
    assert "U+1F600" in sentence(frozenset("😀"), "x")
    many = frozenset(map(chr, range(0x4E00, 0x4E00 + 100)))
    assert "U+4E1D and 70 more" in sentence(many, "x")


def printed(pdf: bytes) -> str:
    return " ".join(" ".join(page.extract_text().split()) for page in PdfReader(io.BytesIO(pdf)).pages)


def test_the_report_lists_the_letters_missing_from_its_pdf() -> None:
    report = build_report(source_of(samples(PLAN)))
    assert BOX not in printed(to_pdf(report))
    report = replace(report, title=TITLE)
    read = printed(to_pdf(report))
    assert "□□ λ □□ □" in read
    assert "U+1F600" in read
    assert "U+963B" in read
    assert TITLE in to_html(report)


def test_a_chart_sheet_lists_its_missing_letters() -> None:
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450" font-size="12">'
    read = printed(render_sheet_pdf(f'{head}<text x="9" y="40">{TITLE}</text></svg>'))
    where = messages.sheet_as_svg_shows_text()
    assert "U+1F600" in read
    assert sentence(missing_letters([TITLE]), where) in read
    assert where not in printed(render_sheet_pdf(f'{head}<text x="9" y="40">λ_q</text></svg>'))


# No page of a PDF is more than half empty, for reports of all kinds.


def session() -> RunData:
    tracked = source_of(samples(PLAN))
    settings = {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.09, "b": 0.7, "interpolate": False}}
    return RunData(replace(tracked.run, kind="session", settings=settings), None, tracked.columns, None)


KINDS: dict[str, Callable[[], RunData]] = {
    "tracking": lambda: source_of(samples(PLAN)),
    "tracking with a bank": lambda: source_of(samples(PLAN), bank=True, note="a note"),
    "compliance": compliance_source,
    "actuator identification": lambda: actuator_source(identification(), PLAYED),
    "session": session,
}


@pytest.mark.parametrize("kind", KINDS)
def test_no_page_is_more_than_half_empty(kind: str) -> None:
    report = build_report(KINDS[kind]())
    shares = filled_shares(report)
    assert len(shares) == len(PdfReader(io.BytesIO(to_pdf(report))).pages)
    assert min(shares) >= 0.5, shares


def test_the_page_measurement_detects_an_empty_page(tracking_source: RunData) -> None:
    """A last page with two lines is detected, so the test above can fail."""
    report = build_report(tracking_source)
    line = Paragraph("One line.")
    short = Report(**{**vars(report), "sections": (ReportSection("Short", (line,)),)})
    assert max(filled_shares(short)) < 0.5


def test_code_blocks_are_typeset_literally(tracking_source: RunData) -> None:
    """Page and PDF do not convert symbols, quotes or dashes in code blocks."""
    report = build_report(tracking_source)
    text = "sinew experiment tracking --set 'q_ref=-0.5' \\\n  --set lam_q=0.5 --set K=1e-05 # S_ref \"q\" -- fi"
    coded = Report(**{**vars(report), "sections": (ReportSection("Code", (Code("To copy q:", text),)),)})
    printed = "\n".join(page.extract_text() for page in PdfReader(io.BytesIO(to_pdf(coded))).pages)
    assert [line.strip() for line in text.splitlines()] == [
        line.strip() for line in printed[printed.index("sinew experiment") :].splitlines()[:2]
    ]
