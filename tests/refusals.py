"""Refusals in tests: an error by the code and the values of its message, whatever its text is."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

from backend.errors import InvalidValueError
from backend.experiments.parser import ExperimentError
from backend.models.settings import SettingError
from plant import Message, SinewError

_WithReason = TypeVar("_WithReason", ExperimentError, SettingError)


@contextmanager
def refused(kind: type[SinewError], code: str, /, **values: object) -> Iterator[None]:
    """Expect an error of this kind whose message has this code, and these of its values."""
    with pytest.raises(kind) as caught:
        yield
    message = caught.value.message
    assert message.code == code, message
    assert {name: message.values.get(name) for name in values} == values, message


@contextmanager
def refused_because(
    kind: type[_WithReason], code: str, **values: object
) -> Iterator[pytest.ExceptionInfo[_WithReason]]:
    """Expect an error of this kind whose reason has this code, and these of its values."""
    with pytest.raises(kind) as caught:
        yield caught
    check_reason(caught.value, code, **values)


def check_reason(error: ExperimentError | SettingError, code: str, **values: object) -> None:
    """Compare the reason within a message: a message of a catalogue, or a rejected value with its attributes."""
    reason = error.why if isinstance(error, ExperimentError) else error.reason
    assert isinstance(reason, Message | InvalidValueError), str(error)
    found = reason.values if isinstance(reason, Message) else vars(reason)
    assert reason.code == code, str(error)
    assert {name: found.get(name) for name in values} == values, str(error)
