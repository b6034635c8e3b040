"""Whether a report holds: everything in it is computed again from the samples that it names, and compared.

What differs is told by its name: a figure, a criterion, a parameter, a sample, a hash, a version, a line of the page.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import unescape
from typing import Any

from backend.documents.edge import UnreadableDocumentError
from backend.documents.result import CRITERIA, METRICS
from backend.experiments.plans.stored_plan import stored_plan
from backend.experiments.results.evaluation import computed
from backend.experiments.results.metrics import NoSamplesError
from backend.recording.columns import Columns
from backend.reports.build import build_report
from backend.reports.digests import BLOCK_S, blocks_of
from backend.reports.evidence import (
    ACCOUNT,
    DRAWING,
    SINEW,
    Evidence,
    EvidenceError,
    SeriesEvidence,
    account_hash,
    hashes_of,
    made_with,
    read,
    source_of,
    without_element,
)
from backend.reports.html import to_html
from backend.reports.pdf import to_pdf
from backend.reports.source import Source
from backend.sample import STORED_NAMES
from plant.parameters import ParameterError, parameters_of

_LIKE = 1e-9
"""Share by which a number may differ where another machine has computed it again."""

MOST = 50
"""Differences that are told; who finds so many needs no more."""
_TAG = re.compile(r"<[^>]*>")
_SET = re.compile(r"</?(?:i|b|sub|sup)>")
_DRAWING = re.compile(r"<svg.*?</svg>", re.DOTALL)


@dataclass(frozen=True)
class Difference:
    """What does not hold: its name, what the report says, and what was found."""

    name: str
    said: str
    found: str

    @property
    def sentence(self) -> str:
        """Say it."""
        return f"{self.name}: the report says {self.said}, found {self.found}"


@dataclass(frozen=True)
class Verified:
    """What was compared: differences, and what could not be compared with the reason."""

    differences: tuple[Difference, ...]
    left_out: tuple[str, ...]


def verify(page: str, columns: Columns | None) -> Verified:
    """Compare a report with its own account, and both with samples; without them the numbers cannot be computed again.

    Raises EvidenceError for a page without an account.
    """
    return _verified(page, _of_a_run(page), columns)[0]


def _verified(page: str, evidence: Evidence, columns: Columns | None) -> tuple[Verified, Source | None]:
    """Return what was compared, and what the report is made from again."""
    if columns is None:
        raise EvidenceError(
            "the samples that it was made of are not here: name their file with --samples, or the folder with their run"
        )
    differences, source = computed_again(evidence, columns)
    if source is None:
        return Verified(differences, ()), None
    shown = compare_pages(page, lambda: to_html(build_report(source)), evidence.made_with)
    return Verified((*differences, *shown.differences)[:MOST], shown.left_out), source


def verify_pdf(pdf: bytes, page: str, columns: Columns | None) -> Verified:
    """Verify the page that a PDF stands beside, and then whether the PDF is the one that its numbers give.

    A PDF carries no account; it is made again and compared byte by byte. Raises EvidenceError.
    """
    evidence = _of_a_run(page)
    verified, source = _verified(page, evidence, columns)
    if verified.differences or source is None:
        return verified
    said, here = evidence.made_with, made_with()
    if said != here:
        words = "the PDF: other versions of what draws and sets it made the report, so that its bytes differ"
        return replace(verified, left_out=(*verified.left_out, words))
    if to_pdf(build_report(source)) == pdf:
        return verified
    return Verified((Difference("the PDF", "other pages", "those that the numbers of its page give"),), ())


def _of_a_run(page: str) -> Evidence:
    evidence = read(page)
    if isinstance(evidence, SeriesEvidence):
        raise EvidenceError("it is of a series: its runs are looked for where they are stored, in the folder of --data")
    return evidence


def computed_again(evidence: Evidence, columns: Columns) -> tuple[tuple[Difference, ...], Source | None]:
    """Compare an account with samples; return what differs, and what the report is made from again.

    None where it cannot be computed again.
    """
    differences = [*_samples(evidence, columns)]
    try:
        metrics, criteria = _again(evidence, columns)
    except (UnreadableDocumentError, ParameterError, ValueError, KeyError, TypeError) as error:
        problem = Difference("what it was computed from", "a run that can be computed again", str(error)[:200])
        return (*differences, problem), None
    source = source_of(evidence, columns, metrics, criteria)
    differences += _documents("metrics", evidence.metrics, None if metrics is None else METRICS.write(metrics))
    differences += _documents("criteria", evidence.criteria, CRITERIA.write(criteria))
    differences += _hashes(evidence.hashes, {**hashes_of(source), ACCOUNT: account_hash(evidence)})
    return tuple(differences[:MOST]), source


def compare_pages(page: str, make_again: Callable[[], str], said: Mapping[str, str]) -> Verified:
    """Compare a page, made with the versions that it says, with the same page made here."""
    here = made_with()
    if said.get(SINEW) != here[SINEW]:
        left_out = f"the page as it is read: it was written by Sinew {said.get(SINEW)}, this is {here[SINEW]}"
        return Verified((), (left_out,))
    drawings = said.get(DRAWING) == here[DRAWING]
    differences = tuple(_pages(page, make_again(), drawings=drawings))
    left = () if drawings else (f"figures: they were drawn by {DRAWING} {said.get(DRAWING)}, here is {here[DRAWING]}",)
    return Verified(differences[:MOST], left)


def _hashes(said: Mapping[str, str], found: Mapping[str, str]) -> Iterator[Difference]:
    for name in dict.fromkeys([*said, *found]):
        if said.get(name) != found.get(name):
            yield Difference(f"hash of the {name}", said.get(name, "nothing"), found.get(name, "nothing"))


def _again(evidence: Evidence, columns: Columns) -> Any:
    run = evidence.run
    plan = stored_plan(run.kind, run.set_to.plan or {})
    parameters = parameters_of(run.parameters_name, run.parameters)
    try:
        result, _ = computed(columns, evidence.missed, parameters, plan, run)
    except NoSamplesError:
        return None, ()
    return result.metrics, result.criteria


def _samples(evidence: Evidence, columns: Columns) -> Iterator[Difference]:
    size = columns["t"].size
    if size != evidence.samples:
        yield Difference("number of samples", str(evidence.samples), str(size))
        return
    found = blocks_of(columns)
    for name in STORED_NAMES:
        said = evidence.blocks.get(name, [])
        for place, (one, other) in enumerate(zip(said, found.get(name, []), strict=False)):
            if one != other:
                start = place * BLOCK_S
                yield Difference(f"samples of {name} from {start:g} s to {start + BLOCK_S:g} s", one, other)
        if len(said) != len(found.get(name, [])):
            yield Difference(f"check sums of {name}", str(len(said)), str(len(found.get(name, []))))


def _documents(name: str, said: Any, found: Any) -> Iterator[Difference]:
    """Compare two documents, part by part; parts of lists are called by their own name, where they have one."""
    if isinstance(said, Mapping) and isinstance(found, Mapping):
        for part in dict.fromkeys([*said, *found]):
            yield from _documents(f"{name}, {part}", said.get(part), found.get(part))
    elif _is_list(said) and _is_list(found) and len(said) == len(found):
        for place, (one, other) in enumerate(zip(said, found, strict=True)):
            called = one.get("name") if isinstance(one, Mapping) else None
            yield from _documents(f"{name}, {called or place + 1}", one, other)
    elif not _alike(said, found):
        yield Difference(name, _short(said), _short(found))


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _alike(said: Any, found: Any) -> bool:
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (said, found))
    return math.isclose(said, found, rel_tol=_LIKE, abs_tol=1e-15) if numbers else bool(said == found)


def _short(value: Any) -> str:
    return "nothing" if value is None else str(value)[:80]


def _pages(page: str, again: str, *, drawings: bool) -> Iterator[Difference]:
    """Compare what a person sees, line by line; drawings only where the same library would draw them alike."""
    said, found = without_element(page), without_element(again)
    if drawings:
        for number, (one, other) in enumerate(zip(_DRAWING.findall(said), _DRAWING.findall(found), strict=False), 1):
            if one != other:
                yield Difference(f"drawing of figure {number}", "another drawing", "that of its samples")
    one_by_one = [_DRAWING.sub("", text).replace("<dt>", "\n<dt>").splitlines() for text in (said, found)]
    for line, (one, other) in enumerate(zip(*one_by_one, strict=False), start=1):
        if one != other:
            yield Difference(_called(one, line), *_where_they_differ(_plain(one), _plain(other)))
    sizes = [len(lines) for lines in one_by_one]
    if sizes[0] != sizes[1]:
        yield Difference("length of the page", f"{sizes[0]} lines", f"{sizes[1]} lines")


def _called(line: str, number: int) -> str:
    if row := re.match(r"<tr><t[dh][^>]*>(.*?)</t[dh]>", line):
        return f"row “{_plain(row.group(1))}”"
    if fact := re.match(r"<dt>(.*?)</dt>", line):
        return f"“{_plain(fact.group(1))}” in the heading"
    return f"line {number} of the page"


def _plain(line: str) -> str:
    return " ".join(unescape(_TAG.sub(" ", _SET.sub("", line.replace("<sub>", "_")))).split())


def _where_they_differ(said: str, found: str) -> tuple[str, str]:
    """Return what stands around the first difference of two lines."""
    same = next((place for place, (one, other) in enumerate(zip(said, found, strict=False)) if one != other), 0)
    start = max(0, same - 30)
    return f"“{said[start : same + 40]}”", f"“{found[start : same + 40]}”"
