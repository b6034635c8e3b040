"""Schemas of sign-in, tokens, persons and the health of the service."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from backend.plain_text import ONE_LINE
from backend.realtime import Mode
from backend.schemas.base import ErrorDetail, Schema, quantity


class Role(StrEnum):
    """Role of a session.

    An operator may send commands, a viewer may only observe and send STOP.
    """

    OPERATOR = "operator"
    VIEWER = "viewer"


class SignIn(Schema):
    """A token from the data folder, to exchange for a session cookie."""

    token: str = Field(min_length=1, max_length=200)
    name: Annotated[str, ONE_LINE] = Field(
        default="", max_length=40, description="name shown to others; the role if omitted"
    )


class Rotation(Schema):
    """Role whose token to replace."""

    role: Role | None = Field(default=None, description="operator or viewer; both if omitted")


class NewTokens(Schema):
    """The new tokens, which the data folder stores."""

    tokens: dict[Role, str]


class NameRequest(Schema):
    """Name that a person chooses."""

    name: Annotated[str, ONE_LINE] = Field(
        min_length=1,
        max_length=40,
        description="name; the service appends a number while another connected user has the same name",
    )


class SessionView(Schema):
    """The signed-in person."""

    name: str
    role: Role
    asks_name: bool = Field(description="whether this browser has no name yet, so that the page requests one")


class PageAddress(Schema):
    """Address at which a page was opened."""

    url: str = Field(max_length=2000, description="address of the page, without query and fragment")


class PageAddressFindings(Schema):
    """Problems of the connection from a page address to the service, with remedies."""

    problems: list[ErrorDetail]


class PersonView(Schema):
    """A person with an open page."""

    name: str
    role: Role
    pages: int = Field(description="number of pages and scripts of this person with a live stream")
    since: datetime = Field(description="time when the first of these connected")


class Health(Schema):
    """Health of service and control loop; available without sign-in."""

    alive: bool
    mode: Mode | None
    rate_Hz: float = quantity("Hz", "control steps per second over the last 5 s")
    overruns: int = Field(description="deadlines missed since the control loop started")
    version: str
