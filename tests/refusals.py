"""Refusals in tests: an error by the code and the values of its message, whatever its text is."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

from plant import Message, SinewError
from tests.reasons import assert_reason

_Error = TypeVar("_Error", bound=SinewError)


@contextmanager
def refused(kind: type[SinewError], code: str, /, **values: object) -> Iterator[None]:
    """Expect an error of this kind whose message has this code, and these of its values."""
    with pytest.raises(kind) as caught:
        yield
    assert_reason(caught.value.message, code, **values)


@contextmanager
def refused_because(kind: type[_Error], code: str, **values: object) -> Iterator[pytest.ExceptionInfo[_Error]]:
    """Expect an error of this kind whose reason has this code, and these of its values."""
    with pytest.raises(kind) as caught:
        yield caught
    check_reason(caught.value, code, **values)


def check_reason(error: SinewError, code: str, **values: object) -> None:
    """Compare the reason within a message: ``why`` of an ExperimentError, ``reason`` of a SettingError.

    It is a message of a catalogue, or another error with its attributes as values.
    """
    reason = getattr(error, "why", None) or getattr(error, "reason", None)
    assert getattr(reason, "code", "") == code, error.message
    found = reason.values if isinstance(reason, Message) else vars(reason)
    assert {name: found[name] for name in values if name in found} == values, error.message
