"""What is said of a refused number, setting or experiment, and what of a refused value can be shown."""

from backend.errors import OutOfRangeError
from backend.experiments.parser import ExperimentError
from backend.messages.base import Problem
from backend.messages.malformed import SHOWN
from backend.models.settings import SettingError
from backend.units import Angles

_LARGEST = 2**53
"""Numbers beyond are shown as text: a browser could not read them exactly, nor infinity at all."""


def problem_of(error: OutOfRangeError, angles: Angles = Angles.DEGREES) -> Problem:
    """Return what is said of a refused number, told to somebody who reads angles in this unit."""
    return Problem(
        code="out_of_range",
        message=error.sentence(angles),
        quantity=error.quantity,
        words=error.words,
        path=list(error.path) or None,
        value=plain(error.value),
        minimum=error.minimum,
        maximum=error.maximum,
        unit=error.unit,
    )


def problem_of_setting(error: SettingError, angles: Angles) -> Problem:
    """Return what is said of a refused setting."""
    return Problem(
        code="bad_setting",
        message=error.sentence(angles),
        quantity=error.quantity,
        words=error.words,
        path=list(error.path) or None,
        value=plain(error.value),
        unit=error.unit or None,
        legal=list(error.legal) or None,
    )


def problem_of_experiment(error: ExperimentError, angles: Angles) -> Problem:
    """Return what is said of a refused experiment, with the line of its text."""
    return Problem(
        code="bad_experiment",
        message=error.sentence(angles),
        quantity=error.quantity,
        words=error.words,
        path=list(error.path) or None,
        line=error.line,
    )


def plain(value: object) -> object:
    """Return what JSON can show of a refused value; a token or a large body is not repeated."""
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        return value if abs(value) <= _LARGEST else str(value)[:SHOWN]
    return value[:SHOWN] if isinstance(value, str) else None


def printable(value: object) -> object:
    """Return ``value`` with nothing in its texts that cannot be sent: half a character becomes a question mark."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, list):
        return [printable(item) for item in value]
    if isinstance(value, dict):
        return {name: printable(item) for name, item in value.items()}
    return plain(value)
