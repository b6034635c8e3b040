"""How a quantity is read: SI inside and on the wire, angles in degrees or radians as the person chose.

What is converted hangs on the unit alone. Gains (N·m/rad, rad/(V·s)) and angular frequencies ω stay as the paper has
them; docs/decisions/0025-angles.md says why.
"""

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

DIGITS = 6
"""Significant digits of a number that a person reads."""


class Angles(StrEnum):
    """Unit in which somebody reads angles."""

    DEGREES = "deg"
    RADIANS = "rad"


@dataclass(frozen=True)
class Reading:
    """A unit as it is read, and the factor from SI to it."""

    unit: str
    factor: float


_IN_DEGREES = {
    "rad": Reading("deg", 180.0 / math.pi),
    "rad/s": Reading("deg/s", 180.0 / math.pi),
    "mrad": Reading("deg", 0.18 / math.pi),
    "rad·s": Reading("deg·s", 180.0 / math.pi),
}

_NUMBER = r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?"
_ANGLE = re.compile(
    rf"(?<![\w.])(?P<low>{_NUMBER})(?:(?P<to> to | … )(?P<high>{_NUMBER}))? "
    r"(?P<unit>rad|deg)(?P<rate>/s)?(?![\w/(·²³⁴])"
)
"""An angle or an angular speed in a text, or a range of one: "1.2 rad", "-1.4 to 1.4 rad"."""


def counted(count: float, noun: str) -> str:
    """Return a number of things as it is said: "1 day", "30 days"."""
    return f"{count:g} {noun}" if count == 1 else f"{count:g} {noun}s"


def reading_of(unit: str, angles: Angles) -> Reading:
    """Return how a quantity of this SI unit is read."""
    if angles is Angles.DEGREES and unit in _IN_DEGREES:
        return _IN_DEGREES[unit]
    return Reading(unit, 1.0)


def read(value: float, unit: str, angles: Angles) -> float:
    """Return a quantity in SI as the number that is read."""
    return value * reading_of(unit, angles).factor


def typed(text: str, unit: str) -> float:
    """Return a word of the command line in SI: "60deg" and "1.05rad" where an angle is wanted, else a number in SI.

    Raises ValueError.
    """
    word = text.strip().lower().replace("°", "deg").replace("−", "-")
    if unit == "rad" and word.endswith("deg"):
        return math.radians(float(word.removesuffix("deg")))
    return float(word.removesuffix("rad") if unit == "rad" else word)


def in_digits(value: float, digits: int = DIGITS) -> str:
    """Write a number with so many significant digits at most; whole numbers beyond any float by their length."""
    try:
        return f"{float(value) + 0.0:.{digits}g}"
    except OverflowError:
        return f"a number of {len(str(abs(int(value))))} digits"


def digits_apart(values: Collection[float], least: int = 4) -> int:
    """Return how many significant digits it takes, ``least`` or more, until different numbers read differently."""
    different = len(set(values))
    return next(
        digits for digits in range(least, 18) if len({in_digits(value, digits) for value in values}) == different
    )


def digits_over(values: Collection[float], least: int = 4) -> int:
    """Return how many digits it takes, ``least`` or more, to tell a twentieth of the stretch of the values."""
    low, high = min(values, default=0.0), max(values, default=0.0)
    return digits_apart((low, low + (high - low) / 20, high), least)


def told(value: float, unit: str, angles: Angles) -> str:
    """Write a quantity in SI with the unit in which it is read: "120 deg"."""
    reading = reading_of(unit, angles)
    try:
        shown = value if reading.factor == 1.0 else float(value) * reading.factor
    except OverflowError:
        shown = value  # beyond any float in either unit
    return in_digits(shown) if unit in ("1", "") else f"{in_digits(shown)} {reading.unit}"


def in_words(text: str, angles: Angles) -> str:
    """Return ``text`` with every angle in it as it is read.

    Texts that several people read (marks, faults, ends of runs) are kept in SI and turned here. A number keeps as many
    digits as it came with, four at least.
    """
    return _ANGLE.sub(lambda found: _turned(found, angles), text)


def _turned(found: re.Match[str], angles: Angles) -> str:
    if found["unit"] == angles:
        return found[0]
    factor = 180.0 / math.pi if angles is Angles.DEGREES else math.pi / 180.0
    numbers = [_as_fine(number, factor) for number in (found["low"], found["high"]) if number]
    return f"{(found['to'] or '').join(numbers)} {angles}{found['rate'] or ''}"


def _as_fine(number: str, factor: float) -> str:
    digits = len(re.sub(r"e.*|\D", "", number).lstrip("0"))
    turned = in_digits(float(number.replace("−", "-")) * factor, min(max(digits, 4), DIGITS))
    return turned.replace("-", "−") if "−" in number else turned
