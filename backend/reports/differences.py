"""What does not hold of a report, and how two documents are compared number by number."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

LIKE = 1e-9
"""Share by which a number may differ where another machine has computed it again."""

LIKE_ESTIMATE = 1e-4
"""The same of what an optimizer ends at: its standard errors are known to five digits."""

MOST = 50
"""Differences that are told; who finds so many needs no more."""

EVERYTHING = "every number, criterion, parameter and hash"


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
    """What was ``compared``: differences, and what could not be compared with the reason."""

    differences: tuple[Difference, ...]
    left_out: tuple[str, ...]
    compared: str = EVERYTHING

    @property
    def holds(self) -> bool | None:
        """Whether all of it holds; None where nothing differs, but something was not compared."""
        if self.differences:
            return False
        return None if self.left_out else True


def not_made(name: str, wanted: str, error: Exception) -> Difference:
    """Return the difference that something of a report cannot be made again, whatever is wrong with it."""
    return Difference(name, wanted, f"{type(error).__name__}: {error}"[:200])


def differing(name: str, said: Any, found: Any, like: float = LIKE, floor: float = 1e-15) -> Iterator[Difference]:
    """Compare two documents, part by part; parts of lists are called by their own name, where they have one.

    Numbers may differ by the share ``like`` of themselves, those of a list of the largest, and by ``floor``.
    """
    if isinstance(said, Mapping) and isinstance(found, Mapping):
        for part in dict.fromkeys([*said, *found]):
            yield from differing(f"{name}, {part}", said.get(part), found.get(part), like)
    elif _is_list(said) and _is_list(found) and len(said) == len(found):
        largest = max((abs(one) for one in found if isinstance(one, float)), default=0.0)
        for place, (one, other) in enumerate(zip(said, found, strict=True)):
            called = one.get("name") if isinstance(one, Mapping) else None
            yield from differing(f"{name}, {called or place + 1}", one, other, like, max(floor, like * largest))
    elif not _alike(said, found, like, floor):
        yield Difference(name, _short(said), _short(found))


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _alike(said: Any, found: Any, like: float, floor: float) -> bool:
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (said, found))
    try:
        return math.isclose(said, found, rel_tol=like, abs_tol=floor) if numbers else bool(said == found)
    except OverflowError:  # a whole number beyond any float
        return bool(said == found)


def _short(value: Any) -> str:
    return "nothing" if value is None else str(value)[:80]
