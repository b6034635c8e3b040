"""Refusals: the reason, or the quantity with its value, bounds and unit, and what to do."""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from backend.units import DIGITS, AngleUnit, format_quantity, in_digits, read, reading_of, with_unit
from plant import ErrorCode as ErrorCode
from plant import SinewError as SinewError

# Refusal -------------------------------------------------------------------------------------------
#
# What is said when something is refused: why, or which quantity in the operator's words, its
# bounds, what to do.


_DIGITS_OF_BOUND = 3
"""Significant digits of a bound that is no whole number: enough to choose by."""

Path = tuple[str | int, ...]
"""Where a value stands in what was asked for: names, and places in lists from 0; ("phases", 0, "parts", 2, "q_ref")."""

WORDS = {
    "q_ref": "position reference",
    "S_ref": "stiffness reference",
    "F_push": "push",
    "q_wall": "angle of the wall",
    "k_wall": "stiffness of the wall",
    "c_wall": "damping of the wall",
    "load": "load of a motor's shaft",
    "lam_q": "λ_q",
    "lam_S": "λ_S",
    "lam_motor": "λ_motor",
    "u_plan": "voltage limit of time-optimal motion",
    "k_ext": "share of the outside force that is rejected",
    "tension_N": "tension",
    "duration_s": "time",
    "period_s": "period",
    "shape": "shape",
    "u": "voltage step",
    "theta_start": "motor position where a step starts",
}
"""Operator's words for quantities that are refused at several places."""


class RequestRejectedError(SinewError):
    """Something asked for is not done. ``code`` tells programs why, ``legal`` lists what would be accepted.

    ``retry_after_s`` is how long [s] to wait before asking again, 0 where waiting is not what helps.
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
        """Code, and what would be accepted."""
        return {"code": self.code, "legal": self.legal}

    def __reduce__(self) -> tuple[Any, ...]:
        """Come from one process to another as it is: it is not made of its words alone."""
        return _as_it_was, (type(self), self.args, vars(self))


class InvalidValueError(SinewError, ValueError, ABC):
    """A value that is not taken. ``quantity`` is its name in the code, ``words`` the operator's, ``path`` its place."""

    category = ErrorCode.BAD_VALUE
    code = "bad_value"

    def __init__(self, quantity: str, *, words: str = "", path: Path | None = None) -> None:
        self.quantity = quantity
        self.words = words or WORDS.get(quantity, quantity)
        self.path: Path = (quantity,) if path is None else path
        super().__init__(self.sentence(AngleUnit.RADIANS))

    @property
    def fields(self) -> dict[str, Any]:
        """Code, and the refused quantity with its place."""
        return {"code": self.code, "quantity": self.quantity, "words": self.words, "path": list(self.path) or None}

    def __reduce__(self) -> tuple[Any, ...]:
        """Come from one process to another as it is: it is not made of its words alone."""
        return _as_it_was, (type(self), self.args, vars(self))

    @abstractmethod
    def sentence(self, angles: AngleUnit) -> str:
        """Say it to somebody who reads angles in this unit; the text of the exception itself is in SI."""


class OutOfRangeError(InvalidValueError):
    """A number outside what is allowed. ``minimum`` or ``maximum`` is None where that side has no bound."""

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
        words: str = "",
        path: Path | None = None,
    ) -> None:
        self.value = value
        self.minimum = minimum
        self.maximum = maximum
        self.unit = unit
        self.remedy = remedy
        super().__init__(quantity, words=words, path=path)

    @property
    def fields(self) -> dict[str, Any]:
        """Code, and the refused quantity with its value, bounds and unit."""
        bounds = {"minimum": self.minimum, "maximum": self.maximum, "unit": self.unit}
        return {**super().fields, "value": self.value, **bounds}

    def sentence(self, angles: AngleUnit) -> str:
        """Say it to somebody who reads angles in this unit."""
        fault, remedy = out_of_range(self.value, self.minimum, self.maximum, self.unit, angles)
        return f"{self.words}: {fault}; {self.remedy or remedy}"


def out_of_range(
    value: float, minimum: float | None, maximum: float | None, unit: str, angles: AngleUnit
) -> tuple[str, str]:
    """Return in words that a value is outside its bounds, and what can be done where nothing better is known."""
    given, read_in = format_quantity(value, unit, angles), reading_of(unit, angles).unit
    if minimum is not None and maximum is not None:
        ends = " to ".join(bound_texts(minimum, maximum, unit, angles))
        return f"{given} is outside {with_unit(ends, read_in)}", "choose a value between the two"
    if maximum is not None:
        most = with_unit(bound_text(maximum, unit, angles, upper=True), read_in)
        return f"{given} is more than {most}", f"choose {most} at most"
    if minimum is not None:
        least = with_unit(bound_text(minimum, unit, angles, upper=False), read_in)
        return f"{given} is less than {least}", f"choose {least} at least"
    return f"{given} is not a finite number", "choose a finite one"


def bound_texts(minimum: float, maximum: float, unit: str, angles: AngleUnit) -> tuple[str, str]:
    """Write both ends of a range, in as many digits as it takes to leave something between them."""
    for digits in range(_DIGITS_OF_BOUND, 17):
        least = bound_text(minimum, unit, angles, upper=False, digits=digits)
        most = bound_text(maximum, unit, angles, upper=True, digits=digits)
        if float(least) < float(most):
            break
    return least, most


def bound_text(bound: float, unit: str, angles: AngleUnit, *, upper: bool, digits: int = _DIGITS_OF_BOUND) -> str:
    """Write a bound so that the number which is read lies within it: a whole one, or rounded towards the inside."""
    if isinstance(bound, int) and reading_of(unit, angles).factor == 1.0:
        return str(bound)
    shown = read(bound, unit, angles)
    text = in_digits(shown, max(digits, DIGITS) if shown == round(shown) else digits)
    if math.isinf(shown) or abs(float(text) - shown) <= 1e-12 * abs(shown):
        return text
    place = 10.0 ** (math.floor(math.log10(abs(shown))) - digits + 1)
    return in_digits((math.floor if upper else math.ceil)(shown / place) * place, max(digits, DIGITS))


def check_range(
    quantity: str,
    value: float,
    minimum: float | None,
    maximum: float | None,
    unit: str,
    remedy: str = "",
    *,
    words: str = "",
    path: Path | None = None,
) -> None:
    """Raise OutOfRangeError unless minimum <= value <= maximum; nan and infinities are refused too."""
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
            words=words,
            path=path,
        )


def _as_it_was(kind: type[Exception], words: tuple[Any, ...], state: dict[str, Any]) -> Exception:
    error = kind.__new__(kind, *words)
    vars(error).update(state)
    return error


# Station -------------------------------------------------------------------------------------------
#
# What a station may be called: a rig with a service of its own, among several on one database.
# Pure.


STATION_MAX = 40
_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{STATION_MAX - 1}}}", re.ASCII)


def require_station_name(name: str) -> str:
    """Return a station's name as it is; "" is the only station of a database. Raises ValueError."""
    if name and not _NAME.fullmatch(name):
        raise ValueError(
            f"{name[:60]!r} is no name of a station: 1 to {STATION_MAX} letters, digits, dots, dashes or underscores, "
            "the first a letter or a digit; for example rig-2"
        )
    return name
