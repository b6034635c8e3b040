"""Bring a rig up: its steps, one at a time."""

from fastapi import APIRouter

from backend.api.auth import SignedIn
from backend.api.service import InControl, ServiceInUse
from backend.commissioning.steps import StepId
from backend.schemas.commissioning import BringUpView, DrivesSwitch, StepValues

router = APIRouter(prefix="/api/bring-up", tags=["bring-up"])


@router.get("")
async def get_bring_up(service: ServiceInUse, _person: SignedIn) -> BringUpView:
    """Return all steps in order, how each stands, and the one that is under way."""
    return await service.bring_up.view()


@router.post("/confirm")
async def confirm_bring_up(service: ServiceInUse, _person: InControl) -> BringUpView:
    """Confirm what the step under way asks a person to do."""
    return await service.bring_up.confirm()


@router.post("/cancel")
async def cancel_bring_up(service: ServiceInUse, _person: InControl) -> BringUpView:
    """Give up the step under way; nothing of it is kept."""
    return await service.bring_up.cancel()


@router.post("/drives")
async def switch_drives(body: DrivesSwitch, service: ServiceInUse, person: InControl) -> BringUpView:
    """Switch the drives off, at any time, or once no hand is at the rig on, in off and between two steps only."""
    return await service.bring_up.switch_drives(body.on, person.name)


@router.post("/{step}", status_code=202)
async def start_bring_up(step: StepId, body: StepValues, service: ServiceInUse, person: InControl) -> BringUpView:
    """Start a step; refused while another one is under way, and where something has to come before it."""
    return await service.bring_up.start(step, body.values, person.name)
