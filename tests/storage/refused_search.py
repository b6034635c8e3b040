"""A search that is refused: the place, and the code and the values of the reason."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from backend.storage.search import QueryError
from plant import Message
from tests.reasons import assert_reason


@contextmanager
def refused_search(place: int, code: str, **values: object) -> Iterator[pytest.ExceptionInfo[QueryError]]:
    """Expect a query to be rejected at this character, from 1, with this code and these values."""
    with pytest.raises(QueryError) as caught:
        yield caught
    message = caught.value.message
    reason = message.values["reason"]
    assert isinstance(reason, Message)
    assert message.code == "invalid_search", message
    assert_reason(reason, code, **values)
    assert caught.value.place == message.values["place"] == place - 1
    assert f"character {place}: " in message
