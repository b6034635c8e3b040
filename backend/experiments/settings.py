"""Declared settings: what a plan may be told, each with symbol, unit, bounds and default, said once.

A plan is a frozen dataclass whose fields are made by ``number``, ``integer`` and ``choice``. The command line, the HTTP
interface and the page read the same declaration through ``describe``; ``from_values`` is the only way in from outside.
"""

import math
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

_KEY = "setting"
_T = TypeVar("_T")


class SettingError(ValueError):
    """A setting is refused: which one, what came, what is allowed, in which unit."""

    def __init__(
        self,
        quantity: str,
        value: object,
        reason: str,
        *,
        minimum: float | None = None,
        maximum: float | None = None,
        unit: str = "",
        legal: tuple[str, ...] = (),
    ) -> None:
        super().__init__(f"{quantity} = {value!r} refused: {reason}")
        self.quantity = quantity
        self.value = value
        self.minimum = minimum
        self.maximum = maximum
        self.unit = unit
        self.legal = legal


@dataclass(frozen=True)
class Setting:
    """Declaration of one setting. ``unit`` is SI, "1" for counts; ``kind`` is number, integer or choice."""

    name: str
    kind: str
    symbol: str
    unit: str
    meaning: str
    default: float | int | str
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()

    def parse(self, value: object) -> float | int | str:
        """Turn a JSON value or a command-line word into the setting's type, inside its bounds. Raises SettingError."""
        if self.kind == "choice":
            if value not in self.choices:
                raise SettingError(
                    self.name, value, f"choose one of {', '.join(self.choices)}", legal=self.choices, unit=self.unit
                )
            return str(value)
        number = self._number(value)
        if self.kind == "integer" and number != int(number):
            raise self._refusal(value, "needs a whole number")
        if not self._low <= number <= self._high:
            raise self._refusal(value, f"must lie between {self._low:g} and {self._high:g} {self._shown_unit}".rstrip())
        return int(number) if self.kind == "integer" else number

    def _number(self, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise self._refusal(value, f"needs a number in {self._shown_unit or 'counts'}")
        try:
            number = float(value)
        except (ValueError, OverflowError):
            raise self._refusal(value, f"is not a number (in {self._shown_unit or 'counts'})") from None
        if not math.isfinite(number):
            raise self._refusal(value, "must be finite")
        return number

    def _refusal(self, value: object, reason: str) -> SettingError:
        return SettingError(self.name, value, reason, minimum=self.minimum, maximum=self.maximum, unit=self.unit)

    @property
    def _low(self) -> float:
        return -math.inf if self.minimum is None else self.minimum

    @property
    def _high(self) -> float:
        return math.inf if self.maximum is None else self.maximum

    @property
    def _shown_unit(self) -> str:
        return "" if self.unit == "1" else self.unit


def number(default: float, minimum: float, maximum: float, unit: str, symbol: str, meaning: str) -> Any:
    """Declare a real setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare("number", default, {**bounds, "unit": unit, "symbol": symbol, "meaning": meaning})


def integer(default: int, minimum: int, maximum: int, symbol: str, meaning: str) -> Any:
    """Declare a whole-number setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare("integer", default, {**bounds, "unit": "1", "symbol": symbol, "meaning": meaning})


def choice(default: str, choices: tuple[str, ...], symbol: str, meaning: str) -> Any:
    """Declare a setting that takes one of a few words."""
    return _declare("choice", default, {"choices": choices, "unit": "1", "symbol": symbol, "meaning": meaning})


def describe(plan: type[Any]) -> tuple[Setting, ...]:
    """Return the declared settings of a plan, in order."""
    return tuple(_setting(item) for item in fields(plan) if _KEY in item.metadata)


def from_values(plan: type[_T], values: Mapping[str, object]) -> _T:
    """Build a plan from named values; what is left out keeps its default. Raises SettingError."""
    known = {setting.name: setting for setting in describe(plan)}
    for name, value in values.items():
        if name not in known:
            legal = tuple(known)
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return plan(**{name: known[name].parse(value) for name, value in values.items()})


def _declare(kind: str, default: object, declaration: dict[str, object]) -> Any:
    return field(default=default, metadata={_KEY: {"kind": kind, "default": default, **declaration}})


def _setting(item: "Field[Any]") -> Setting:
    return Setting(name=item.name, **item.metadata[_KEY])
