"""In which unit somebody who asks for something reads angles."""

import asyncio
from typing import Annotated

from fastapi import Depends, Query, Request
from starlette.requests import HTTPConnection

from backend.api.service import service_of
from backend.server.security import authentication_of, shown_by
from backend.storage.orm import StorageError
from backend.units import Angles

PATIENCE_S = 1.0
"""No refusal waits longer for a preference: a database that does not answer must not keep anybody from reading it."""


async def angles_of(connection: HTTPConnection) -> Angles:
    """Return what the signed-in person prefers; degrees for who is not signed in, or is not known just now."""
    person = authentication_of(connection).recognise(shown_by(connection))
    if person is None:
        return Angles.DEGREES
    try:
        async with asyncio.timeout(PATIENCE_S):
            return (await service_of(connection).preferences.of(person)).angles
    except (StorageError, TimeoutError):
        return Angles.DEGREES


async def _angles_read(
    request: Request,
    angles: Annotated[
        Angles | None, Query(description="unit in which angles are printed; what the person prefers if left out")
    ] = None,
) -> Angles:
    return await angles_of(request) if angles is None else angles


AnglesRead = Annotated[Angles, Depends(_angles_read)]
