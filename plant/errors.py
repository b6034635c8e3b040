"""Base class of Sinew's errors, and categories for interface and command line."""

from enum import StrEnum
from typing import Any

from plant.message import Message


class ErrorCode(StrEnum):
    """Category of an error; the value is the code in responses without a narrower one."""

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
    """Error whose message is meant for the person who made the request.

    ``category`` selects the status of the response. An error without one is a programming error: the interface responds
    with 500 and the command line prints the traceback.
    """

    category: ErrorCode | None = None

    @property
    def message(self) -> Message:
        """The message with its code and values; without a code if no catalogue contains it."""
        (text, *_) = self.args or ("",)
        return text if isinstance(text, Message) else Message(str(text))

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the response in addition to the message.

        They are the code and facts about the rejected value.
        """
        return {"code": str(self.category or "internal_error")}


class InvariantError(SinewError):
    """Violated invariant: a programming error, independent of the request."""
