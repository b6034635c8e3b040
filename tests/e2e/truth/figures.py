"""Compare numbers within texts with the service, to the precision of their last digits."""

import re
from collections.abc import Sequence

_NUMBER = r"([+\-\u2212]?\d+(?:\.\d+)?(?:e[+\-\u2212]?\d+)?)"
_DURATION = r"((?:\d+:)?\d+(?::\d\d)? (?:s|min|h)|\d+\.\d s)"
_HOLE = re.compile(r"\{(n|d)\}")

Range = tuple[float, float]


def agrees(text: str, told: float | Range) -> bool:
    """Return whether a displayed number equals one of ``told`` within half of its last digit."""
    found = re.fullmatch(_NUMBER, text.strip())
    if found is None:
        return False
    low, high = told if isinstance(told, tuple) else (told, told)
    value, half = number(text), 0.5 * last_digit(text)
    slack = half * (1.0 + 1e-9) + 1e-12 * max(abs(low), abs(high))
    return low - slack <= value <= high + slack


def number(text: str) -> float:
    """Return a displayed number; raises ValueError for other text."""
    return float(text.strip().replace("\u2212", "-"))


def last_digit(text: str) -> float:
    """Return the value of one unit in the last digit."""
    digits, _, exponent = text.strip().replace("\u2212", "-").partition("e")
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))


def seconds(text: str) -> float:
    """Return the value of a displayed duration: "12.3 s", "1:05 min", "1:02:03 h"."""
    count, _unit = text.rsplit(" ", 1)
    value = 0.0
    for part in count.split(":"):
        value = 60.0 * value + float(part)
    return value * (60.0 if _unit == "min" and ":" not in count else 1.0)


def tells(text: str, template: str, told: Sequence[float | Range]) -> bool:
    """Return whether ``text`` is the template with these values: {n} for a number, {d} for a duration [s]."""
    kinds = _HOLE.findall(template)
    parts = [re.escape(part) for part in _HOLE.split(template)[::2]]
    pattern = parts[0]
    for kind, part in zip(kinds, parts[1:], strict=True):
        pattern += (_NUMBER if kind == "n" else _DURATION) + part
    found = re.fullmatch(pattern, text)
    if found is None:
        return False
    return all(
        agrees(said, value) if kind == "n" else _lasts(said, value)
        for kind, said, value in zip(kinds, found.groups(), told, strict=True)
    )


def _lasts(text: str, told: float | Range) -> bool:
    low, high = told if isinstance(told, tuple) else (told, told)
    step = 0.1 if "." in text else 1.0
    return low - step <= seconds(text) <= high + step
