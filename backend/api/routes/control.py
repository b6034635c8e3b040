"""Take and give up control."""

from typing import Annotated

from fastapi import APIRouter, Header

from backend.api.auth import Operator
from backend.api.control import HEADER, read_stamp
from backend.api.schemas.control import ControlRequest, Lease
from backend.api.service import ServiceInUse

router = APIRouter(prefix="/api/control", tags=["operate"])


@router.post("")
async def take_control(body: ControlRequest, service: ServiceInUse, person: Operator) -> Lease:
    """Take control for a page, which keeps it as long as its pings on `/api/live` carry the epoch."""
    holder = service.control.take(person, is_page=True, take_over=body.take_over)
    return Lease(epoch=holder.epoch, name=person.name)


@router.delete("", status_code=204)
async def give_up_control(
    service: ServiceInUse,
    person: Operator,
    stamp: Annotated[str | None, Header(alias=HEADER, max_length=40)] = None,
) -> None:
    """Give up control; nothing moves by that."""
    service.control.give_up(person, read_stamp(stamp))
