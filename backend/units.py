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


class AngleUnit(StrEnum):
    """Unit in which somebody reads angles."""

    DEGREES = "deg"
    RADIANS = "rad"


@dataclass(frozen=True)
class DisplayUnit:
    """A unit as it is read, and the factor from SI to it."""

    unit: str
    factor: float


_IN_DEGREES = {
    "rad": DisplayUnit("°", 180.0 / math.pi),
    "rad/s": DisplayUnit("°/s", 180.0 / math.pi),
    "mrad": DisplayUnit("°", 0.18 / math.pi),
    "rad·s": DisplayUnit("°·s", 180.0 / math.pi),
}
_WRITTEN = {AngleUnit.DEGREES: "°", AngleUnit.RADIANS: " rad"}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXED = ("V", "N", "s", "m", "A")
"""Units that take a prefix where a number is small."""

_NUMBER = r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?"
_QUANTITY = re.compile(
    r"(?P<quoted>“[^”]*”)"
    rf"|(?<![\w.·])(?P<low>{_NUMBER})(?:(?P<to> to | … )(?P<high>{_NUMBER}))?"
    r" (?P<unit>rad|deg)(?P<rate>/s)?(?![\w/(·²³⁴])"
    rf"|(?<![\w.·])(?P<small>[-+−]?\d+\.?\d*e[-−]\d+) (?P<of>{'|'.join(_PREFIXED)})(?![\w/(·²³⁴])"
)
"""What is read otherwise than it is kept: an angle, its speed or a range of one, and a small number with exponent.

What somebody has written or named stands between “ and ” and stays, as does what is in ° already: it may be a phase.
"""


def counted(count: float, noun: str) -> str:
    """Return a number of things as it is said: "1 day", "30 days"."""
    return f"{count:g} {noun}" if count == 1 else f"{count:g} {noun}s"


def reading_of(unit: str, angles: AngleUnit) -> DisplayUnit:
    """Return how a quantity of this SI unit is read."""
    if angles is AngleUnit.DEGREES and unit in _IN_DEGREES:
        return _IN_DEGREES[unit]
    return DisplayUnit(unit, 1.0)


def read(value: float, unit: str, angles: AngleUnit) -> float:
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


def with_unit(number: str, unit: str) -> str:
    """Write a number with its unit as it is read: "60°", "12.5 N", "0.5" of what has no unit."""
    if unit in ("1", ""):
        return number
    return f"{number}{unit}" if unit.startswith("°") else f"{number} {unit}"


def reading_near(largest: float, unit: str, angles: AngleUnit) -> DisplayUnit:
    """Return how a quantity is read whose largest figure is this in SI: a small one with the prefix µ or n."""
    size = abs(largest)
    if unit not in _PREFIXED or not 0.0 < size < 1e-3:
        return reading_of(unit, angles)
    return DisplayUnit(f"µ{unit}", 1e6) if size >= 1e-6 else DisplayUnit(f"n{unit}", 1e9)


def percent(value: float, decimals: int = 1) -> str:
    """Write a share in %, with further decimals as long as less than the whole would read "100.0"."""
    most = next((more for more in range(decimals, 13) if float(f"{value:.{more}f}") < 100.0), decimals)
    return f"{value:.{most if value < 100.0 else decimals}f}"


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


def format_quantity(value: float, unit: str, angles: AngleUnit) -> str:
    """Write a quantity in SI with the unit in which it is read: "120°"."""
    try:
        reading = reading_near(float(value), unit, angles)
        shown = value if reading.factor == 1.0 else float(value) * reading.factor
    except OverflowError:  # beyond any float in either unit
        reading, shown = reading_of(unit, angles), value
    return with_unit(_with_power(in_digits(shown)), reading.unit)


def _with_power(number: str) -> str:
    plain, e, power = number.partition("e")
    return f"{plain}·10{str(int(power)).translate(_RAISED)}" if e and power.lstrip("+-").isdigit() else number


def format_angles(text: str, angles: AngleUnit) -> str:
    """Return ``text`` with every angle in it as it is read.

    Texts that several people read (marks, faults, ends of runs) are kept in SI and turned here. A number keeps as many
    digits as it came with, four at least.
    """
    return _QUANTITY.sub(lambda found: _turned(found, angles), text)


def _turned(found: re.Match[str], angles: AngleUnit) -> str:
    if found["quoted"]:
        return found[0]
    if found["small"]:
        return _prefixed(found["small"], found["of"])
    numbers = [number for number in (found["low"], found["high"]) if number]
    if found["unit"] != angles:
        factor = 180.0 / math.pi if angles is AngleUnit.DEGREES else math.pi / 180.0
        numbers = [_as_fine(number, factor) for number in numbers]
    return f"{(found['to'] or '').join(numbers)}{_WRITTEN[angles]}{found['rate'] or ''}"


def _prefixed(number: str, unit: str) -> str:
    reading = reading_near(float(number.replace("−", "-")), unit, AngleUnit.RADIANS)
    return with_unit(number if reading.factor == 1.0 else _as_fine(number, reading.factor), reading.unit)


def _as_fine(number: str, factor: float) -> str:
    digits = len(re.sub(r"e.*|\D", "", number).lstrip("0"))
    turned = in_digits(float(number.replace("−", "-")) * factor, min(max(digits, 4), DIGITS))
    return turned.replace("-", "−") if "−" in number else turned
