"""State, STOP, reset, mode, references, push, wall, trigger."""

from fastapi import APIRouter

from backend.api.auth import MayStop, Operator, SignedIn
from backend.api.service import HoldsControl, InControl, ServiceInUse
from backend.operating.obstruction import obstruct
from backend.schemas.state import (
    ModeRequest,
    Push,
    References,
    State,
    StopProof,
    TouchOrder,
    TouchView,
    TriggerOrder,
    TriggerView,
    WallOrder,
)

router = APIRouter(prefix="/api", tags=["operate"])


@router.get("/state")
async def get_state(service: ServiceInUse, _person: SignedIn) -> State:
    """Return everything the status line and the controls show."""
    return service.actuator.present.state()


@router.post("/stop")
async def stop(service: ServiceInUse, person: MayStop) -> StopProof:
    """Stop hard: zero volts within two ticks, latched. For all in every mode but who signed out or has an old token.

    A recording that is played is paused: nothing is driven, and nothing is latched.
    """
    return await service.actuator.stop(person.name)


@router.post("/reset")
async def reset(service: ServiceInUse, person: HoldsControl) -> State:
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
    """Push a simulated joint, in run and compliance; the loop lets go after the time, and when control is lost."""
    return await service.actuator.push(body, person.name)


@router.put("/touch")
async def set_touch(body: TouchOrder, service: ServiceInUse, person: InControl) -> TouchView:
    """Learn what the outside force reads with nothing outside, and from what force on the joint gives way."""
    return await service.actuator.touching.order(body, person.name)


@router.put("/wall")
async def set_wall(body: WallOrder, service: ServiceInUse, person: InControl) -> WallOrder:
    """Put a wall in a simulated joint's way, in flight, or take it away; refused where nothing is simulated."""
    return await obstruct(service.actuator, body, person.name)


@router.put("/trigger")
async def arm_trigger(body: TriggerOrder, service: ServiceInUse, person: Operator) -> TriggerView:
    """Wait for a condition on a signal and keep what was before and after it as a flight record; nothing moves."""
    return await service.triggers.arm(body, person.name)


@router.delete("/trigger", status_code=204)
async def disarm_trigger(service: ServiceInUse, person: Operator) -> None:
    """Wait for nothing any more; of a capture under way what there is until now is kept."""
    await service.triggers.disarm(person.name)
