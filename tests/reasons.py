"""Reasons in tests, of refusals, answers and results: by code and values, or by a part of a text without a code."""

import re

from plant import Message


class Reason:
    """Equal to a message of this code with these of its values."""

    def __init__(self, code: str, **values: object) -> None:
        self.code, self.values = code, values

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Message) or other.code != self.code:
            return False
        return {name: other.values[name] for name in self.values if name in other.values} == self.values

    def __repr__(self) -> str:
        return f"Reason({self.code!r}, {self.values})"


class TextWith:
    """Equal to a text in which the regular expression is found."""

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and re.search(self.pattern, other) is not None

    def __repr__(self) -> str:
        return f"TextWith({self.pattern!r})"


def assert_reason(reason: str, code: str, /, **values: object) -> None:
    """Assert that a text is a message with this code, and with these of its values."""
    assert isinstance(reason, Message), reason
    assert reason.code == code, reason
    assert {name: reason.values[name] for name in values if name in reason.values} == values, reason
