"""What the fonts of a PDF do not have becomes a box that a sentence explains; nothing is left out without a word."""

import io
from dataclasses import replace

import pytest
from pypdf import PdfReader

from backend.reports import pdf
from backend.reports.build import build_report
from backend.reports.model import to_html
from backend.reports.pdf import BOX, missing_letters, sentence, to_pdf, with_boxes
from backend.reports.sheet import render_sheet_pdf
from tests.reports.tracking_run import PLAN, samples, source_of

TITLE = "阻抗 λ 測試 😀"
THERE = "aäλφЖعﻉ−≈′₂²·…“”"


def test_letters_that_the_fonts_have_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    assert missing_letters([THERE, "λ_q′"]) == set()
    plain = "".join(pdf._PLAIN - {"\n"})
    monkeypatch.setattr(pdf, "_PLAIN", frozenset("\n"))
    assert missing_letters([plain]) == set()
    assert missing_letters([TITLE, THERE]) == set("阻抗測試😀")


def test_letters_that_no_font_has_are_boxes() -> None:
    assert missing_letters([TITLE, THERE]) == set("阻抗測試😀")
    assert missing_letters([BOX]) == set()
    assert with_boxes({"a": [TITLE, 1.5]}, missing_letters([TITLE])) == {"a": ["□□ λ □□ □", 1.5]}
    assert sentence(frozenset(), "x") == ""
    assert "U+1F600" in sentence(frozenset("😀"), "x")
    many = frozenset(map(chr, range(0x4E00, 0x4E00 + 100)))
    assert "U+4E1D and 70 more" in sentence(many, "x")


def printed(pdf: bytes) -> str:
    return " ".join(" ".join(page.extract_text().split()) for page in PdfReader(io.BytesIO(pdf)).pages)


def test_a_report_says_which_letters_its_pdf_lacks() -> None:
    report = build_report(source_of(samples(PLAN)))
    assert BOX not in printed(to_pdf(report))
    report = replace(report, title=TITLE)
    read = printed(to_pdf(report))
    assert "□□ λ □□ □" in read
    assert "U+1F600" in read
    assert "U+963B" in read
    assert TITLE in to_html(report)


def test_a_sheet_says_which_letters_it_lacks() -> None:
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450" font-size="12">'
    read = printed(render_sheet_pdf(f'{head}<text x="9" y="40">{TITLE}</text></svg>'))
    assert "U+1F600" in read
    assert "fonts of this PDF" in read
    assert "fonts of this PDF" not in printed(render_sheet_pdf(f'{head}<text x="9" y="40">λ_q</text></svg>'))
