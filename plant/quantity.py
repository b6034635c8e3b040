"""Quantities in texts: written in SI units, converted to the units of each reader.

Several people read the same event, fault or end of a run, in degrees or in radians. Such a text has a narrow no-break
space (U+202F), which no keyboard types, between a number and its SI unit. ``backend.units.format_text`` converts these
quantities for one reader and leaves everything else unchanged, in particular what a person has written.
"""

import re

UNIT_MARK = "\u202f"
"""Separates number and unit of a quantity that the service has written."""

ESCAPE = "\u2060"
"""Follows a mark that a person has written and prevents its conversion."""

PREFIXED = ("V", "N", "s", "m", "A")
"""Units that get a prefix for small numbers."""

_ANGLES = ("rad", "rad/s")
_MARK = re.compile(UNIT_MARK)


class Quantity:
    """A value in SI units, written as f"{Quantity(F, 'N'):.3g}".

    ``high`` makes it a range. Angles, and small numbers of units with a prefix, are marked for conversion.
    """

    def __init__(self, value: float, unit: str, high: float | None = None) -> None:
        self.value, self.unit, self.high = value, unit, high

    def __format__(self, spec: str) -> str:
        number = write_number(self.value, spec or ".6g")
        if self.high is not None:
            number += f" to {write_number(self.high, spec or '.6g')}"
        if self.unit in ("", "1"):
            return number
        is_converted = self.unit in _ANGLES or (self.unit in PREFIXED and "e-" in number)
        return f"{number}{UNIT_MARK if is_converted else ' '}{self.unit}"


class Angle(Quantity):
    """An angle [rad]; f"{Angle(q):.4g}" marks it for conversion.

    ``high`` makes it a range.
    """

    def __init__(self, value: float, high: float | None = None) -> None:
        super().__init__(value, "rad", high)


def write_number(value: float, spec: str) -> str:
    """Return a number in this format, or the digit count of an integer too large for a float."""
    try:
        return f"{float(value) + 0.0:{spec}}"
    except OverflowError:
        return f"a number of {len(str(abs(int(value))))} digits"


def quote(text: str) -> str:
    """Return a person's text in quotation marks and protected from conversion."""
    return f"“{escape_quantities(text)}”"


def escape_quantities(text: str) -> str:
    """Return a person's text that ``backend.units.format_text`` leaves unchanged."""
    return _MARK.sub(UNIT_MARK + ESCAPE, text)
