"""The manifest embedded in a report: hashes, settings, and inputs of its numbers."""

import hashlib
import json
import math
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

import backend
import plant
from backend import __version__
from backend.analysis import select_used_settings
from backend.models import CRITERIA, METRICS, PLANT_NUMBERS, Metrics, RunCriterion, document_digest
from backend.recording import Columns, count_missing_ticks
from backend.reports import messages
from backend.reports.run_data import RunData
from backend.reports.timing import granted_rows
from backend.sample import STORED_NAMES, UNIT_BY_SIGNAL
from backend.storage import Bank, BankEntry, Identification, NewIdentification, Result, Run, RunKind, StoredFit
from backend.units import AngleUnit
from plant import ErrorCode, SinewError, T_s

# Digests -------------------------------------------------------------------------------------------
# Content hashes of the inputs of a report, to tell whether two inputs are identical.


BLOCK_S = 1.0
"""Length [s] of the blocks of a signal that have a checksum each; a checksum locates a changed sample."""

HASHED = ("t", *STORED_NAMES)
_BLOCK = round(BLOCK_S / T_s)


def of_samples(columns: Columns) -> str:
    """Return the SHA-256 of all samples: the times, then each stored signal."""
    found = hashlib.sha256()
    for name in _present(columns):
        found.update(_normalize_column(columns, name).tobytes())
    return found.hexdigest()


def compute_block_hashes(columns: Columns) -> dict[str, list[str]]:
    """Return the checksums of the blocks of the times and of each signal."""
    size = columns["t"].size
    return {
        name: [_check(stored[start : start + _BLOCK]) for start in range(0, size, _BLOCK)]
        for name, stored in ((name, _normalize_column(columns, name)) for name in _present(columns))
    }


def _present(columns: Columns) -> list[str]:
    return [name for name in HASHED if name in columns]


def _check(stored: NDArray[Any]) -> str:
    return f"{zlib.crc32(stored.tobytes()):08x}"


def _normalize_column(columns: Columns, name: str) -> NDArray[Any]:
    """Return a column in the form that is hashed, independent of the file format.

    Times are in whole ns, which all formats preserve. Signals are float32 with a single kind of NaN.
    """
    if name == "t":
        return np.rint(1e9 * columns["t"]).astype("<f8")
    stored = np.ascontiguousarray(columns[name], dtype="<f4")
    return np.where(np.isnan(stored), np.float32(np.nan), stored).astype("<f4")


# Manifest ------------------------------------------------------------------------------------------
# The manifest of a report: all inputs of its numbers except the samples, and their hashes.
#
# The manifest describes the report to ``verification``; hashes tie it to samples that are stored elsewhere.


FORMAT = 2
_BEGIN, _END = '<template id="evidence">', "</template>"  # not displayed and not a script
SINEW, LAYOUT, DRAWING, SETTING = "Sinew", "layout", "matplotlib", "typst"
_WRITES_PAGES = ("**/*.py", "**/*.toml", "**/*.yaml", "reports/*.*")
MANIFEST = "account"
"""Name of the hash of the whole manifest."""


_UNVERIFIED_DEFAULTS: dict[str, Any] = {"station": "", "bank_id": None}


def get_unverified_defaults(metrics: dict[str, Any] | None) -> dict[str, Any]:
    """Return default values for fields of a run on which no part of a report depends.

    Verification could not check these fields. The reason why a run was not evaluated is shown only for a run without a
    result.
    """
    return _UNVERIFIED_DEFAULTS if metrics is None else {**_UNVERIFIED_DEFAULTS, "evaluation_problem": ""}


class EvidenceError(SinewError, ValueError):
    """A file without a readable manifest."""

    category = ErrorCode.BAD_VALUE


@dataclass(frozen=True, kw_only=True)
class StoredEstimate:
    """The estimate from a run as embedded in a report.

    Time and number are not part of it, because they change each time it is stored.
    """

    kind: str
    data: dict[str, Any]
    method: str
    options: dict[str, Any]
    model: dict[str, Any]
    quality: dict[str, Any]
    usable: bool
    verdict: str


@dataclass(frozen=True)
class StoredBankSummary:
    """The entries of a bank of gains, without the time and the author."""

    name: str
    version: int
    entries: tuple[BankEntry, ...]

    @property
    def digest(self) -> str:
        """Return the hash of name, version and entries."""
        return document_digest([self.name, self.version, [[entry.S_nominal, entry.model] for entry in self.entries]])


@dataclass(frozen=True, kw_only=True)
class ReportManifest:
    """The manifest of the report of a run.

    ``hashes`` has the hash of each input by its name; ``blocks`` has the checksums of the samples by signal and second.
    ``missed_before`` is the number of ticks lost before the first sample; ticks missing between samples can be counted.
    """

    format: int
    run: Run
    metrics: dict[str, Any] | None
    criteria: list[dict[str, Any]]
    bank: StoredBankSummary | None
    identification: StoredEstimate | None
    runs_of: dict[int, int | None]
    fits: dict[int, dict[str, StoredFit]]
    angles: AngleUnit
    missed_before: int
    samples: int
    hashes: dict[str, str]
    blocks: dict[str, list[str]]
    made_with: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SeriesEvidence:
    """The manifests of all runs of a series, in the order of the series."""

    format: str
    runs: tuple[ReportManifest, ...]


