"""What every export says of itself: what its samples are, in which units, of which run, and their digest. Pure."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from backend import __version__
from backend.documents.digest import digest_of
from backend.exports.errors import ImportRefusedError
from backend.exports.strict_json import read_finite
from backend.sample import FIELDS, STORED_NAMES

FORMAT = 1
SEAL = "facts_sha256"
NOTATION = (
    "SI units, angles in rad. t counts from the first sample. _ref: a reference, _gov: after governor or plan, "
    "_dot: a derivative, A and B: the two motors with their tendons, lam: lambda. Equations: docs/notation.md."
)

Batch = dict[str, NDArray[Any]]
"""Consecutive samples by column name, shape (n,) each: ``t`` [s] as float64, signals in SI as float32."""

_FIRST = ("t", "q", "q_ref", "S", "S_ref", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B")
ORDER: tuple[str, ...] = (*_FIRST, *(name for name in STORED_NAMES if name not in _FIRST))
"""Columns in the order of every export; ``t`` [s] counts from the first sample."""

_FIELD = {field.name: field for field in FIELDS}


@dataclass(frozen=True)
class Described:
    """One column: its name, the symbol that a person reads, its unit (SI, "1" for counts and codes) and meaning."""

    name: str
    symbol: str
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Facts:
    """``fields`` are the columns in the order of the recording, which ``sha256`` is of; ``columns`` as written.

    ``of`` is what the samples are, "run 12"; ``started_at`` the moment of t = 0 in ISO 8601, where it is known.
    ``derived`` names columns that were computed for the file and are no part of the recording.
    ``run`` is the run as stored, None of samples that are no run's; ``samples`` counts them, ``missed`` those lacking.
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
    notation: str = NOTATION
    software: str = __version__
    format: int = field(default=FORMAT)

    @property
    def names(self) -> list[str]:
        """Names of the columns as written, ``t`` first."""
        return [column.name for column in self.columns]

    def to_json(self) -> str:
        """Return them in one line, with their own digest at the end."""
        document = asdict(self)
        if not self.derived:
            del document["derived"]
        sealed = document | {SEAL: digest_of(document)}
        return json.dumps(sealed, ensure_ascii=False, separators=(",", ":"))


_FACTS: TypeAdapter[Facts] = TypeAdapter(Facts)


def read_facts(text: str | bytes) -> Facts:
    """Read what ``to_json`` wrote, of an older run too, whatever its texts are. Raises ImportRefusedError."""
    try:
        document = read_finite(text)
        if not isinstance(document, Mapping) or document.get("format") != FORMAT:
            raise ImportRefusedError(f"what it says of itself is not of format {FORMAT}: take the Sinew that wrote it")
        said = {name: part for name, part in document.items() if name != SEAL}
        if document.get(SEAL) != digest_of(said):
            raise ImportRefusedError("what it says of itself was changed: its sha256 is another one")
        facts = _FACTS.validate_python(said)
    except ValidationError as error:
        first = error.errors()[0]
        raise ImportRefusedError(f"what it says of itself: {first['loc'][0]}: {first['msg']}") from None
    except ValueError as error:
        if isinstance(error, ImportRefusedError):
            raise
        raise ImportRefusedError(f"what it says of itself cannot be read: {error}") from None
    if facts.period_s <= 0.0 or facts.samples < 1 or set(facts.names) != {"t", *facts.fields, *facts.derived}:
        raise ImportRefusedError("what it says of itself: period, samples or columns do not fit together")
    return facts


def described(names: Iterable[str]) -> list[Described]:
    """Return the columns of ``t`` and these signals in the order of every export; those of an older Sinew last."""
    known = set(names) | {"t"}
    ordered = [name for name in ORDER if name in known] + sorted(known - set(ORDER))
    return [
        Described(name, _FIELD[name].symbol, _FIELD[name].unit, _FIELD[name].meaning)
        if name in _FIELD
        else Described(name, name, "1", "of an earlier version")
        for name in ordered
    ]


def table_of(batch: Batch, fields: list[str]) -> NDArray[np.float32]:
    """Return the samples of a batch as they are stored: [rows, fields]."""
    return np.column_stack([batch[name] for name in fields]).astype(np.float32, copy=False)
