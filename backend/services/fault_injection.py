"""Break a simulated plant, or a link of the safety chain, to see each reaction of the loop."""

from backend.auth import ControlLease
from backend.errors import RequestRejectedError
from backend.faults import EXPLANATIONS, FAULTS, Fault
from backend.schemas import CardFault, FaultKind, FaultList, Injection, SilentPart
from backend.services.actuator import ActuatorService
from plant import ONLY_OF_A_CARD, Breakage, Broken, ErrorCode, PlantChoice, PlantKind, Sensor

SERVICE_SILENT_S = 1.0
"""How long the service falls silent [s]: the loop waits for 0.34 s."""

LEADS_TO: dict[Fault, Injection] = {
    Fault.FORCE_LIMIT: Injection(kind=Breakage.DRIFT_UP, sensor=Sensor.F_A),
    Fault.JOINT_LIMIT: Injection(kind=Breakage.DRIFT_UP, sensor=Sensor.Q),
    Fault.SLACK: Injection(kind=Breakage.DRIFT_DOWN, sensor=Sensor.F_A),
    Fault.SENSOR_INVALID: Injection(kind=Breakage.NO_NUMBER, sensor=Sensor.F_B),
    Fault.SENSOR_STUCK: Injection(kind=Breakage.STUCK, sensor=Sensor.THETA_A),
    Fault.SENSOR_JUMP: Injection(kind=Breakage.JUMP, sensor=Sensor.Q),
    Fault.IMPLAUSIBLE: Injection(kind=Breakage.DRIFT_DOWN, sensor=Sensor.THETA_A),
    Fault.DEADLINES_MISSED: Injection(kind=Breakage.LATE),
    Fault.SERVICE_LOST: Injection(kind=SilentPart.SERVICE_SILENT),
    Fault.OPERATOR_LOST: Injection(kind=SilentPart.PAGE_SILENT),
    Fault.SAFETY_MODULE: Injection(kind=Breakage.SAFETY_TRIP),
    Fault.PLANT_ERROR: Injection(kind=Breakage.READ_ERROR),
    Fault.WATCHDOG: Injection(kind=Breakage.HANG),
    Fault.WATCHDOG_DEAD: Injection(kind=Breakage.WATCHDOG_DEATH),
    Fault.MOTOR_REVERSED: Injection(kind=Breakage.SWAPPED_MOTORS),
    Fault.SENSOR_SATURATED: Injection(kind=Breakage.SATURATION, sensor=Sensor.F_A),
}
"""What brings a fault about while the joint moves."""

OF_A_CARD: tuple[tuple[Injection, tuple[Fault, ...]], ...] = (
    (Injection(kind=Breakage.DEVICE_GONE), (Fault.PLANT_ERROR,)),
    (Injection(kind=Breakage.BUFFER_OVERRUN), (Fault.PLANT_ERROR,)),
    (Injection(kind=Breakage.LOST_SAMPLE), (Fault.PLANT_ERROR,)),
    (Injection(kind=Breakage.STUCK, sensor=Sensor.F_A), (Fault.SENSOR_STUCK,)),
    (Injection(kind=Breakage.SATURATION, sensor=Sensor.F_A), (Fault.SENSOR_SATURATED,)),
    (Injection(kind=Breakage.LOST_COUNTS, sensor=Sensor.THETA_A), (Fault.IMPLAUSIBLE,)),
    (Injection(kind=Breakage.SWAPPED_LOAD_CELLS), (Fault.IMPLAUSIBLE, Fault.SENSOR_JUMP)),
    (Injection(kind=Breakage.SWAPPED_ENCODERS), (Fault.MOTOR_REVERSED, Fault.IMPLAUSIBLE, Fault.SENSOR_STUCK)),
    (Injection(kind=Breakage.SWAPPED_MOTORS), (Fault.MOTOR_REVERSED,)),
)
"""What can be broken of a virtual card and its wires, and the faults it may end in while the joint moves."""

BY_HAND: dict[Fault, str] = {
    Fault.STOP_PRESSED: "press STOP",
    Fault.SERVICE_ENDED: "end the service, by Ctrl+C or a signal",
    Fault.INTERNAL_ERROR: "not to be brought about: it is a mistake of the program",
}
"""How the faults come about that nothing has to be broken for."""


_NEEDS_A_CARD = "only with the virtual card: start with --plant rig --virtual-card"


def describe_faults(plant: PlantChoice) -> FaultList:
    """Return all faults with their words and what brings them about on a plant."""
    virtual = plant.kind is PlantKind.VIRTUAL_CARD

    def offered(fault: Fault) -> Injection | None:
        injection = LEADS_TO.get(fault)
        return None if injection is None or (_needs_a_card(injection) and not virtual) else injection

    return FaultList(
        faults=[
            FaultKind(
                code=fault,
                message=told.message,
                remedy=told.remedy,
                injection=offered(fault),
                by_hand="" if offered(fault) else BY_HAND.get(fault, _NEEDS_A_CARD),
            )
            for fault, told in ((fault, EXPLANATIONS[fault]) for fault in FAULTS if fault is not Fault.NONE)
        ],
        card=[
            CardFault(injection=injection, says=_broken(injection).words, leads_to=list(leads_to))
            for injection, leads_to in (OF_A_CARD if virtual else ())
        ],
    )


def _broken(injection: Injection) -> Broken:
    return Broken(Breakage(injection.kind), injection.sensor)


def _needs_a_card(injection: Injection) -> bool:
    return injection.kind in ONLY_OF_A_CARD


async def apply_fault(actuator: ActuatorService, control: ControlLease, injection: Injection, who: str) -> None:
    """Break what is asked for.

    Raises RequestRejectedError where the plant is not simulated, as nobody breaks a rig on purpose, and for what only
    a card has where there is none.
    """
    plant = actuator.live_state.plant
    if not plant.simulated:
        message = f"faults are injected only into what is simulated, and what is driven is the {plant.name}"
        raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="not_a_simulator")
    if _needs_a_card(injection) and plant.kind is not PlantKind.VIRTUAL_CARD:
        raise RequestRejectedError(
            ErrorCode.NOT_NOW, f"{_broken(injection).words}: {_NEEDS_A_CARD}", code="no_virtual_card"
        )
    match injection.kind:
        case SilentPart.SERVICE_SILENT:
            actuator.suspend_heartbeat(SERVICE_SILENT_S, who)
        case SilentPart.PAGE_SILENT:
            control.ignore_pings()
        case _:
            await actuator.inject_fault(_broken(injection), who)


async def clear_faults(actuator: ActuatorService, who: str) -> None:
    """Mend whatever is broken."""
    await actuator.inject_fault(None, who)