SERIES = f"series {FORMAT}"
_EVIDENCE: TypeAdapter[ReportManifest] = TypeAdapter(ReportManifest)
_SERIES: TypeAdapter[SeriesEvidence] = TypeAdapter(SeriesEvidence)


def compute_hashes(manifest: ReportManifest, columns: Columns) -> dict[str, str]:
    """Return the hash of each input of the report's numbers by its name."""
    run = manifest.run
    found = {
        "samples": of_samples(columns),
        "parameters": document_digest(run.parameters),
        "settings": document_digest(run.settings),
    }
    if manifest.bank is not None:
        found["bank"] = manifest.bank.digest
    if manifest.identification is not None:
        found["identification"] = document_digest([manifest.identification.model, manifest.identification.quality])
    return found


def build_manifest(source: RunData) -> ReportManifest | None:
    """Return the manifest of a run; None for a session, of which nothing is computed."""
    if source.run.kind == RunKind.SESSION:
        return None
    result, columns = source.result, source.columns
    missing = None if result is None else result.metrics.missing_samples
    metrics = None if result is None else METRICS.write(result.metrics)
    manifest = ReportManifest(
        format=FORMAT,
        run=replace(source.run, **get_unverified_defaults(metrics)),
        metrics=metrics,
        criteria=[] if result is None else CRITERIA.write(result.criteria),
        bank=to_stored_bank(source.bank),
        identification=None if source.identification is None else to_stored_estimate(source.identification),
        runs_of={of: source.runs_of[of] for of in _find_identifications(source)},
        fits={number: dict(fits) for number, fits in source.fits.items()},
        angles=source.angles,
        missed_before=max(0, (missing or 0) - count_missing_ticks(columns)),
        samples=columns["t"].size,
        hashes={},
        blocks=compute_block_hashes(columns),
        made_with=made_with(),
    )
    manifest = replace(manifest, hashes=compute_hashes(manifest, columns))
    return replace(manifest, hashes={**manifest.hashes, MANIFEST: compute_manifest_hash(manifest)})


def to_stored_bank(bank: Bank | None) -> StoredBankSummary | None:
    """Return the part of a bank that a report embeds."""
    return None if bank is None else StoredBankSummary(bank.name, bank.version, bank.entries)


def to_stored_estimate(found: NewIdentification) -> StoredEstimate:
    """Return the part of an estimate that a report embeds, as read back from JSON."""
    values = {item.name: getattr(found, item.name) for item in fields(StoredEstimate)}
    return StoredEstimate(**json.loads(json.dumps(values)))


def made_with() -> dict[str, str]:
    """Return the versions that determine text, drawings and PDF of a report."""
    return {SINEW: __version__, LAYOUT: layout(), DRAWING: version(DRAWING), SETTING: version(SETTING)}


@cache
def layout() -> str:
    """Return the hash of the files that determine text and drawings of a page.

    Two states of the source code with the same version number may phrase the same numbers differently.
    """
    found = hashlib.sha256()
    for package in (backend, plant):
        folder = Path(package.__path__[0])
        for file in sorted({one for pattern in _WRITES_PAGES for one in folder.glob(pattern)}):
            text = file.read_bytes().replace(b"\r\n", b"\n")  # a checkout may have other line endings
            found.update(f"{package.__name__}/{file.relative_to(folder).as_posix()} {len(text)}\n".encode() + text)
    return found.hexdigest()[:16]


def compute_manifest_hash(manifest: ReportManifest) -> str:
    """Return the hash of a manifest without this hash itself."""
    hashes = {name: digest for name, digest in manifest.hashes.items() if name != MANIFEST}
    return document_digest(_EVIDENCE.dump_python(replace(manifest, hashes=hashes), mode="json"))


def rebuild_run_data(
    manifest: ReportManifest,
    columns: Columns,
    metrics: Metrics | None,
    criteria: tuple[RunCriterion, ...],
    estimate: StoredEstimate | None,
) -> RunData:
    """Return the source data of a report, rebuilt with these samples and this result."""
    run, bank = manifest.run, manifest.bank
    moment = run.started_at
    stored: dict[str, Any] = {"run_id": run.id, "who": run.who, "software": run.software, "id": 0, "created_at": moment}
    return RunData(
        run=run,
        result=None
        if metrics is None
        else Result(run_id=run.id, metrics=metrics, criteria=criteria, software=run.software, id=0, created_at=moment),
        columns=columns,
        bank=None
        if bank is None
        else Bank(id=0, name=bank.name, version=bank.version, note="", who="", created_at=moment, entries=bank.entries),
        identification=None if estimate is None else Identification(**asdict(estimate), **stored),
        runs_of=manifest.runs_of,
        angles=manifest.angles,
        fits=manifest.fits,
    )


