"""Refusals in tests: an error by the code and the values of its message, whatever its text is."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from plant import SinewError


@contextmanager
def refused(kind: type[SinewError], code: str, /, **values: object) -> Iterator[None]:
    """Expect an error of this kind whose message has this code, and these of its values."""
    with pytest.raises(kind) as caught:
        yield
    message = caught.value.message
    assert message.code == code, message
    assert {name: message.values.get(name) for name in values} == values, message
