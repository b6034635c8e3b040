"""The root of all errors of Sinew, and the categories by which interface and command line answer them."""

from enum import StrEnum
from typing import Any


class ErrorCode(StrEnum):
    """Category of an error; the value is the code that programs see where nothing narrower is said."""

    MALFORMED = "bad_request"
    NOT_SIGNED_IN = "not_signed_in"
    NOT_ALLOWED = "not_allowed"
    UNKNOWN = "not_found"
    NOT_NOW = "conflict"
    TOO_LARGE = "too_large"
    BAD_VALUE = "bad_value"
    TOO_MANY = "too_many_attempts"
    UNAVAILABLE = "unavailable"


class SinewError(Exception):
    """An error whose message is for the person who asked.

    ``category`` decides the status of an answer. An error without one is a mistake of the program: the interface
    answers 500 and the command line shows where it happened.
    """

    category: ErrorCode | None = None

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the answer beside the message: code, and what is known of the refused value."""
        return {"code": str(self.category or "internal_error")}


class InvariantError(SinewError):
    """A state that must not be: a mistake of the program, whoever asked for what."""
