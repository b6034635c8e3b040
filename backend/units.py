"""Converts and formats quantities for people.

Inside Sinew and on the wire all quantities are in SI. A person reads angles in degrees or radians; the unit alone
decides what is converted. Gains (N·m/rad, rad/(V·s)) and angular frequencies ω keep the units of the paper, see
docs/decisions/0025-angles.md.
"""

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from plant import ESCAPE, PREFIXED, UNIT_MARK, write_number

DIGITS = 6
"""Significant digits of a displayed number."""


class AngleUnit(StrEnum):
    """Display unit of angles."""

    DEGREES = "deg"
    RADIANS = "rad"


@dataclass(frozen=True)
class DisplayUnit:
    """A displayed unit and the factor from SI to it."""

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
_NUMBER = r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?"
_QUANTITY = re.compile(
    rf"(?<![\w.·])(?P<low>{_NUMBER})(?:(?P<to> to | … )(?P<high>{_NUMBER}))?"
    rf"{UNIT_MARK}(?!{ESCAPE})(?:(?P<angle>rad|deg|°)(?P<rate>/s)?|(?P<unit>{'|'.join(PREFIXED)}))(?![\w/(·²³⁴])"
)
"""A marked quantity that is displayed differently: an angle, an angular speed, a range of them, or a small number."""

_UNMARKED = re.compile(
    r"(?P<quoted>“[^”]*”)"
    rf"|(?<![\w.·])(?P<number>(?:{_NUMBER}(?: to | … ))?{_NUMBER}) (?P<unit>(?:rad|deg)(?:/s)?)(?![\w/(·²³⁴])"
    rf"|(?<![\w.·])(?P<small>[-+−]?\d+\.?\d*e[-−]\d+) (?P<of>{'|'.join(PREFIXED)})(?![\w/(·²³⁴])"
)
_ESCAPED = re.compile(f"{UNIT_MARK}({ESCAPE}*)")


def format_count(count: float, noun: str) -> str:
    """Return a number of things with its noun: "1 day", "30 days". Integers are exact."""
    number = f"{count:g}" if isinstance(count, float) else str(count)
    return f"{number} {noun}" if count == 1 else f"{number} {noun}s"


def get_display_unit(unit: str, angles: AngleUnit) -> DisplayUnit:
    """Return the unit in which a quantity of an SI unit is displayed."""
    if angles is AngleUnit.DEGREES and unit in _IN_DEGREES:
        return _IN_DEGREES[unit]
    return DisplayUnit(unit, 1.0)


def convert_to_display(value: float, unit: str, angles: AngleUnit) -> float:
    """Convert a quantity from SI to its display unit."""
    return value * get_display_unit(unit, angles).factor


def parse_quantity(text: str, unit: str) -> float:
    """Parse an argument of the command line into SI.

    Angles take a unit, "60deg" or "1.05rad"; other quantities are plain numbers. Raises ValueError.
    """
    word = text.strip().lower().replace("°", "deg").replace("−", "-")
    if unit == "rad" and word.endswith("deg"):
        return math.radians(float(word.removesuffix("deg")))
    return float(word.removesuffix("rad") if unit == "rad" else word)


def format_number(value: float, digits: int = DIGITS) -> str:
    """Format a number with at most ``digits`` significant digits.

    An integer beyond the range of a float is described by its length.
    """
    return write_number(value, f".{digits}g")


def append_unit(number: str, unit: str) -> str:
    """Append a unit to a number: "60°", "12.5 N", "0.5" without a unit."""
    if unit in ("1", ""):
        return number
    return f"{number}{unit}" if unit.startswith("°") else f"{number} {unit}"


def append_marked_unit(number: str, unit: str) -> str:
    """Return a displayed number with its unit; ``format_text`` converts an angle for a person with another unit."""
    return f"{number}{UNIT_MARK}{unit}" if unit.startswith(("°", "rad")) else append_unit(number, unit)


def choose_display_unit(largest: float, unit: str, angles: AngleUnit) -> DisplayUnit:
    """Return the display unit of a quantity by its largest value in SI.

    Small values get the prefix µ or n.
    """
    size = abs(largest)
    if unit not in PREFIXED or not 0.0 < size < 1e-3:
        return get_display_unit(unit, angles)
    return DisplayUnit(f"µ{unit}", 1e6) if size >= 1e-6 else DisplayUnit(f"n{unit}", 1e9)


