"""Whether the report of a series holds: each of its runs is computed again from where it is stored, then the page."""

from collections.abc import Callable
from dataclasses import replace

from backend.recording.reader import Columns
from backend.reports.differences import Verified
from backend.reports.evidence import Evidence, EvidenceError, SeriesEvidence
from backend.reports.html import to_html
from backend.reports.page_comparison import compare_pages
from backend.reports.series import series_report
from backend.reports.verification import computed_again, joined
from backend.storage.runs import RunKind


def verify_series(page: str, evidence: SeriesEvidence, find: Callable[[Evidence], Columns | None]) -> Verified:
    """Compare the accounts of a series with the samples that ``find`` has of each run, and its page with one made anew.

    Raises EvidenceError where the samples of a run are not there.
    """
    if len(evidence.runs) < 2 or any(one.run.kind == RunKind.SESSION for one in evidence.runs):
        raise EvidenceError("its account is of no series: that is of two runs or more, none of them a session")
    found, sources = [], []
    for one in evidence.runs:
        columns = find(one)
        if columns is None:
            raise EvidenceError(f"the samples of its run {one.run.id} are not here: name the folder with its runs")
        again, source = computed_again(one, columns)
        found.append(_of_run(one.run.id, again))
        if source is not None:
            sources.append(source)
    if len(sources) == len(evidence.runs):
        found.append(compare_pages(page, evidence, lambda: to_html(series_report(sources))))
    return joined(*found)


def _of_run(number: int, again: Verified) -> Verified:
    differences = tuple(replace(one, name=f"run {number}, {one.name}") for one in again.differences)
    return replace(again, differences=differences, left_out=tuple(f"run {number}, {one}" for one in again.left_out))
