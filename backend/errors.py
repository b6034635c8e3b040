"""Errors for the user: reason or violated range, with the remedy."""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from backend.units import (
    DIGITS,
    AngleUnit,
    append_marked_unit,
    convert_to_display,
    convert_to_text,
    format_number,
    get_display_unit,
)
from plant import ErrorCode as ErrorCode
from plant import SinewError as SinewError

# Rejected requests and values ----------------------------------------------------------------------


_BOUND_DIGITS = 3
"""Significant digits of a bound that is not an integer."""

Path = tuple[str | int, ...]
"""Path of a value in a request: names, and list indices from 0.

For example ("phases", 0, "parts", 2, "q_ref").
"""

QUANTITY_LABELS = {
    "q_ref": "position reference",
    "S_ref": "stiffness reference",
    "F_push": "push",
    "q_wall": "angle of the obstacle",
    "k_wall": "stiffness of the obstacle",
    "c_wall": "damping of the obstacle",
    "load": "load on a motor's shaft",
    "lam_q": "λ_q",
    "lam_S": "λ_S",
    "lam_motor": "λ_motor",
    "u_plan": "voltage limit of time-optimal motion",
    "k_ext": "gain of the disturbance rejection",
    "tension_N": "tension",
    "duration_s": "time",
    "period_s": "period",
    "shape": "shape",
    "u": "voltage step",
    "theta_start": "motor position at the start of a step",
}
"""Labels of quantities that several modules check."""


class RequestRejectedError(SinewError):
    """A request that is not carried out.

    ``code`` is the reason for programs, ``legal`` lists the accepted values. ``retry_after_s`` is the time [s] to wait
    before another request, 0 where waiting does not help.
    """

    category: ErrorCode

    def __init__(
        self,
        category: ErrorCode,
        message: str,
        *,
        code: str | None = None,
        legal: Iterable[str] | None = None,
        retry_after_s: int = 0,
    ) -> None:
        super().__init__(message)
        self.category = category
        self.code = code or str(category)
        self.legal = None if legal is None else list(legal)
        self.retry_after_s = retry_after_s

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the error response: code and accepted values."""
        return {"code": self.code, "legal": self.legal}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error with its attributes, which its arguments do not contain."""
        return _rebuild_error, (type(self), self.args, vars(self))


class InvalidValueError(SinewError, ValueError, ABC):
    """A rejected value.

    ``quantity`` is its name in the code, ``label`` its name for people, ``path`` its place in the request.
    """

    category = ErrorCode.BAD_VALUE
    code = "bad_value"

    def __init__(self, quantity: str, *, label: str = "", path: Path | None = None) -> None:
        self.quantity = quantity
        self.label = label or QUANTITY_LABELS.get(quantity, quantity)
        self.path: Path = (quantity,) if path is None else path
        super().__init__(self.format_message(AngleUnit.RADIANS))

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the error response: code, quantity and its place."""
        return {"code": self.code, "quantity": self.quantity, "words": self.label, "path": list(self.path) or None}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error with its attributes, which its arguments do not contain."""
        return _rebuild_error, (type(self), self.args, vars(self))

    @abstractmethod
    def format_message(self, angles: AngleUnit) -> str:
        """Return the message with angles in this unit; ``str`` of the error is in SI."""


