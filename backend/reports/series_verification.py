"""Whether the report of a series holds: each of its runs is computed again from where it is stored, then the page."""

from collections.abc import Callable
from dataclasses import replace

from backend.recording.columns import Columns
from backend.reports.evidence import Evidence, EvidenceError, SeriesEvidence
from backend.reports.html import to_html
from backend.reports.series import series_report
from backend.reports.verification import MOST, Difference, Verified, compare_pages, computed_again


def verify_series(page: str, evidence: SeriesEvidence, find: Callable[[Evidence], Columns | None]) -> Verified:
    """Compare the accounts of a series with the samples that ``find`` has of each run, and its page with one made anew.

    Raises EvidenceError where the samples of a run are not there.
    """
    differences: list[Difference] = []
    sources = []
    for one in evidence.runs:
        columns = find(one)
        if columns is None:
            raise EvidenceError(f"the samples of its run {one.run.id} are not here: name the folder with its runs")
        found, source = computed_again(one, columns)
        differences += [replace(each, name=f"run {one.run.id}, {each.name}") for each in found]
        if source is not None:
            sources.append(source)
    if len(sources) < len(evidence.runs):
        return Verified(tuple(differences[:MOST]), ())
    try:
        again = to_html(series_report(sources))
    except ValueError as error:
        raise EvidenceError(f"its account is of no series: {error}") from None
    shown = compare_pages(page, lambda: again, evidence.runs[0].made_with)
    return Verified((*differences, *shown.differences)[:MOST], shown.left_out)
