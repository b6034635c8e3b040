"""Declared settings: what a plan may be told, each with symbol, unit, bounds and default, said once.

A plan is a frozen dataclass whose fields are made by ``number_setting``, ``integer_setting``, ``boolean_setting``,
``choice_setting``. The command line, the HTTP interface and the page read the same declaration
through ``describe_settings``; ``build_plan`` is the only way in from outside.
"""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from backend.errors import InvalidValueError, Path, check_range
from backend.models.run import DeclaredValue, Value
from backend.response_docs import HIDDEN_FIELD, RESPONSE_CONFIG
from backend.units import AngleUnit, get_display_unit, parse_quantity

_KEY = "setting"
_SHOWN = 100
_WORDS = {"true": True, "yes": True, "false": False, "no": False}
_T = TypeVar("_T")


class SettingError(InvalidValueError):
    """A setting that is not even of the right kind: unknown, no number, not among the choices.

    A number outside its bounds raises ``backend.errors.OutOfRangeError`` instead.
    """

    code = "bad_setting"

    def __init__(
        self,
        quantity: str,
        value: object,
        reason: str,
        *,
        unit: str = "",
        legal: tuple[str, ...] = (),
        words: str = "",
        path: Path | None = None,
    ) -> None:
        self.value = value
        self.reason = reason
        self.unit = unit
        self.legal = legal
        super().__init__(quantity, words=words, path=path)

    @property
    def fields(self) -> dict[str, Any]:
        """Code, and the refused setting with its value and what would be accepted."""
        return {**super().fields, "value": self.value, "unit": self.unit or None, "legal": list(self.legal) or None}

    def format_message(self, angles: AngleUnit) -> str:
        """Say it to somebody who reads angles in this unit; a number is wanted in it, where the quantity has one."""
        wanted = f" in {get_display_unit(self.unit, angles).unit}" if self.unit not in ("", "1") else ""
        return f"{self.words}: {repr(self.value)[:_SHOWN]} is refused: {self.reason}{wanted}"


@dataclass(frozen=True)
class Setting:
    """Declaration of one setting. ``unit`` is SI, "1" for counts; ``kind`` is number, integer, boolean, choice or text.

    ``maximum`` of a text is its longest length in characters. Forms are sent all of it but the kind.
    """

    __pydantic_config__ = RESPONSE_CONFIG

    name: str
    kind: str = field(metadata=HIDDEN_FIELD)
    symbol: str
    unit: str
    meaning: str
    default: Value
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] | None = None

    def parse(self, value: object) -> Value:
        """Turn a JSON value or a command-line word into the setting's type, inside its bounds.

        Raises SettingError or OutOfRangeError.
        """
        if self.kind == "choice":
            choices = self.choices or ()
            if value not in choices:
                raise self._refused(value, f"choose one of {', '.join(choices)}", choices)
            return str(value)
        if self.kind == "text":
            if not isinstance(value, str):
                raise self._refused(value, "it needs a text")
            check_range(self.name, len(value), None, self.maximum, "1", words=f"length of {self.symbol}")
            return value
        if self.kind == "boolean":
            truth = _WORDS.get(str(value).lower())
            if truth is None:
                raise self._refused(value, "it needs true or false", ("true", "false"))
            return truth
        number = self._number(value)
        check_range(self.name, number, self.minimum, self.maximum, self.unit, words=self.meaning)
        if self.kind == "integer" and number != int(number):
            raise self._refused(value, "it needs a whole number")
        return int(number) if self.kind == "integer" else number

    def _number(self, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise self._refused(value, "it needs a number")
        try:
            return parse_quantity(value, self.unit) if isinstance(value, str) else float(value)
        except (ValueError, OverflowError):
            raise self._refused(value, "it needs a number") from None

    def _refused(self, value: object, reason: str, legal: tuple[str, ...] = ()) -> SettingError:
        return SettingError(self.name, value, reason, unit=self.unit, legal=legal, words=self.meaning)


def number_setting(default: float, minimum: float, maximum: float, unit: str, symbol: str, meaning: str) -> Any:
    """Declare a real setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare("number", default, {**bounds, "unit": unit, "symbol": symbol, "meaning": meaning})


def integer_setting(default: int, minimum: int, maximum: int, symbol: str, meaning: str) -> Any:
    """Declare a whole-number setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare("integer", default, {**bounds, "unit": "1", "symbol": symbol, "meaning": meaning})


def choice_setting(default: str, choices: tuple[str, ...], symbol: str, meaning: str) -> Any:
    """Declare a setting that takes one of a few words."""
    return _declare("choice", default, {"choices": choices, "unit": "1", "symbol": symbol, "meaning": meaning})


def boolean_setting(default: bool, symbol: str, meaning: str) -> Any:
    """Declare a setting that is on or off."""
    return _declare("boolean", default, {"unit": "1", "symbol": symbol, "meaning": meaning})


def describe_settings(plan: type[Any]) -> tuple[Setting, ...]:
    """Return the declared settings of a plan, in order."""
    return tuple(_setting(item) for item in fields(plan) if _KEY in item.metadata)


def build_plan(plan: type[_T], values: Mapping[str, object]) -> _T:
    """Build a plan from named values; what is left out keeps its default. Raises SettingError, OutOfRangeError."""
    known = {setting.name: setting for setting in describe_settings(plan)}
    for name, value in values.items():
        if name not in known:
            legal = tuple(known)
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return plan(**{name: known[name].parse(value) for name, value in values.items()})


def describe_values(*chosen: Any) -> tuple[DeclaredValue, ...]:
    """Return what was chosen with symbol, unit and meaning, so that a stored run explains itself."""
    return tuple(
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, getattr(item, setting.name))
        for item in chosen
        for setting in describe_settings(type(item))
    )


def _declare(kind: str, default: object, declaration: dict[str, object]) -> Any:
    return field(default=default, metadata={_KEY: {"kind": kind, "default": default, **declaration}})


def _setting(item: "Field[Any]") -> Setting:
    return Setting(name=item.name, **item.metadata[_KEY])