def format_percent(value: float, decimals: int = 1) -> str:
    """Format a share in %, with more decimals where rounding would give "100.0"."""
    most = next((more for more in range(decimals, 13) if float(f"{value:.{more}f}") < 100.0), decimals)
    return f"{value:.{most if value < 100.0 else decimals}f}"


def count_distinguishing_digits(values: Collection[float], least: int = 4) -> int:
    """Return the significant digits, at least ``least``, that keep values distinct."""
    different = len(set(values))
    return next(
        digits for digits in range(least, 18) if len({format_number(value, digits) for value in values}) == different
    )


def count_range_digits(values: Collection[float], least: int = 4) -> int:
    """Return the digits, at least ``least``, that resolve 1/20 of the range of values."""
    low, high = min(values, default=0.0), max(values, default=0.0)
    return count_distinguishing_digits((low, low + (high - low) / 20, high), least)


def format_quantity(value: float, unit: str, angles: AngleUnit) -> str:
    """Return a quantity in SI with the unit in which it is displayed: "120°"."""
    return append_unit(*convert_to_text(value, unit, angles))


def convert_to_text(value: float, unit: str, angles: AngleUnit) -> tuple[str, str]:
    """Return the displayed number and unit of a quantity in SI: ("120", "°")."""
    try:
        display = choose_display_unit(float(value), unit, angles)
        shown = value if display.factor == 1.0 else float(value) * display.factor
    except OverflowError:  # beyond any float in either unit
        display, shown = get_display_unit(unit, angles), value
    return _with_power(format_number(shown)), display.unit


def _with_power(number: str) -> str:
    plain, e, power = number.partition("e")
    return f"{plain}·10{str(int(power)).translate(_RAISED)}" if e and power.lstrip("+-").isdigit() else number


def format_text(text: str, angles: AngleUnit) -> str:
    """Return a text of the service with its marked quantities as one person reads them.

    Marks, faults and ends of runs are stored once, in SI (`plant/quantity.py`). An angle keeps its number of digits,
    four at least. Small numbers get a prefix. What a person has written in the text stays as it is.
    """
    converted = _QUANTITY.sub(lambda found: _convert_quantity(found, angles), text)
    return _ESCAPED.sub(lambda found: UNIT_MARK + found[1][1:] if found[1] else " ", converted)


def mark_quantities(text: str) -> str:
    """Return a text that no person has entered, such as a document of Sinew, with its quantities marked.

    Texts between quotation marks and units in a fraction, such as N·m/rad, stay as they are.
    """
    return _UNMARKED.sub(lambda found: UNIT_MARK.join(part for part in found.groups() if part), text)


def _convert_quantity(found: re.Match[str], angles: AngleUnit) -> str:
    numbers = [number for number in (found["low"], found["high"]) if number]
    if found["unit"]:
        if len(numbers) == 1 and "e" in numbers[0]:
            return _prefixed(numbers[0], found["unit"])
        return f"{(found['to'] or '').join(numbers)} {found['unit']}"
    if (found["angle"] == "rad") != (angles is AngleUnit.RADIANS):
        factor = 180.0 / math.pi if angles is AngleUnit.DEGREES else math.pi / 180.0
        numbers = [_as_fine(number, factor) for number in numbers]
    return f"{(found['to'] or '').join(numbers)}{_WRITTEN[angles]}{found['rate'] or ''}"


def _prefixed(number: str, unit: str) -> str:
    reading = choose_display_unit(float(number.replace("−", "-")), unit, AngleUnit.RADIANS)
    return append_unit(number if reading.factor == 1.0 else _as_fine(number, reading.factor), reading.unit)


def _as_fine(number: str, factor: float) -> str:
    digits = len(re.sub(r"e.*|\D", "", number).lstrip("0"))
    turned = format_number(float(number.replace("−", "-")) * factor, min(max(digits, 4), DIGITS))
    return turned.replace("-", "−") if "−" in number else turned
