"""Take and give up control."""

from fastapi import APIRouter

from backend.access.control import read_stamp
from backend.api.auth import Operator
from backend.api.service import ServiceInUse, Stamped
from backend.messages.control import ControlRequest, Lease

router = APIRouter(prefix="/api/control", tags=["operate"])


@router.post("")
async def take_control(body: ControlRequest, service: ServiceInUse, person: Operator) -> Lease:
    """Take control for a page, which keeps it as long as its pings on `/api/live` carry the key it gets."""
    if body.resume is not None:
        return service.control.resume(person, body.resume).lease()
    return service.control.take(person, is_page=True, take_over=body.take_over).lease()


@router.delete("", status_code=204)
async def give_up_control(service: ServiceInUse, person: Operator, stamp: Stamped = None) -> None:
    """Give up control; nothing moves by that."""
    await service.control.give_up(person, read_stamp(stamp))
