"""Routes of the actuator: control, state, modes, references, faults, player."""

from fastapi import APIRouter

from backend.api.dependencies import (
    ActuatorOperator,
    CommandTokenHeader,
    ControlHolder,
    CurrentService,
    Operator,
    RowId,
    SignedInUser,
    StopRequester,
)
from backend.auth import parse_command_token
from backend.schemas import (
    ControlRequest,
    FaultList,
    HandoverReply,
    HandoverRequest,
    HandoverView,
    Injection,
    Lease,
    ModeRequest,
    PlayedRecording,
    PlayerOrder,
    PushRequest,
    References,
    State,
    StopProof,
    TouchOrder,
    TouchView,
    TriggerOrder,
    TriggerView,
    WallOrder,
)
from backend.server import ThreadRoute
from backend.services import apply_fault, clear_faults, describe_faults, set_obstacle

# Control -------------------------------------------------------------------------------------------
#
# Take and give up control, ask for it and hand it over.


control_router = APIRouter(prefix="/api/control", tags=["operate"], route_class=ThreadRoute)


@control_router.post("")
async def take_control(body: ControlRequest, service: CurrentService, person: Operator) -> Lease:
    """Take control for a page, which keeps it as long as its pings on `/api/live` carry the key it gets."""
    if body.resume is not None:
        return service.control.resume(person, body.resume).build_lease()
    if body.handed is not None:
        return service.hand_over.take(person, body.handed).build_lease()
    return service.control.take(person, is_page=True, take_over=body.take_over).build_lease()


@control_router.delete("", status_code=204)
async def give_up_control(service: CurrentService, person: Operator, stamp: CommandTokenHeader = None) -> None:
    """Give up control; nothing moves by that."""
    await service.control.give_up(person, parse_command_token(stamp))


@control_router.post("/wishes", status_code=201)
async def ask_for_control(
    body: HandoverRequest, service: CurrentService, person: Operator, stamp: CommandTokenHeader = None
) -> HandoverView:
    """Ask whoever holds control for it; `to` offers it to another operator, as the page that holds it."""
    if body.to is None:
        return service.hand_over.ask(person, body.reason)
    return await service.hand_over.offer(person, parse_command_token(stamp), body.to, body.reason)


@control_router.post("/wishes/{id}", status_code=204)
async def answer_wish(
    id: RowId, body: HandoverReply, service: CurrentService, person: Operator, stamp: CommandTokenHeader = None
) -> None:
    """Hand over, keep control, do not take it, or take back what was asked or offered."""
    await service.hand_over.answer(person, parse_command_token(stamp), id, body.answer, body.reason)


# Faults --------------------------------------------------------------------------------------------
#
# The faults there are, and injecting them into a simulated plant.


faults_router = APIRouter(prefix="/api/faults", tags=["faults"], route_class=ThreadRoute)


@faults_router.get("")
async def list_faults(_person: SignedInUser, service: CurrentService) -> FaultList:
    """List all faults with message, remedy, and what brings them about on what is driven."""
    return describe_faults(service.actuator.live_state.plant)


@faults_router.post("/injection", status_code=204)
async def inject_fault(body: Injection, service: CurrentService, person: ActuatorOperator) -> None:
    """Break a part of a simulated plant or a link of the safety chain; refused on any other."""
    await apply_fault(service.actuator, service.control, body, person.name)


@faults_router.delete("/injection", status_code=204)
async def mend_fault(service: CurrentService, person: ActuatorOperator) -> None:
    """Mend what was broken; the latched fault stays until it is reset."""
    await clear_faults(service.actuator, person.name)


# Operate -------------------------------------------------------------------------------------------
#
# State, STOP, reset, mode, references, push, wall, trigger.


operate_router = APIRouter(prefix="/api", tags=["operate"], route_class=ThreadRoute)


@operate_router.get("/state")
async def get_state(service: CurrentService, _person: SignedInUser) -> State:
    """Return everything the status line and the controls show."""
    return service.state.view()


@operate_router.post("/stop")
async def stop(service: CurrentService, person: StopRequester) -> StopProof:
    """Stop hard: zero volts within two ticks, latched. For all in every mode but who signed out or has an old token.

    A recording that is played is paused: nothing is driven, and nothing is latched.
    """
    return await service.actuator.stop(person.name)


@operate_router.post("/reset")
async def reset(service: CurrentService, person: ControlHolder) -> State:
    """Clear the latched fault after its cause is gone."""
    await service.actuator.reset(person.name)
    return service.state.view()


@operate_router.post("/mode")
async def set_mode(body: ModeRequest, service: CurrentService, person: ActuatorOperator) -> State:
    """Move to another mode; an illegal move is refused with the legal ones."""
    await service.actuator.set_mode(body.mode, person.name)
    return service.state.view()


@operate_router.put("/references")
async def set_references(body: References, service: CurrentService, person: ActuatorOperator) -> References:
    """Set the references of the cascade; values beyond the limits are refused."""
    return await service.actuator.set_references(body.q_ref, body.S_ref, person.name)


@operate_router.post("/push")
async def push(body: PushRequest, service: CurrentService, person: ActuatorOperator) -> PushRequest:
    """Push a simulated joint, in run and compliance; the loop lets go after the time, and when control is lost."""
    return await service.actuator.push(body, person.name)


@operate_router.put("/touch")
async def set_touch(body: TouchOrder, service: CurrentService, person: ActuatorOperator) -> TouchView:
    """Learn what the outside force reads with nothing outside, and from what force on the joint gives way."""
    return await service.actuator.contact.apply(body, person.name)


@operate_router.put("/wall")
async def set_wall(body: WallOrder, service: CurrentService, person: ActuatorOperator) -> WallOrder:
    """Put a wall in a simulated joint's way, in flight, or take it away; refused where nothing is simulated."""
    return await set_obstacle(service.actuator, body, person.name)


@operate_router.put("/trigger")
async def arm_trigger(body: TriggerOrder, service: CurrentService, person: Operator) -> TriggerView:
    """Wait for a condition on a signal and keep what was before and after it as a flight record; nothing moves."""
    return await service.triggers.arm(body, person.name)


@operate_router.delete("/trigger", status_code=204)
async def disarm_trigger(service: CurrentService, person: Operator) -> None:
    """Wait for nothing any more; of a capture under way what there is until now is kept."""
    await service.triggers.disarm(person.name)


# Player --------------------------------------------------------------------------------------------
#
# The player of a recording in place of a plant: what is played, and play, pause, speed and
# position.


player_router = APIRouter(prefix="/api/player", tags=["operate"], route_class=ThreadRoute)


@player_router.get("")
async def get_recording(service: CurrentService, _person: SignedInUser) -> PlayedRecording:
    """Return the recording that is played, with what happened in it; refused where a plant is driven."""
    return service.actuator.player.recording


@player_router.put("", status_code=204)
async def play(body: PlayerOrder, service: CurrentService, _person: ControlHolder) -> None:
    """Play, pause, set the speed or go to a time of the recording; at its end, playing begins anew."""
    await service.actuator.player.apply(body)
