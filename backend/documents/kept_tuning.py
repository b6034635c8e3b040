"""A tuning that outlives the service: the one in force with the plant it was for, the one saved for a bank. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from backend.documents.edge import Edge
from backend.documents.run_settings import KeptLoop, motion_named

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


def _current_form(document: Any) -> Any:
    """Return a kept tuning in today's form: early ones had null for gains from geometry, and named no motion."""
    if isinstance(document, Mapping) and "bank" in document and document["bank"] is None:
        document = {**document, "bank": 0}
    return motion_named(document)


def saved_for(bank: int | None) -> str:
    """Return the name of the setting that a bank's saved tuning is kept under; None is gains from geometry."""
    return f"tuning/{'geometry' if bank is None else bank}"


KEPT: Edge[KeptTuning] = Edge(KeptTuning, "the tuning in force", VERSION, _current_form)
SAVED: Edge[SavedParts] = Edge(SavedParts, "the tuning that was saved", VERSION, motion_named)
