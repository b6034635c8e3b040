"""Common parts of all exports: metadata, samples, output stream, errors."""

import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from backend import __version__
from backend.exports import messages
from backend.models import document_digest
from backend.plain_text import check_plain_texts
from backend.recording import CodecError, Columns, SamplesDigest, read_recorded_columns, read_samples
from backend.sample import FIELDS, STORED_NAMES
from backend.storage import (
    RUN,
    Database,
    Formula,
    UnknownRecordError,
    build_record_document,
    formulas,
    recordings,
    runs,
)
from plant import ErrorCode, Message, SinewError, T_s

# Errors --------------------------------------------------------------------------------------------
# Errors of exports and imports.


class ExportError(SinewError, ValueError):
    """Samples that cannot be exported; the message names the reason and a remedy."""

    category = ErrorCode.BAD_VALUE


class ImportRefusedError(SinewError, ValueError):
    """A file that is not imported at all; the message names the part that is wrong."""

    category = ErrorCode.BAD_VALUE


def get_reason(error: Exception) -> str:
    """Return the text of an error, with the code of its catalogue entry if it has one."""
    text = error.args[0] if error.args else ""
    return text if isinstance(text, Message) else str(error)


# Sink ----------------------------------------------------------------------------------------------
# A stream that is read in pieces while it is written.


