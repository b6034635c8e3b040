"""A tuning that outlives the service: the one in force with the plant it was for, the one saved for a bank. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from backend.documents.edge import Edge
from backend.documents.run_settings import KeptLoop

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class KeptTuning(KeptLoop):
    """The tuning in force; ``parameters`` tells the plant's numbers from others."""

    parameters: str
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class SavedParts(KeptLoop):
    """What a bank is meant to run with."""

    version: int = VERSION


def _bank_by_number(document: Any) -> Any:
    """Early ones said null for gains from geometry."""
    if isinstance(document, Mapping) and "bank" in document and document["bank"] is None:
        return {**document, "bank": 0}
    return document


def saved_for(bank: int | None) -> str:
    """Return the name of the setting that a bank's saved tuning is kept under; None is gains from geometry."""
    return f"tuning/{'geometry' if bank is None else bank}"


KEPT: Edge[KeptTuning] = Edge(KeptTuning, "the tuning in force", VERSION, _bank_by_number)
SAVED: Edge[SavedParts] = Edge(SavedParts, "the tuning that was saved", VERSION)