class OutOfRangeError(InvalidValueError):
    """A number outside its range.

    ``minimum`` or ``maximum`` is None where that side has no bound.
    """

    code = "out_of_range"

    def __init__(
        self,
        quantity: str,
        value: float,
        minimum: float | None,
        maximum: float | None,
        unit: str,
        remedy: str = "",
        *,
        label: str = "",
        path: Path | None = None,
    ) -> None:
        self.value = value
        self.minimum = minimum
        self.maximum = maximum
        self.unit = unit
        self.remedy = remedy
        super().__init__(quantity, label=label, path=path)

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the error response: code, quantity, value, bounds and unit."""
        bounds = {"minimum": self.minimum, "maximum": self.maximum, "unit": self.unit}
        return {**super().fields, "value": self.value, **bounds}

    def format_message(self, angles: AngleUnit) -> str:
        """Return the message with angles in this unit."""
        fault, remedy = describe_out_of_range(self.value, self.minimum, self.maximum, self.unit, angles)
        return f"{self.label}: {fault}; {self.remedy or remedy}"


def describe_out_of_range(
    value: float, minimum: float | None, maximum: float | None, unit: str, angles: AngleUnit
) -> tuple[str, str]:
    """Return the message that a value is outside its range, and a general remedy."""
    given, read_in = append_marked_unit(*convert_to_text(value, unit, angles)), get_display_unit(unit, angles).unit
    if minimum is not None and maximum is not None:
        ends = " to ".join(format_bounds(minimum, maximum, unit, angles))
        return f"{given} is outside {append_marked_unit(ends, read_in)}", "choose a value in this range"
    if maximum is not None:
        most = append_marked_unit(format_bound(maximum, unit, angles, upper=True), read_in)
        return f"{given} is more than {most}", f"choose {most} at most"
    if minimum is not None:
        least = append_marked_unit(format_bound(minimum, unit, angles, upper=False), read_in)
        return f"{given} is less than {least}", f"choose {least} at least"
    return f"{given} is not a finite number", "choose a finite number"


def format_bounds(minimum: float, maximum: float, unit: str, angles: AngleUnit) -> tuple[str, str]:
    """Format both ends of a range, with enough digits to keep them apart."""
    for digits in range(_BOUND_DIGITS, 17):
        least = format_bound(minimum, unit, angles, upper=False, digits=digits)
        most = format_bound(maximum, unit, angles, upper=True, digits=digits)
        if float(least) < float(most):
            break
    return least, most


def format_bound(bound: float, unit: str, angles: AngleUnit, *, upper: bool, digits: int = _BOUND_DIGITS) -> str:
    """Format a bound so that the displayed number lies within the range.

    Integers are written exactly, others are rounded towards the inside of the range.
    """
    if isinstance(bound, int) and get_display_unit(unit, angles).factor == 1.0:
        return str(bound)
    shown = convert_to_display(bound, unit, angles)
    text = format_number(shown, max(digits, DIGITS) if shown == round(shown) else digits)
    if math.isinf(shown) or abs(float(text) - shown) <= 1e-12 * abs(shown):
        return text
    place = 10.0 ** (math.floor(math.log10(abs(shown))) - digits + 1)
    return format_number((math.floor if upper else math.ceil)(shown / place) * place, max(digits, DIGITS))


def check_range(
    quantity: str,
    value: float,
    minimum: float | None,
    maximum: float | None,
    unit: str,
    remedy: str = "",
    *,
    label: str = "",
    path: Path | None = None,
) -> None:
    """Raise OutOfRangeError unless minimum <= value <= maximum; NaN and ±∞ raise too."""
    above = minimum is None or value >= minimum
    below = maximum is None or value <= maximum
    if not (above and below and abs(value) < float("inf")):
        raise OutOfRangeError(
            quantity=quantity,
            value=value,
            minimum=minimum,
            maximum=maximum,
            unit=unit,
            remedy=remedy,
            label=label,
            path=path,
        )


def _rebuild_error(kind: type[Exception], arguments: tuple[Any, ...], state: dict[str, Any]) -> Exception:
    error = kind.__new__(kind, *arguments)
    vars(error).update(state)
    return error


# Names of stations ---------------------------------------------------------------------------------


STATION_NAME_LENGTH = 40
_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{STATION_NAME_LENGTH - 1}}}", re.ASCII)


def check_station_name(name: str) -> str:
    """Return a station's name unchanged, or raise ValueError.

    "" is the name of the only station of a database.
    """
    if name and not _NAME.fullmatch(name):
        raise ValueError(
            f"{name[:60]!r} is not the name of a station: 1 to {STATION_NAME_LENGTH} letters, digits, dots, dashes or "
            "underscores, the first a letter or a digit; for example rig-2"
        )
    return name
