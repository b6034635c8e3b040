"""Declarations of the settings of plans: symbol, unit, bounds and default.

A plan is a frozen dataclass whose fields are made by ``number_setting``, ``integer_setting``, ``boolean_setting`` and
``choice_setting``. Command line, HTTP interface and page read the declarations with ``describe_settings``;
``build_plan`` checks external values against them.
"""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from backend.errors import InvalidValueError, Path, check_range
from backend.models.run import DeclaredValue, Value
from backend.response_docs import HIDDEN_FIELD, RESPONSE_CONFIG
from backend.units import AngleUnit, get_display_unit, parse_quantity

_KEY = "setting"
_MAX_SHOWN_CHARACTERS = 100
_BOOLEAN_WORDS = {"true": True, "yes": True, "false": False, "no": False}
_T = TypeVar("_T")


class SettingError(InvalidValueError):
    """A setting is unknown, not of its kind, or not among its choices.

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
        label: str = "",
        path: Path | None = None,
    ) -> None:
        self.value = value
        self.reason = reason
        self.unit = unit
        self.legal = legal
        super().__init__(quantity, label=label, path=path)

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the error response: code, and value, unit and choices of the setting."""
        return {**super().fields, "value": self.value, "unit": self.unit or None, "legal": list(self.legal) or None}

    def format_message(self, angles: AngleUnit) -> str:
        """Return the message with the unit that is expected.

        ``angles`` is the reader's unit of angles.
        """
        wanted = f" in {get_display_unit(self.unit, angles).unit}" if self.unit not in ("", "1") else ""
        return f"{self.label}: {repr(self.value)[:_MAX_SHOWN_CHARACTERS]} is refused: {self.reason}{wanted}"


@dataclass(frozen=True)
class Setting:
    """Declaration of one setting.

    ``kind`` is number, integer, boolean, choice or text; responses do not contain it. ``unit`` is SI, "1" for counts.
    ``maximum`` of a text is its maximum length in characters.
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
        """Return a JSON value or a command-line word as the type of the setting.

        Raises SettingError, OutOfRangeError.
        """
        if self.kind == "choice":
            choices = self.choices or ()
            if value not in choices:
                raise self._build_error(value, f"choose one of {', '.join(choices)}", choices)
            return str(value)
        if self.kind == "text":
            if not isinstance(value, str):
                raise self._build_error(value, "text is required")
            check_range(self.name, len(value), None, self.maximum, "1", label=f"length of {self.symbol}")
            return value
        if self.kind == "boolean":
            parsed = _BOOLEAN_WORDS.get(str(value).lower())
            if parsed is None:
                raise self._build_error(value, "true or false is required", ("true", "false"))
            return parsed
        number = self._parse_number(value)
        check_range(self.name, number, self.minimum, self.maximum, self.unit, label=self.meaning)
        if self.kind == "integer" and number != int(number):
            raise self._build_error(value, "a whole number is required")
        return int(number) if self.kind == "integer" else number

    def _parse_number(self, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise self._build_error(value, "a number is required")
        try:
            return parse_quantity(value, self.unit) if isinstance(value, str) else float(value)
        except (ValueError, OverflowError):
            raise self._build_error(value, "a number is required") from None

    def _build_error(self, value: object, reason: str, legal: tuple[str, ...] = ()) -> SettingError:
        return SettingError(self.name, value, reason, unit=self.unit, legal=legal, label=self.meaning)


def number_setting(default: float, minimum: float, maximum: float, unit: str, symbol: str, meaning: str) -> Any:
    """Declare a real number as a setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare_setting("number", default, {**bounds, "unit": unit, "symbol": symbol, "meaning": meaning})


def integer_setting(default: int, minimum: int, maximum: int, symbol: str, meaning: str) -> Any:
    """Declare a whole number as a setting of a plan."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return _declare_setting("integer", default, {**bounds, "unit": "1", "symbol": symbol, "meaning": meaning})


def choice_setting(default: str, choices: tuple[str, ...], symbol: str, meaning: str) -> Any:
    """Declare a setting with one of several words as its value."""
    return _declare_setting("choice", default, {"choices": choices, "unit": "1", "symbol": symbol, "meaning": meaning})


def boolean_setting(default: bool, symbol: str, meaning: str) -> Any:
    """Declare a setting that is true or false."""
    return _declare_setting("boolean", default, {"unit": "1", "symbol": symbol, "meaning": meaning})


def describe_settings(plan: type[Any]) -> tuple[Setting, ...]:
    """Return the declared settings of a plan, in order."""
    return tuple(_build_setting(item) for item in fields(plan) if _KEY in item.metadata)


def build_plan(plan: type[_T], values: Mapping[str, object]) -> _T:
    """Return a plan with these values, and defaults for the others.

    Raises SettingError, OutOfRangeError.
    """
    known = {setting.name: setting for setting in describe_settings(plan)}
    for name, value in values.items():
        if name not in known:
            legal = tuple(known)
            raise SettingError(name, value, f"unknown setting; choose one of {', '.join(legal)}", legal=legal)
    return plan(**{name: known[name].parse(value) for name, value in values.items()})


def describe_values(*chosen: Any) -> tuple[DeclaredValue, ...]:
    """Return the settings of plans with symbol, unit, meaning and chosen value."""
    return tuple(
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, getattr(item, setting.name))
        for item in chosen
        for setting in describe_settings(type(item))
    )


def _declare_setting(kind: str, default: object, declaration: dict[str, object]) -> Any:
    return field(default=default, metadata={_KEY: {"kind": kind, "default": default, **declaration}})


def _build_setting(item: "Field[Any]") -> Setting:
    return Setting(name=item.name, **item.metadata[_KEY])
