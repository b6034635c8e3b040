"""What a report carries beside what it shows: all that its numbers were computed from but the samples, and their sums.

It is the report's own account of itself, read again by ``verification``; hashes tie it to samples kept elsewhere.
"""

import json
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Any

from pydantic import TypeAdapter, ValidationError

from backend import __version__
from backend.documents.digest import digest_of
from backend.documents.result import CRITERIA, METRICS, Criterion, Metrics
from backend.reading import Angles
from backend.recording.columns import Columns
from backend.reports.digests import blocks_of, of_samples
from backend.reports.source import Source
from backend.storage.bank_entry import ChannelFit
from backend.storage.banks import Bank
from backend.storage.identifications import Identification
from backend.storage.results import Result
from backend.storage.runs import Run, RunKind

FORMAT = 1
_BEGIN, _END = '<template id="evidence">', "</template>"  # shown nowhere, and no script
SINEW, DRAWING, SETTING = "Sinew", "matplotlib", "typst"
ACCOUNT = "account"
"""Name of the hash of all the rest that a report carries."""


class EvidenceError(ValueError):
    """A file that carries no account of itself that can be read."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """``hashes`` are by what they are of; ``blocks`` check sums of the samples by signal and second."""

    format: int
    run: Run
    metrics: dict[str, Any] | None
    criteria: list[dict[str, Any]]
    bank: Bank | None
    identification: Identification | None
    runs_of: dict[int, int | None]
    fits: dict[int, dict[str, ChannelFit]]
    angles: Angles
    missed: int
    samples: int
    hashes: dict[str, str]
    blocks: dict[str, list[str]]
    made_with: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SeriesEvidence:
    """The accounts of all runs of a series, in its order."""

    format: str
    runs: tuple[Evidence, ...]


SERIES = "series 1"
_EVIDENCE: TypeAdapter[Evidence] = TypeAdapter(Evidence)
_SERIES: TypeAdapter[SeriesEvidence] = TypeAdapter(SeriesEvidence)


def hashes_of(source: Source) -> dict[str, str]:
    """Return the hash of each thing that the report's numbers come from, by its name."""
    run = source.run
    found = {
        "samples": of_samples(source.columns),
        "parameters": digest_of(run.parameters),
        "settings": digest_of(run.settings),
    }
    if source.bank is not None:
        entries = [[entry.S_nominal, entry.model] for entry in source.bank.entries]
        found["bank"] = digest_of([source.bank.name, source.bank.version, entries])
    if source.identification is not None:
        found["identification"] = digest_of([source.identification.model, source.identification.quality])
    return found


def evidence_of(source: Source) -> Evidence | None:
    """Return the account of a run; none of a session, of which nothing is computed."""
    if source.run.kind == RunKind.SESSION:
        return None
    result = source.result
    told = Evidence(
        format=FORMAT,
        run=source.run,
        metrics=None if result is None else METRICS.write(result.metrics),
        criteria=[] if result is None else CRITERIA.write(result.criteria),
        bank=source.bank,
        identification=source.identification,
        runs_of={of: source.runs_of[of] for of in _named(source)},
        fits={number: dict(fits) for number, fits in source.fits.items()},
        angles=source.angles,
        missed=0 if result is None else result.metrics.missing_samples or 0,
        samples=source.columns["t"].size,
        hashes=hashes_of(source),
        blocks=blocks_of(source.columns),
        made_with=made_with(),
    )
    return replace(told, hashes={**told.hashes, ACCOUNT: account_hash(told)})


def made_with() -> dict[str, str]:
    """Return the versions that the words, the drawings and the PDF of a report depend on."""
    return {SINEW: __version__, DRAWING: version(DRAWING), SETTING: version(SETTING)}


def account_hash(evidence: Evidence) -> str:
    """Return the hash of what a report carries, but for itself."""
    hashes = {name: digest for name, digest in evidence.hashes.items() if name != ACCOUNT}
    return digest_of(_EVIDENCE.dump_python(replace(evidence, hashes=hashes), mode="json"))


def source_of(evidence: Evidence, columns: Columns, metrics: Metrics | None, criteria: tuple[Criterion, ...]) -> Source:
    """Return what a report is made from again, with these samples and this result."""
    run = evidence.run
    result = None
    if metrics is not None:
        result = Result(run.id, metrics, criteria, run.software, 0, run.started_at)
    return Source(
        run,
        result,
        columns,
        evidence.bank,
        evidence.identification,
        evidence.runs_of,
        evidence.angles,
        evidence.fits,
    )


def to_element(evidence: Evidence | SeriesEvidence) -> str:
    """Return the element of a page that carries it; nothing in it can end the element."""
    adapter: TypeAdapter[Any] = _SERIES if isinstance(evidence, SeriesEvidence) else _EVIDENCE
    document = adapter.dump_python(evidence, mode="json")
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return f"{_BEGIN}{text}{_END}"


def without_element(page: str) -> str:
    """Return a page as a person sees it."""
    begin, end = page.find(_BEGIN), page.find(_END)
    return page if begin < 0 or end < begin else page[:begin] + page[end + len(_END) :]


def read(page: str) -> Evidence | SeriesEvidence:
    """Return what a page carries: the account of a run, or of each run of a series. Raises EvidenceError."""
    begin = page.find(_BEGIN)
    end = page.find(_END, begin)
    if begin < 0 or end < 0:
        raise EvidenceError("it carries no account of its numbers: it is no report of a run, or of an older Sinew")
    text = page[begin + len(_BEGIN) : end]
    try:
        kind = json.loads(text).get("format")
        if kind not in (FORMAT, SERIES):
            raise EvidenceError(f"its account is not of format {FORMAT}: take the Sinew that it was made with")
        return _SERIES.validate_json(text) if kind == SERIES else _EVIDENCE.validate_json(text)
    except (ValidationError, ValueError, AttributeError) as error:
        if isinstance(error, EvidenceError):
            raise
        raise EvidenceError(f"its account of its numbers cannot be read: {str(error).splitlines()[0]}") from None


def _named(source: Source) -> set[int]:
    entries = () if source.bank is None else source.bank.entries
    named = {entry.identification_id for entry in entries if entry.identification_id is not None}
    if source.identification is not None:
        named.add(source.identification.id)
    return {number for number in named if number in source.runs_of}
