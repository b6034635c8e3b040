"""Several structures on one record, ranked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backend.identification.errors import NoStartError, NotContinuousError, NotConvergedError
from backend.identification.estimate import estimate, with_hint
from backend.identification.fit import Method
from backend.identification.record import Record
from backend.identification.result import Estimate, Grade


@dataclass(frozen=True)
class Candidates:
    """Estimates of one record, best first, and the structures that gave none with the reason."""

    ranked: tuple[Estimate, ...]
    failed: dict[str, str]

    @property
    def best(self) -> Estimate:
        """First of the ranking."""
        return self.ranked[0]

    def to_json(self) -> dict[str, Any]:
        """Plain dictionaries, lists and numbers."""
        return {"ranked": [candidate.to_json() for candidate in self.ranked], "failed": self.failed}


def rank(
    record: Record,
    structures: Sequence[str],
    method: Method = Method.DEFAULT,
    *,
    gain_geometry: float | None = None,
    y_resolution: float | None = None,
) -> Candidates:
    """Estimate each structure and rank: usable ones before unusable ones, then by BIC, which charges for parameters.

    Arguments as for :func:`estimate`. Raises StructureError, and NotConvergedError if no structure gives a model.
    """
    found, failed = [], {}
    for name in structures:
        try:
            one = estimate(record, name, method, gain_geometry=gain_geometry, y_resolution=y_resolution, hint=False)
            found.append(one)
        except (NotConvergedError, NoStartError, NotContinuousError) as error:
            failed[name] = str(error)
    if not found:
        raise NotConvergedError("; ".join(failed.values()))
    best, *others = sorted(found, key=_rank)
    return Candidates((with_hint(record, best), *others), failed)


def _rank(candidate: Estimate) -> tuple[bool, float]:
    return candidate.verdict.grade is Grade.UNUSABLE, candidate.residuals.BIC
