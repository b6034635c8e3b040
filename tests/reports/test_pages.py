"""No page of a PDF is more than half empty, in a report of any kind."""

import io
from collections.abc import Callable
from dataclasses import replace

import pytest
from pypdf import PdfReader

from backend.reports.build import build_report
from backend.reports.model import Code, Paragraph, Report, ReportSection
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData
from tests.reports.pages import filled_shares
from tests.reports.test_identification_report import PLAYED, identification
from tests.reports.test_identification_report import source as actuator_source
from tests.reports.test_other_reports import compliance_source
from tests.reports.tracking_run import PLAN, samples, source_of


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


def test_what_is_measured_sees_an_empty_page(tracking_source: RunData) -> None:
    """Two lines on the last page are seen as such: the measure of the test above can fail."""
    report = build_report(tracking_source)
    line = Paragraph("One line.")
    short = Report(**{**vars(report), "sections": (ReportSection("Short", (line,)),)})
    assert max(filled_shares(short)) < 0.5


def test_code_is_set_as_it_is(tracking_source: RunData) -> None:
    """No symbol, no quote and no dash of a block to copy becomes another one, in the PDF as in the page."""
    report = build_report(tracking_source)
    text = "sinew experiment tracking --set 'q_ref=-0.5' \\\n  --set lam_q=0.5 --set K=1e-05 # S_ref \"q\" -- fi"
    coded = Report(**{**vars(report), "sections": (ReportSection("Code", (Code("To copy q:", text),)),)})
    printed = "\n".join(page.extract_text() for page in PdfReader(io.BytesIO(to_pdf(coded))).pages)
    assert [line.strip() for line in text.splitlines()] == [
        line.strip() for line in printed[printed.index("sinew experiment") :].splitlines()[:2]
    ]
