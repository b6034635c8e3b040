"""Injection of faults into a simulated plant or the safety chain, for tests."""

from backend.auth import ControlLease
from backend.errors import RequestRejectedError
from backend.faults import EXPLANATIONS, FAULTS, Fault
from backend.schemas import CardFault, FaultKind, FaultList, Injection, SilentPart
from backend.services import messages
from backend.services.actuator import ActuatorService
from plant import ONLY_OF_A_CARD, ErrorCode, InjectedFault, InjectedFaultKind, PlantChoice, PlantKind, Sensor

SERVICE_SILENT_S = 1.0
"""Time without heartbeat of the service [s]; the control loop stops after 0.34 s."""

INJECTIONS: dict[Fault, Injection] = {
    Fault.FORCE_LIMIT: Injection(kind=InjectedFaultKind.DRIFT_UP, sensor=Sensor.F_A),
    Fault.JOINT_LIMIT: Injection(kind=InjectedFaultKind.DRIFT_UP, sensor=Sensor.Q),
    Fault.SLACK: Injection(kind=InjectedFaultKind.DRIFT_DOWN, sensor=Sensor.F_A),
    Fault.SENSOR_INVALID: Injection(kind=InjectedFaultKind.NO_NUMBER, sensor=Sensor.F_B),
    Fault.SENSOR_STUCK: Injection(kind=InjectedFaultKind.STUCK, sensor=Sensor.THETA_A),
    Fault.SENSOR_JUMP: Injection(kind=InjectedFaultKind.JUMP, sensor=Sensor.Q),
    Fault.IMPLAUSIBLE: Injection(kind=InjectedFaultKind.DRIFT_DOWN, sensor=Sensor.THETA_A),
    Fault.DEADLINES_MISSED: Injection(kind=InjectedFaultKind.LATE),
    Fault.SERVICE_LOST: Injection(kind=SilentPart.SERVICE_SILENT),
    Fault.OPERATOR_LOST: Injection(kind=SilentPart.PAGE_SILENT),
    Fault.SAFETY_MODULE: Injection(kind=InjectedFaultKind.SAFETY_TRIP),
    Fault.PLANT_ERROR: Injection(kind=InjectedFaultKind.READ_ERROR),
    Fault.WATCHDOG: Injection(kind=InjectedFaultKind.HANG),
    Fault.WATCHDOG_DEAD: Injection(kind=InjectedFaultKind.WATCHDOG_DEATH),
    Fault.MOTOR_REVERSED: Injection(kind=InjectedFaultKind.SWAPPED_MOTORS),
    Fault.SENSOR_SATURATED: Injection(kind=InjectedFaultKind.SATURATION, sensor=Sensor.F_A),
}
"""Injection that leads to each fault while the joint moves."""

CARD_INJECTIONS: tuple[tuple[Injection, tuple[Fault, ...]], ...] = (
    (Injection(kind=InjectedFaultKind.DEVICE_GONE), (Fault.PLANT_ERROR,)),
    (Injection(kind=InjectedFaultKind.BUFFER_OVERRUN), (Fault.PLANT_ERROR,)),
    (Injection(kind=InjectedFaultKind.LOST_SAMPLE), (Fault.PLANT_ERROR,)),
    (Injection(kind=InjectedFaultKind.STUCK, sensor=Sensor.F_A), (Fault.SENSOR_STUCK,)),
    (Injection(kind=InjectedFaultKind.SATURATION, sensor=Sensor.F_A), (Fault.SENSOR_SATURATED,)),
    (Injection(kind=InjectedFaultKind.LOST_COUNTS, sensor=Sensor.THETA_A), (Fault.IMPLAUSIBLE,)),
    (Injection(kind=InjectedFaultKind.SWAPPED_LOAD_CELLS), (Fault.IMPLAUSIBLE, Fault.SENSOR_JUMP)),
    (Injection(kind=InjectedFaultKind.SWAPPED_ENCODERS), (Fault.MOTOR_REVERSED, Fault.IMPLAUSIBLE, Fault.SENSOR_STUCK)),
    (Injection(kind=InjectedFaultKind.SWAPPED_MOTORS), (Fault.MOTOR_REVERSED,)),
)
"""Injections into a virtual card and its wiring, each with the faults that it may lead to while the joint moves."""

MANUAL_CAUSES: dict[Fault, str] = {
    Fault.STOP_PRESSED: messages.press_stop(),
    Fault.SERVICE_ENDED: messages.end_service(),
    Fault.INTERNAL_ERROR: messages.error_in_program(),
}
"""How the faults without injection are caused."""


def describe_faults(plant: PlantChoice) -> FaultList:
    """Return all faults with explanation and the injection that leads to them."""
    has_virtual_card = plant.kind is PlantKind.VIRTUAL_CARD

    def find_injection(fault: Fault) -> Injection | None:
        injection = INJECTIONS.get(fault)
        return None if injection is None or (_needs_card(injection) and not has_virtual_card) else injection

    return FaultList(
        faults=[
            FaultKind(
                code=fault,
                message=EXPLANATIONS[fault].message,
                remedy=EXPLANATIONS[fault].remedy,
                injection=find_injection(fault),
                by_hand="" if find_injection(fault) else MANUAL_CAUSES.get(fault, messages.only_with_virtual_card()),
            )
            for fault in FAULTS
            if fault is not Fault.NONE
        ],
        card=[
            CardFault(injection=injection, says=_build_plant_fault(injection).words, leads_to=list(leads_to))
            for injection, leads_to in (CARD_INJECTIONS if has_virtual_card else ())
        ],
    )


async def apply_fault(actuator: ActuatorService, control: ControlLease, injection: Injection, who: str) -> None:
    """Inject a fault.

    Raises RequestRejectedError for a real plant, and for a fault of the card on a plant without virtual card.
    """
    plant = actuator.live_state.plant
    if not plant.simulated:
        message = messages.fault_injection_needs_simulated_plant(plant=plant.name)
        raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="not_a_simulator")
    if _needs_card(injection) and plant.kind is not PlantKind.VIRTUAL_CARD:
        message = messages.fault_needs_virtual_card(fault=_build_plant_fault(injection).words)
        raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="no_virtual_card")
    match injection.kind:
        case SilentPart.SERVICE_SILENT:
            actuator.suspend_heartbeat(SERVICE_SILENT_S, who)
        case SilentPart.PAGE_SILENT:
            control.ignore_pings()
        case _:
            await actuator.inject_fault(_build_plant_fault(injection), who)


async def clear_faults(actuator: ActuatorService, who: str) -> None:
    """Clear all injected faults of the plant."""
    await actuator.inject_fault(None, who)


def _build_plant_fault(injection: Injection) -> InjectedFault:
    return InjectedFault(InjectedFaultKind(injection.kind), injection.sensor)


def _needs_card(injection: Injection) -> bool:
    return injection.kind in ONLY_OF_A_CARD
