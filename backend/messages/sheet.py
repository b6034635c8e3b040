"""A sheet of charts, as the page has drawn it."""

from pydantic import Field

from backend.messages.base import Schema

LONGEST_SHEET = 2 * 1024 * 1024
"""Characters, and bytes of a body with them: sixty curves of four thousand points each, as the page sends them."""


class SheetToPrint(Schema):
    """A drawing to be made a PDF of its size."""

    svg: str = Field(
        min_length=1,
        max_length=LONGEST_SHEET,
        description="SVG of one sheet: lines and letters, its size in mm; nothing in it may lead elsewhere",
    )
