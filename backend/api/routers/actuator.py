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

# Control lease -------------------------------------------------------------------------------------


control_router = APIRouter(prefix="/api/control", tags=["operate"], route_class=ThreadRoute)


@control_router.post("")
async def take_control(body: ControlRequest, service: CurrentService, person: Operator) -> Lease:
    """Take control for a page, which keeps it while its pings on `/api/live` contain the returned key."""
    if body.resume is not None:
        return service.control.resume(person, body.resume).build_lease()
    if body.handed is not None:
        return service.hand_over.take(person, body.handed).build_lease()
    return service.control.take(person, is_page=True, take_over=body.take_over).build_lease()


@control_router.delete("", status_code=204, summary="Release Control")
async def give_up_control(service: CurrentService, person: Operator, stamp: CommandTokenHeader = None) -> None:
    """Release control; references stay active, a push and a bias calibration end."""
    await service.control.give_up(person, parse_command_token(stamp))


@control_router.post("/wishes", status_code=201, summary="Request Or Offer Control")
async def ask_for_control(
    body: HandoverRequest, service: CurrentService, person: Operator, stamp: CommandTokenHeader = None
) -> HandoverView:
    """Request control from its holder; with `to`, the page in control offers it to another operator."""
    if body.to is None:
        return service.hand_over.ask(person, body.reason)
    return await service.hand_over.offer(person, parse_command_token(stamp), body.to, body.reason)


@control_router.post("/wishes/{id}", status_code=204, summary="Answer Request For Control")
async def answer_wish(
    id: RowId, body: HandoverReply, service: CurrentService, person: Operator, stamp: CommandTokenHeader = None
) -> None:
    """Hand over, keep or decline control, or withdraw a request or an offer."""
    await service.hand_over.answer(person, parse_command_token(stamp), id, body.answer, body.reason)


# Faults --------------------------------------------------------------------------------------------


faults_router = APIRouter(prefix="/api/faults", tags=["faults"], route_class=ThreadRoute)


@faults_router.get("")
async def list_faults(_person: SignedInUser, service: CurrentService) -> FaultList:
    """List all faults with message, remedy, and how to cause them on the present plant."""
    return describe_faults(service.actuator.live_state.plant)


@faults_router.post("/injection", status_code=204)
async def inject_fault(body: Injection, service: CurrentService, person: ActuatorOperator) -> None:
    """Inject a fault into a simulated plant or its safety chain; rejected on other plants."""
    await apply_fault(service.actuator, service.control, body, person.name)


@faults_router.delete("/injection", status_code=204, summary="Clear Injected Fault")
async def mend_fault(service: CurrentService, person: ActuatorOperator) -> None:
    """Clear the injected fault; the latched fault remains until it is reset."""
    await clear_faults(service.actuator, person.name)


# Operation -----------------------------------------------------------------------------------------


operate_router = APIRouter(prefix="/api", tags=["operate"], route_class=ThreadRoute)


@operate_router.get("/state")
async def get_state(service: CurrentService, _person: SignedInUser) -> State:
    """Return the state that the status line and the controls display."""
    return service.state.view()


@operate_router.post("/stop")
async def stop(service: CurrentService, person: StopRequester) -> StopProof:
    """Stop hard: zero volts within two control steps, latched.

    Accepted in every mode and from every role, even with an expired session, but not after sign-out. On a replay,
    STOP pauses the playback and latches nothing.
    """
    return await service.actuator.stop(person.name)


@operate_router.post("/reset")
async def reset(service: CurrentService, person: ControlHolder) -> State:
    """Clear the latched fault once its cause is gone."""
    await service.actuator.reset(person.name)
    return service.state.view()


@operate_router.post("/mode")
async def set_mode(body: ModeRequest, service: CurrentService, person: ActuatorOperator) -> State:
    """Change the mode; rejects an illegal change and lists the legal ones."""
    await service.actuator.set_mode(body.mode, person.name)
    return service.state.view()


@operate_router.put("/references")
async def set_references(body: References, service: CurrentService, person: ActuatorOperator) -> References:
    """Set the references of the cascade; values beyond the limits are rejected."""
    return await service.actuator.set_references(body.q_ref, body.S_ref, person.name)


@operate_router.post("/push")
async def push(body: PushRequest, service: CurrentService, person: ActuatorOperator) -> PushRequest:
    """Push a simulated joint in run or compliance; the push ends after its duration or when control is lost."""
    return await service.actuator.push(body, person.name)


@operate_router.put("/touch")
async def set_touch(body: TouchOrder, service: CurrentService, person: ActuatorOperator) -> TouchView:
    """Calibrate the bias of the external force, and set the threshold of the contact reaction."""
    return await service.actuator.contact.apply(body, person.name)


@operate_router.put("/wall")
async def set_wall(body: WallOrder, service: CurrentService, person: ActuatorOperator) -> WallOrder:
    """Add or remove the obstacle of a simulated joint; rejected on other plants."""
    return await set_obstacle(service.actuator, body, person.name)


@operate_router.put("/trigger")
async def arm_trigger(body: TriggerOrder, service: CurrentService, person: Operator) -> TriggerView:
    """Arm a trigger, which stores the samples around a condition on a signal; nothing moves."""
    return await service.triggers.arm(body, person.name)


@operate_router.delete("/trigger", status_code=204)
async def disarm_trigger(service: CurrentService, person: Operator) -> None:
    """Disarm the trigger; a running capture is stored up to now."""
    await service.triggers.disarm(person.name)


# Player of a replay --------------------------------------------------------------------------------


player_router = APIRouter(prefix="/api/player", tags=["operate"], route_class=ThreadRoute)


@player_router.get("")
async def get_recording(service: CurrentService, _person: SignedInUser) -> PlayedRecording:
    """Return the replayed recording with its events; rejected while a plant is controlled."""
    return service.actuator.player.recording


@player_router.put("", status_code=204, summary="Control Playback")
async def play(body: PlayerOrder, service: CurrentService, _person: ControlHolder) -> None:
    """Play or pause the recording, or set its speed or position; playing at its end restarts it."""
    await service.actuator.player.apply(body)
