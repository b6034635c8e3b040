"""The banks that the settings of a run name by their numbers: the one it began with, and those on its way. Pure.

A change of the tuning names a bank by a number, or by a setting that is one. What computes the number otherwise can be
given no other one, and is told.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from backend.documents.edge import Document
from backend.documents.run_settings import loop_apart

BANK = "bank"
LARGEST = 2**31 - 1
"""Number of a record that no database exceeds."""


@dataclass(frozen=True)
class OnTheWay:
    """The banks that a plan puts into use, and the expressions that compute the number of one."""

    numbers: frozenset[int]
    computed: tuple[str, ...]


def on_the_way(settings: Mapping[str, Any]) -> OnTheWay:
    """Return the banks that a run changes to on its way; 0, gains from geometry, is none."""
    numbers: set[int] = set()

    def noted(number: int) -> int:
        numbers.add(number)
        return number

    renumbering = _Renumbering(noted, settings.get("plan"))
    return OnTheWay(frozenset(numbers), tuple(renumbering.computed))


def with_banks(settings: Mapping[str, Any], number: Callable[[int], int]) -> Document:
    """Return settings that name each bank by another number."""
    document = dict(loop_apart(settings))
    renumbering = _Renumbering(number, document.get("plan"))
    if isinstance(document.get("plan"), Mapping):
        document["plan"] = renumbering.plan
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping) and BANK in loop:
        document["loop"] = {**loop, BANK: renumbering.value(loop[BANK])}
    if isinstance(declared, list):
        document["declared"] = [renumbering.declared(one) for one in declared]
    return document


def without_bank(settings: Mapping[str, Any]) -> Document:
    """Return settings that say nothing of the bank that the run began with."""
    document = dict(loop_apart(settings))
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping):
        document["loop"] = {name: value for name, value in loop.items() if name != BANK}
    if isinstance(declared, list):
        document["declared"] = [one for one in declared if not isinstance(one, Mapping) or one.get("name") != BANK]
    return document


class _Renumbering:
    """A plan with other numbers of banks; ``settings`` of it are numbers of banks too."""

    def __init__(self, number: Callable[[int], int], plan: Any) -> None:
        self._number = number
        self._values: Mapping[str, Any] = plan if isinstance(plan, Mapping) else {}
        self._settings: set[str] = set()
        self.computed: list[str] = []
        experiment = _experiment(self._values)
        phases = self._part(experiment.get("phases"))
        self.plan = {
            name: self.value(value) if name in self._settings else value for name, value in self._values.items()
        }
        if self._settings or phases != experiment.get("phases"):
            renumbered = {**experiment, "phases": phases}
            if isinstance(experiment.get("settings"), list):
                renumbered["settings"] = [self._unbounded(one) for one in experiment["settings"]]
            self.plan["experiment"] = json.dumps(renumbered, ensure_ascii=False, separators=(",", ":"))

    def value(self, value: Any) -> Any:
        """Return what stands in the place of the number of a bank."""
        number = _whole(value)
        return self._number(number) if number else value

    def declared(self, one: Any) -> Any:
        """Return a declared value, of a bank with the other number."""
        named = isinstance(one, Mapping) and one.get("name") in {BANK, *self._settings}
        return {**one, "value": self.value(one.get("value"))} if named else one

    def _part(self, part: Any) -> Any:
        """Return a part of an experiment, as far as it is played."""
        if isinstance(part, list):
            return [self._part(one) for one in part]
        if not isinstance(part, Mapping):
            return part
        match part.get("do"):
            case "tuning" if part.get(BANK) is not None:
                return {**part, BANK: self._named(part[BANK])}
            case "choose" if isinstance(part.get("of"), Mapping):
                chosen = str(self._values.get(str(part.get("by"))))
                played = {name: self._part(one) if name == chosen else one for name, one in part["of"].items()}
                return {**part, "of": played}
            case _:
                return {**part, "parts": self._part(part["parts"])} if "parts" in part else part

    def _named(self, bank: Any) -> Any:
        if isinstance(bank, str) and _whole(self._values.get(bank)) is not None:
            self._settings.add(bank)
            self.value(self._values[bank])
            return bank
        if _whole(bank) is None:
            self.computed.append(str(bank))
        return self.value(bank)

    def _unbounded(self, setting: Any) -> Any:
        """Return a setting that is the number of a bank with the bounds of such numbers: elsewhere it is another."""
        if not isinstance(setting, Mapping) or setting.get("name") not in self._settings:
            return setting
        return {**setting, "minimum": 0, "maximum": LARGEST}


def _experiment(plan: Mapping[str, Any]) -> Mapping[str, Any]:
    try:
        found = json.loads(plan["experiment"])
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, Mapping) else {}


def _whole(value: Any) -> int | None:
    """Return a number of a bank; None for what is none as it stands."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return int(float(value))
    except (ValueError, OverflowError):
        return None