def to_element(manifest: ReportManifest | SeriesEvidence) -> str:
    """Return the HTML element of the manifest, escaped so that nothing can close it."""
    adapter: TypeAdapter[Any] = _SERIES if isinstance(manifest, SeriesEvidence) else _EVIDENCE
    document = adapter.dump_python(manifest, mode="json")
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return f"{_BEGIN}{text}{_END}"


def find_element(page: str) -> str:
    """Return the manifest element of a page; "" if there is none."""
    begin = page.find(_BEGIN)
    end = page.find(_END, begin)
    return "" if begin < 0 or end < 0 else page[begin : end + len(_END)]


def without_element(page: str) -> str:
    """Return a page without its manifest; only the opening tag of the element remains."""
    return page.replace(find_element(page), _BEGIN, 1)


def read_manifest(page: str) -> ReportManifest | SeriesEvidence:
    """Return the manifest of a page, of a run or of a series. Raises EvidenceError."""
    element = find_element(page)
    if not element:
        raise EvidenceError(messages.no_manifest())
    text = element[len(_BEGIN) : -len(_END)]
    try:
        kind = json.loads(text).get("format")
        if kind not in (FORMAT, SERIES):
            raise EvidenceError(messages.manifest_of_another_format(version=FORMAT))
        return _SERIES.validate_json(text) if kind == SERIES else _EVIDENCE.validate_json(text)
    except (ValidationError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, EvidenceError):
            raise
        raise EvidenceError(messages.manifest_unreadable(reason=str(error).splitlines()[0])) from None


def _find_identifications(source: RunData) -> set[int]:
    entries = () if source.bank is None else source.bank.entries
    named = {entry.identification_id for entry in entries if entry.identification_id is not None}
    return {number for number in named if number in source.runs_of}


# Configuration -------------------------------------------------------------------------------------
# The configuration of a run by name, for comparing runs. Pure functions.


_DIGITS = 12
"""Number of digits of a hash that distinguish it from the others in a table."""


_MAX_EXPERIMENT_VALUES = 200
"""A longer experiment is compared by the hash of its text only: a table of its values would be too long to read."""


@dataclass(frozen=True)
class ConfigurationValue:
    """One configuration value in SI units; ``unit`` is "" if it has none."""

    name: str
    value: Any
    unit: str = ""


def _iterate_experiment_values(text: str) -> Iterator[ConfigurationValue]:
    """Yield the values of an experiment, named by their paths in its text.

    Yields nothing for an experiment with more than 200 values.
    """
    values = list(islice(_iterate_leaves("experiment", json.loads(text)), _MAX_EXPERIMENT_VALUES + 1))
    if len(values) <= _MAX_EXPERIMENT_VALUES:
        yield from values


def _iterate_leaves(path: str, node: Any) -> Iterator[ConfigurationValue]:
    """Yield the scalars below a node of a JSON document; a number that is not finite as text."""
    match node:
        case dict():
            for name, inner in node.items():
                yield from _iterate_leaves(f"{path}.{name}", inner)
        case list():
            for index, inner in enumerate(node):
                yield from _iterate_leaves(f"{path}[{index}]", inner)
        case float() if not math.isfinite(node):
            yield ConfigurationValue(path, str(node))
        case _:
            yield ConfigurationValue(path, node, UNIT_BY_SIGNAL.get(path.rpartition(".")[2], ""))


def iterate_configuration(run: Run, bank: Bank | None) -> Iterator[ConfigurationValue]:
    """Yield the configuration of a run.

    That is plant, software, experiment, ``bank``, machine, settings and parameters.
    """
    yield ConfigurationValue("plant", run.plant)
    yield ConfigurationValue(messages.name_of_parameter_set(), run.parameters_name)
    yield ConfigurationValue("Sinew", run.software)
    yield from (ConfigurationValue(name, version) for name, version in (run.set_to.versions or {}).items())
    if text := run.set_to.experiment:
        yield ConfigurationValue(messages.hash_of_experiment(), document_digest(text)[:_DIGITS])
        yield from _iterate_experiment_values(text)
    known = to_stored_bank(bank)
    yield ConfigurationValue(
        "bank", "none" if known is None else messages.bank_and_version(name=known.name, version=known.version)
    )
    if known is not None:
        yield ConfigurationValue(messages.hash_of_bank(), known.digest[:_DIGITS])
    granted: dict[str, list[str]] = {}
    for name, value, unit, meaning in granted_rows(run.set_to.granted):
        granted.setdefault(name, []).append(f"{value} {unit}".strip() or meaning)
    yield from (ConfigurationValue(name, "; ".join(texts)) for name, texts in granted.items())
    for item in select_used_settings(run):
        yield ConfigurationValue(f"{item.meaning} {item.symbol}", item.value, item.unit)
    for section, entries in PLANT_NUMBERS.read(run.parameters, f"run {run.id}").items():
        for entry, number in entries.items():
            yield ConfigurationValue(f"{section}.{entry}", number.value, number.unit)
