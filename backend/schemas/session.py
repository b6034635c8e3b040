"""Schemas of sign-in and of the health of the service: who is signed in, in which role."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from backend.plain_text import ONE_LINE
from backend.realtime import Mode
from backend.schemas.base import ErrorDetail, Schema, quantity


class Role(StrEnum):
    """What a signed-in person may do: an operator commands, a viewer watches (and may stop)."""

    OPERATOR = "operator"
    VIEWER = "viewer"


class SignIn(Schema):
    """A token from the data folder, exchanged for a session cookie."""

    token: str = Field(min_length=1, max_length=200)
    name: Annotated[str, ONE_LINE] = Field(
        default="", max_length=40, description="name shown to others; the role when left out"
    )


class Rotation(Schema):
    """Which token to replace."""

    role: Role | None = Field(default=None, description="operator or viewer; both when left out")


class NewTokens(Schema):
    """The new tokens: shown once, kept in the data folder."""

    tokens: dict[Role, str]


class NameRequest(Schema):
    """What a person wants to be called."""

    name: Annotated[str, ONE_LINE] = Field(
        min_length=1, max_length=40, description="a number is put behind it while somebody else of this name is here"
    )


class SessionView(Schema):
    """The signed-in person."""

    name: str
    role: Role
    asks_name: bool = Field(description="this browser has given no name yet: the page asks for one")


class PageAddress(Schema):
    """Where a page was opened."""

    url: str = Field(max_length=2000, description="address of the page, without query and fragment")


class PageAddressFindings(Schema):
    """What is wrong with the way from there to the service, and how to set it right; nothing where all is well."""

    problems: list[ErrorDetail]


class PersonView(Schema):
    """Somebody who has the page open."""

    name: str
    role: Role
    pages: int = Field(description="pages and scripts of this person that follow the loop")
    since: datetime = Field(description="when the first of these came")


class Health(Schema):
    """Whether the service and its loop are alive; open to all, without secrets."""

    alive: bool
    mode: Mode | None
    rate_Hz: float = quantity("Hz", "ticks per second over the last second")
    overruns: int = Field(description="deadlines missed since the loop started")
    version: str