class Sink(io.BufferedIOBase):
    """Output stream; ``take`` returns the bytes written since its last call."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._written = 0

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, data: Any, /) -> int:
        """Store a piece."""
        piece = bytes(data)
        self._pieces.append(piece)
        self._written += len(piece)
        return len(piece)

    def tell(self) -> int:
        """Return the number of bytes written in total."""
        return self._written

    def take(self) -> bytes:
        """Return and clear the bytes written since the last call."""
        pieces, self._pieces = self._pieces, []
        return b"".join(pieces)


# Strict json ---------------------------------------------------------------------------------------
# JSON of a file of unknown origin: only values that every database and every digest can hold.


_MOST_DIGITS = 18


def read_strict(text: str | bytes) -> Any:
    """Return a document without NaN, infinity, huge numbers and non-plain texts.

    Raises ValueError.
    """
    document = read_finite(text)
    require_texts(document)
    return document


def read_finite(text: str | bytes) -> Any:
    """Return a document without NaN, infinity and huge numbers. Raises ValueError."""
    try:
        return json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError(messages.nested_too_deeply()) from None


def _refuse(word: str) -> NoReturn:
    raise ValueError(messages.not_a_number(text=word))


def _finite(word: str) -> float:
    number = float(word)
    if not math.isfinite(number):
        raise ValueError(messages.number_too_large(number=word))
    return number


def _whole(word: str) -> int:
    digits = len(word.lstrip("-"))
    if digits > _MOST_DIGITS:
        raise ValueError(messages.too_many_digits(number=word, digits=digits, maximum=_MOST_DIGITS))
    return int(word)


def require_texts(document: Any) -> None:
    """Raise ValueError for non-plain texts, also in JSON embedded in a text.

    An experiment in a plan is embedded that way.
    """
    try:
        check_plain_texts(document)
        for inner in _inner_documents(document):
            require_texts(inner)
    except RecursionError:
        raise ValueError(messages.nested_too_deeply()) from None


def _inner_documents(document: Any) -> Iterator[Any]:
    parts = [document]
    while parts:
        part = parts.pop()
        if isinstance(part, dict):
            parts.extend(part.values())
        elif isinstance(part, list):
            parts.extend(part)
        elif isinstance(part, str) and part.startswith(("{", "[")) and "\\" in part:
            try:
                yield json.loads(part)
            except (ValueError, RecursionError):  # an ordinary text
                continue


# Metadata ------------------------------------------------------------------------------------------
# Metadata of an export: content, units, run and digest of its samples.


FORMAT = 1
SEAL = "facts_sha256"

Batch = dict[str, NDArray[Any]]
"""Consecutive samples by column name, shape (n,) each: ``t`` [s] as float64, signals in SI as float32."""

_FIRST = ("t", "q", "q_ref", "S", "S_ref", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B")
ORDER: tuple[str, ...] = (*_FIRST, *(name for name in STORED_NAMES if name not in _FIRST))
"""Columns in the order of every export; ``t`` [s] counts from the first sample."""

_FIELD = {field.name: field for field in FIELDS}


@dataclass(frozen=True)
class Described:
    """One column: name, symbol, unit (SI, "1" for counts and codes), meaning."""

    name: str
    symbol: str
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Facts:
    """Metadata of an export.

    ``fields`` are the columns in the order of the recording, over which ``sha256`` is computed; ``columns`` as written.
    ``of`` is the content, "run 12"; ``started_at`` the time of t = 0 in ISO 8601, if known. ``derived`` names columns
    that were computed for the file and are no part of the recording. ``run`` is the run as stored, None for samples
    without run; ``samples`` is their number, ``missed`` that of missing ones.
    """

    of: str
    fields: list[str]
    period_s: float
    samples: int
    sha256: str
    columns: list[Described]
    derived: list[str] = field(default_factory=list)
    started_at: str | None = None
    run: dict[str, Any] | None = None
    missed: int = 0
    problem: str = ""
    notation: str = messages.notation()
    software: str = __version__
    format: int = field(default=FORMAT)

    @property
    def names(self) -> list[str]:
        """Names of the columns as written, ``t`` first."""
        return [column.name for column in self.columns]

    def to_json(self) -> str:
        """Return the metadata in one line, with their own digest at the end."""
        document = asdict(self)
        if not self.derived:
            del document["derived"]
        sealed = document | {SEAL: document_digest(document)}
        return json.dumps(sealed, ensure_ascii=False, separators=(",", ":"))


_FACTS: TypeAdapter[Facts] = TypeAdapter(Facts)


def read_facts(text: str | bytes) -> Facts:
    """Parse the result of ``to_json``, also of older versions and with any texts.

    Raises ImportRefusedError.
    """
    try:
        document = read_finite(text)
        if not isinstance(document, Mapping) or document.get("format") != FORMAT:
            raise ImportRefusedError(messages.metadata_of_another_format(version=FORMAT))
        contents = {name: part for name, part in document.items() if name != SEAL}
        if document.get(SEAL) != document_digest(contents):
            raise ImportRefusedError(messages.metadata_changed())
        facts = _FACTS.validate_python(contents)
    except ValidationError as error:
        first = error.errors()[0]
        raise ImportRefusedError(messages.invalid_metadata(name=first["loc"][0], reason=first["msg"])) from None
    except ValueError as error:
        if isinstance(error, ImportRefusedError):
            raise
        raise ImportRefusedError(messages.metadata_unreadable(reason=get_reason(error))) from None
    if facts.period_s <= 0.0 or facts.samples < 1 or set(facts.names) != {"t", *facts.fields, *facts.derived}:
        raise ImportRefusedError(messages.metadata_inconsistent())
    return facts


def describe_columns(names: Iterable[str]) -> list[Described]:
    """Return the columns of ``t`` and these signals in the order of every export.

    Those of an older version come last.
    """
    known = set(names) | {"t"}
    ordered = [name for name in ORDER if name in known] + sorted(known - set(ORDER))
    return [
        Described(name, _FIELD[name].symbol, _FIELD[name].unit, _FIELD[name].meaning)
        if name in _FIELD
        else Described(name, name, "1", messages.column_of_earlier_version())
        for name in ordered
    ]


def make_table(batch: Batch, fields: list[str]) -> NDArray[np.float32]:
    """Return the samples of a batch as they are stored: [rows, fields]."""
    return np.column_stack([batch[name] for name in fields]).astype(np.float32, copy=False)


# Source --------------------------------------------------------------------------------------------
# Source of an export: its metadata, and its samples in parts of up to a minute, checked beforehand.


SLAB_S = 50.0
"""Duration of samples read together [s]: 6 MB. Each in its own snapshot, as a download may take hours."""


@dataclass(frozen=True)
class Export:
    """Metadata, and a function that returns the samples, as often as it is called."""

    facts: Facts
    batches: Callable[[], Iterator[Batch]]


def export_run(database: Database, run_id: int, derived: Sequence[str] = ()) -> Export:
    """Return the export of a run after reading it once, to reject errors beforehand.

    ``derived`` are signals of formulas added after its columns. Raises UnknownRecordError, ExportError.
    """
    with database.reading() as session:
        run, document = runs.get(session, run_id), build_record_document(session, RUN, run_id)
        recording, extent = recordings.get(session, run_id), recordings.extent(session, run_id)
        written = {one.name: one for one in formulas.find(session) if one.name in derived}
    length_s = (extent.end_tick - extent.first_tick) * recording.period_s
    lacking = [name for name in derived if name not in written]
    if lacking:
        raise ExportError(messages.formulas_not_found(names=lacking))
    names = [*recording.fields, *derived] if derived else []
    digest, samples = SamplesDigest(recording.fields, recording.period_s), 0

    def batches() -> Iterator[Batch]:
        for number in range(int(np.ceil(length_s / SLAB_S))):
            yield from _slab(database, run_id, names, number * SLAB_S, min((number + 1) * SLAB_S, length_s))

    for batch in batches():
        samples += batch["t"].size
        for tick, part in unbroken(batch, recording.period_s):
            digest.add(tick, make_table(part, recording.fields))
    facts = Facts(
        of=f"run {run_id}",
        fields=recording.fields,
        period_s=recording.period_s,
        samples=samples,
        sha256=digest.hex(),
        columns=[*describe_columns(recording.fields), *(_describe_formula(written[name]) for name in derived)],
        derived=list(derived),
        started_at=run.started_at.isoformat(),
        run=document,
        missed=recording.missed,
        problem=recording.problem,
    )
    return Export(facts, batches)


def export_run_if_recorded(database: Database, run_id: int) -> Export:
    """Return the export of a run, without samples if none were recorded.

    Raises ExportError.
    """
    try:
        return export_run(database, run_id)
    except UnknownRecordError:
        return export_columns(read_recorded_columns(database, run_id)[0], f"run {run_id}")


def export_columns(columns: Columns, of: str, period_s: float = T_s) -> Export:
    """Return the export of samples in memory, such as a flight record.

    ``of`` is the name of the content.
    """
    batch: Batch = {name: column if name == "t" else column.astype(np.float32) for name, column in columns.items()}
    fields = [name for name in batch if name != "t"]
    digest = SamplesDigest(fields, period_s)
    digest.add(0, make_table(batch, fields))
    facts = Facts(
        of=of,
        fields=fields,
        period_s=period_s,
        samples=batch["t"].size,
        sha256=digest.hex(),
        columns=describe_columns(fields),
    )
    return Export(facts, lambda: iter((batch,)))


def unbroken(batch: Batch, period_s: float) -> Iterator[tuple[int, Batch]]:
    """Split a batch at missing samples.

    Yields each part with its first tick, relative to t = 0.
    """
    ticks = np.rint(batch["t"] / period_s).astype(np.int64)
    cuts = [0, *(np.flatnonzero(np.diff(ticks) != 1) + 1).tolist(), ticks.size]
    for begin, end in pairwise(cuts):
        if end > begin:
            yield int(ticks[begin]), {name: column[begin:end] for name, column in batch.items()}


def _describe_formula(formula: Formula) -> Described:
    meaning = messages.meaning_of_formula(meaning=formula.meaning, expression=formula.expression)
    return Described(formula.name, formula.name, formula.unit, meaning)


def _slab(database: Database, run_id: int, names: Sequence[str], from_s: float, to_s: float) -> Iterator[Batch]:
    try:
        with database.reading() as session:
            samples = read_samples(session, run_id, names, from_s, to_s)
    except (CodecError, UnknownRecordError) as error:
        raise ExportError(messages.run_not_exportable(run_id=run_id, reason=error.message)) from error
    if samples.t.size:  # a gap may be longer
        yield {"t": samples.t, **samples.columns}
