"""Whether a report holds: everything in it is computed again from the samples that it names, and compared.

What differs is told by its name: a figure, a criterion, a parameter, a sample, a hash, a version, a line of the page.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from backend.analysis.context import points_in
from backend.analysis.evaluation import computed
from backend.analysis.step_metrics import NoSamplesError
from backend.experiments.library import stored_plan
from backend.models.run import CRITERIA, DEFINITIONS, METRICS, Criterion, Metrics
from backend.recording.reader import Columns, missing_between
from backend.reports.build import build_report
from backend.reports.differences import LIKE, LIKE_ESTIMATE, MOST, Difference, Verified, differing, not_made
from backend.reports.digests import BLOCK_S, HASHED, blocks_of
from backend.reports.evidence import (
    ACCOUNT,
    LAYOUT,
    SINEW,
    Estimate,
    Evidence,
    EvidenceError,
    SeriesEvidence,
    account_hash,
    estimate_of,
    hashes_of,
    made_with,
    read,
    source_of,
    unseen,
)
from backend.reports.files import metrics_document
from backend.reports.html import to_html
from backend.reports.page_comparison import compare_pages
from backend.reports.pdf import to_pdf
from backend.reports.source import Source
from plant.parameters import parameters_of

_NO_RESULT = (
    "the result: the report was made without one, and from its samples one can be computed: sinew runs evaluate RUN"
)
_OTHER_PDF = "the PDF: other versions of what draws and sets it made the report, so that its bytes differ"

_Result = tuple[Metrics | None, tuple[Criterion, ...], Estimate | None]


@dataclass(frozen=True)
class Beside:
    """What else holds numbers of a report: the text of metrics.json, and the samples of the stored run under a name."""

    metrics: str | None = None
    stored: Columns | None = None
    stored_as: str = ""


NOTHING_BESIDE = Beside()


def verify(page: str, columns: Columns | None, beside: Beside = NOTHING_BESIDE) -> Verified:
    """Compare a report with its own account, and both with samples; without them the numbers cannot be computed again.

    What is ``beside`` them is compared as well. Raises EvidenceError for a page without an account.
    """
    evidence = _of_a_run(page)
    return _with_beside(*_verified(page, evidence, columns), evidence, beside)


def _with_beside(found: Verified, source: Source | None, evidence: Evidence, beside: Beside) -> Verified:
    """Return what was found, with what differs of metrics.json and of the stored run."""
    differences = list(found.differences)
    left_out = list(found.left_out)
    if beside.stored is not None:
        stored = _samples(evidence, _without_unrecorded(evidence, beside.stored))
        differences += (replace(one, name=f"{beside.stored_as}, {one.name}") for one in stored)
    if beside.metrics is not None and source is None:
        left_out.append("metrics.json: what its numbers come from cannot be computed again")
    elif beside.metrics is not None and source is not None:
        differences += _metrics_file(beside.metrics, source, evidence)
    return replace(found, differences=tuple(differences[:MOST]), left_out=tuple(left_out))


def _metrics_file(text: str, source: Source, evidence: Evidence) -> Iterator[Difference]:
    """Compare metrics.json with what is written of the same run here; words only where the same version wrote them."""
    try:
        said = json.loads(text)
    except (ValueError, RecursionError) as error:
        yield Difference("metrics.json", "a JSON document", str(error)[:200])
        return
    if not isinstance(said, dict):
        yield Difference("metrics.json", "a JSON object", type(said).__name__)
        return
    found = json.loads(json.dumps(metrics_document(source)))
    same = all(evidence.made_with.get(name) == made_with()[name] for name in (SINEW, LAYOUT))
    words = () if same else ("labels", "verdict", "problem")
    for document in (said, found):
        for name in words:
            document.pop(name, None)
        if isinstance(document.get("identification"), dict):
            document["identification"].pop("estimate", None)  # its number where it is stored
            if not same:
                document["identification"] = _without_sentences(document["identification"])
    yield from differing("metrics.json", said, found, LIKE if source.identification is None else LIKE_ESTIMATE)


def _verified(page: str, evidence: Evidence, columns: Columns | None) -> tuple[Verified, Source | None]:
    """Return what was compared, and what the report is made from again."""
    if columns is None:
        raise EvidenceError(
            "the samples that it was made of are not here: name their file with --samples, or the folder with their run"
        )
    again, source = computed_again(evidence, columns)
    if source is None:
        return again, None
    return joined(again, compare_pages(page, evidence, lambda: to_html(build_report(source)))), source


def joined(*found: Verified) -> Verified:
    """Return what was compared one after the other, the page last, as one."""
    differences = tuple(one for each in found for one in each.differences)
    left_out = dict.fromkeys(one for each in found for one in each.left_out)
    return Verified(differences[:MOST], tuple(left_out), found[-1].compared)


def verify_pdf(pdf: bytes, page: str, columns: Columns | None, beside: Beside = NOTHING_BESIDE) -> Verified:
    """Verify the page that a PDF stands beside, and then whether the PDF is the one that its numbers give.

    A PDF carries no account; it is made again and compared byte by byte. Raises EvidenceError.
    """
    evidence = _of_a_run(page)
    verified, source = _verified(page, evidence, columns)
    verified = _with_beside(verified, source, evidence, beside)
    if verified.differences or source is None:
        return verified
    if evidence.made_with != made_with():
        words = f"of the page beside it: {verified.compared}"
        return replace(verified, left_out=(*verified.left_out, _OTHER_PDF), compared=words)
    try:
        same = to_pdf(build_report(source)) == pdf
    except Exception as error:
        return Verified((not_made("the PDF", "one that can be made again", error),), ())
    if same:
        return verified
    return Verified((Difference("the PDF", "other pages", "those that the numbers of its page give"),), ())


def _of_a_run(page: str) -> Evidence:
    evidence = read(page)
    if isinstance(evidence, SeriesEvidence):
        raise EvidenceError("it is of a series: its runs are looked for where they are stored, in the folder of --data")
    return evidence


def computed_again(evidence: Evidence, columns: Columns) -> tuple[Verified, Source | None]:
    """Compare an account with samples; return what differs, and what the report is made from again.

    None where it cannot be computed again, whatever is wrong with what it says of its run.
    """
    differences: list[Difference] = []
    columns = _without_unrecorded(evidence, columns)
    try:
        differences += _samples(evidence, columns)
        differences += _hashes(evidence.hashes, {**hashes_of(evidence, columns), ACCOUNT: account_hash(evidence)})
        again = _again(evidence, columns)
        if evidence.metrics is None and again[0] is not None:
            source = source_of(evidence, columns, None, (), None)
            return Verified(tuple(differences[:MOST]), (_NO_RESULT,)), source
        older = _older(evidence)
        left_out = (*older, *_unseen(evidence))
        others = [] if older else list(_results(evidence, again))
        carries = bool(older) or not others
        source = source_of(evidence, columns, *(_carried(evidence) if carries else again))
    except Exception as error:
        problem = not_made("what it was computed from", "a run that can be computed again", error)
        return Verified((*differences, problem)[:MOST], ()), None
    return Verified((*differences, *others)[:MOST], left_out), source


def _older(evidence: Evidence) -> tuple[str, ...]:
    """Say that a result is of other definitions than those that this version computes by; empty where it is not."""
    if evidence.metrics is None or evidence.metrics.get("definitions", 0) == DEFINITIONS:
        return ()
    said = evidence.metrics.get("definitions", 0)
    told = (
        f"the result: it was computed by version {said} of the definitions of figures and criteria, this Sinew "
        f"computes by version {DEFINITIONS}: compute it anew with `sinew runs evaluate {evidence.run.id}`, and make "
        "the report again"
    )
    return (told,)


def _unseen(evidence: Evidence) -> tuple[str, ...]:
    """Name what an account says of its run that no page shows and no sample tells; reports of today leave it out."""
    said = [name for name, nothing in unseen(evidence.metrics).items() if getattr(evidence.run, name) != nothing]
    return (f"{', '.join(said)} of the run: nothing in the report depends on it",) if said else ()


def _hashes(said: Mapping[str, str], found: Mapping[str, str]) -> Iterator[Difference]:
    for name in dict.fromkeys([*said, *found]):
        if said.get(name) != found.get(name):
            yield Difference(f"hash of the {name}", said.get(name, "nothing"), found.get(name, "nothing"))


def _again(evidence: Evidence, columns: Columns) -> _Result:
    run = evidence.run
    plan = stored_plan(run.kind, run.set_to.plan or {})
    parameters = parameters_of(run.parameters_name, run.parameters)
    missed = evidence.missed_before + missing_between(columns)
    try:
        result, estimate = computed(columns, missed, parameters, plan, run, points_in(evidence.bank))
    except NoSamplesError:
        return None, (), None
    return result.metrics, result.criteria, None if estimate is None else estimate_of(estimate)


def _carried(evidence: Evidence) -> _Result:
    """Return the result as a report says it: where it holds, a last digit of another machine changes no hash."""
    metrics, of = evidence.metrics, f"run {evidence.run.id}"
    criteria = CRITERIA.read(evidence.criteria, of)
    return None if metrics is None else METRICS.read(metrics, of), criteria, evidence.identification


def _results(evidence: Evidence, again: _Result) -> Iterator[Difference]:
    metrics, criteria, estimate = again
    like = LIKE if estimate is None else LIKE_ESTIMATE
    yield from differing("metrics", evidence.metrics, None if metrics is None else METRICS.write(metrics), like)
    yield from differing("criteria", evidence.criteria, CRITERIA.write(criteria))
    said, found = _document(evidence.identification), _document(estimate)
    if evidence.made_with.get(LAYOUT) != made_with()[LAYOUT]:  # another state of the code may say it otherwise
        said, found = _without_sentences(said), _without_sentences(found)
    yield from differing("identification", said, found, like)


def _without_sentences(document: Any) -> Any:
    """Return a document without the texts that have more than one word; names and grades have one."""
    if isinstance(document, Mapping):
        return {name: _without_sentences(part) for name, part in document.items()}
    if isinstance(document, list):
        return [_without_sentences(part) for part in document]
    return "" if isinstance(document, str) and " " in document else document


def _document(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else vars(estimate)


def _without_unrecorded(evidence: Evidence, columns: Columns) -> Columns:
    """Leave out signals without a single value that the report has no check sums of: an export adds them as nan."""
    return {
        name: column
        for name, column in columns.items()
        if name == "t" or name in evidence.blocks or not np.isnan(column).all()
    }


def _samples(evidence: Evidence, columns: Columns) -> Iterator[Difference]:
    size = columns["t"].size
    if size != evidence.samples:
        yield Difference("number of samples", str(evidence.samples), str(size))
        return
    found = blocks_of(columns)
    for name in HASHED:
        said = evidence.blocks.get(name, [])
        for place, (one, other) in enumerate(zip(said, found.get(name, []), strict=False)):
            if one != other:
                start = place * BLOCK_S
                yield Difference(f"samples of {name} from {start:g} s to {start + BLOCK_S:g} s", one, other)
        if len(said) != len(found.get(name, [])):
            yield Difference(f"check sums of {name}", str(len(said)), str(len(found.get(name, []))))
