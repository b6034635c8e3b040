"""State, STOP, reset, mode, references, push."""

from fastapi import APIRouter

from backend.api.auth import MayStop, SignedIn
from backend.api.service import InControl, ServiceInUse
from backend.messages.state import ModeRequest, Push, References, State, StopProof

router = APIRouter(prefix="/api", tags=["operate"])


@router.get("/state")
async def get_state(service: ServiceInUse, _person: SignedIn) -> State:
    """Return everything the status line and the controls show."""
    return service.actuator.present.state()


@router.post("/stop")
async def stop(service: ServiceInUse, person: MayStop) -> StopProof:
    """Stop hard: zero volts within two ticks, latched. Open to every signed-in person in every mode.

    Also to one whose session has lapsed; only who signed out, or whose token was replaced, is refused.
    """
    return await service.actuator.stop(person.name)


@router.post("/reset")
async def reset(service: ServiceInUse, person: InControl) -> State:
    """Clear the latched fault after its cause is gone."""
    return await service.actuator.reset(person.name)


@router.post("/mode")
async def set_mode(body: ModeRequest, service: ServiceInUse, person: InControl) -> State:
    """Move to another mode; an illegal move is refused with the legal ones."""
    return await service.actuator.set_mode(body.mode, person.name)


@router.put("/references")
async def set_references(body: References, service: ServiceInUse, person: InControl) -> References:
    """Set the references of the cascade; values beyond the limits are refused."""
    return await service.actuator.set_references(body.q_ref, body.S_ref, person.name)


@router.post("/push")
async def push(body: Push, service: ServiceInUse, person: InControl) -> Push:
    """Push a simulated joint from outside; the loop lets go after the time, and when control is lost.

    Refused where nothing is simulated (a rig is pushed by hand), and in other modes than run and compliance.
    """
    return await service.actuator.push(body, person.name)
