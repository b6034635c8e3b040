"""Take and give up control, ask for it and hand it over."""

from fastapi import APIRouter

from backend.api.auth import Operator
from backend.api.service import RowId, ServiceInUse, Stamped
from backend.auth.control_lease import read_stamp
from backend.schemas.state import ControlRequest, Lease, Wish, WishAnswer, WishView

router = APIRouter(prefix="/api/control", tags=["operate"])


@router.post("")
async def take_control(body: ControlRequest, service: ServiceInUse, person: Operator) -> Lease:
    """Take control for a page, which keeps it as long as its pings on `/api/live` carry the key it gets."""
    if body.resume is not None:
        return service.control.resume(person, body.resume).lease()
    if body.handed is not None:
        return service.hand_over.take(person, body.handed).lease()
    return service.control.take(person, is_page=True, take_over=body.take_over).lease()


@router.delete("", status_code=204)
async def give_up_control(service: ServiceInUse, person: Operator, stamp: Stamped = None) -> None:
    """Give up control; nothing moves by that."""
    await service.control.give_up(person, read_stamp(stamp))


@router.post("/wishes", status_code=201)
async def ask_for_control(body: Wish, service: ServiceInUse, person: Operator, stamp: Stamped = None) -> WishView:
    """Ask whoever holds control for it; `to` offers it to another operator, as the page that holds it."""
    if body.to is None:
        return service.hand_over.ask(person, body.reason)
    return await service.hand_over.offer(person, read_stamp(stamp), body.to, body.reason)


@router.post("/wishes/{id}", status_code=204)
async def answer_wish(
    id: RowId, body: WishAnswer, service: ServiceInUse, person: Operator, stamp: Stamped = None
) -> None:
    """Hand over, keep control, do not take it, or take back what was asked or offered."""
    await service.hand_over.answer(person, read_stamp(stamp), id, body.answer, body.reason)
