"""A sheet of charts sent to be printed: whoever is signed in gets a PDF; what is no sheet, or too large, gets words."""

import io

import httpx
from pypdf import PdfReader

from backend.server.security import MAX_BODY_BYTES, MAX_SHEET_BYTES, SHEETS
from tests.e2e.service import Service

FOOT = "run 3 · SIM · λ_q 0.5 s"


def sheet(inside: str = "") -> dict[str, str]:
    root = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450">'
    return {"svg": f'{root}<text x="16" y="430">{FOOT}</text>{inside}</svg>'}


def test_a_sheet_comes_back_as_a_pdf_to_be_saved(viewer: httpx.Client) -> None:
    points = "".join(f"L{column % 900} {column % 430}" for column in range(MAX_BODY_BYTES // 7))
    body = sheet(f'<path d="M0 0{points}" fill="none" stroke="#0072B2"/>')
    assert len(body["svg"]) > MAX_BODY_BYTES  # many curves are more than other bodies may be
    answer = viewer.post(SHEETS, json=body)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/pdf"
    assert answer.headers["content-disposition"] == 'attachment; filename="sinew-charts.pdf"'
    (page,) = PdfReader(io.BytesIO(answer.content)).pages
    assert FOOT in page.extract_text()


def test_what_is_no_sheet_is_refused_in_words(operator: httpx.Client) -> None:
    answer = operator.post(SHEETS, json=sheet("<script>fetch('/api/stop')</script>"))
    assert answer.status_code == 422
    problem = answer.json()["error"]
    assert problem["code"] == "not_a_sheet"
    assert problem["message"].startswith("this is no sheet of charts: it has an element <script>; allowed in a sheet")


def test_a_sheet_that_is_too_large_is_refused_before_it_is_read(operator: httpx.Client) -> None:
    answer = operator.post(SHEETS, content=b"x" * (MAX_SHEET_BYTES + 1))
    assert answer.status_code == 413
    assert f"larger than {MAX_SHEET_BYTES} bytes" in answer.json()["error"]["message"]
    elsewhere = operator.put("/api/preferences", content=b"x" * (MAX_BODY_BYTES + 1))
    assert elsewhere.status_code == 413


def test_nobody_else_gets_one(service: Service) -> None:
    assert httpx.post(f"{service.url}{SHEETS}", json=sheet()).status_code == 401
