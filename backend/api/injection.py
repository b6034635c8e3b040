"""Break a simulated plant, or a link of the safety chain, to see each reaction of the loop."""

from backend.api.bench import Bench
from backend.api.control import Control
from backend.api.errors import ApiError
from backend.api.schemas.faults import FaultKind, FaultList, Injection, InjectionKind
from backend.faults import EXPLAINED, FAULTS, Fault
from plant.breakage import Breakage, Broken, Sensor

SERVICE_SILENT_S = 1.0
"""How long the service falls silent [s]: the loop waits for 0.34 s."""

LEADS_TO: dict[Fault, Injection] = {
    Fault.FORCE_LIMIT: Injection(kind=InjectionKind.DRIFT_UP, sensor=Sensor.F_A),
    Fault.JOINT_LIMIT: Injection(kind=InjectionKind.DRIFT_UP, sensor=Sensor.Q),
    Fault.SLACK: Injection(kind=InjectionKind.DRIFT_DOWN, sensor=Sensor.F_A),
    Fault.SENSOR_INVALID: Injection(kind=InjectionKind.NO_NUMBER, sensor=Sensor.F_B),
    Fault.SENSOR_STUCK: Injection(kind=InjectionKind.STUCK, sensor=Sensor.THETA_A),
    Fault.SENSOR_JUMP: Injection(kind=InjectionKind.JUMP, sensor=Sensor.Q),
    Fault.IMPLAUSIBLE: Injection(kind=InjectionKind.DRIFT_DOWN, sensor=Sensor.THETA_A),
    Fault.DEADLINES_MISSED: Injection(kind=InjectionKind.LATE),
    Fault.SERVICE_LOST: Injection(kind=InjectionKind.SERVICE_SILENT),
    Fault.OPERATOR_LOST: Injection(kind=InjectionKind.PAGE_SILENT),
    Fault.SAFETY_MODULE: Injection(kind=InjectionKind.SAFETY_TRIP),
    Fault.PLANT_ERROR: Injection(kind=InjectionKind.READ_ERROR),
    Fault.WATCHDOG: Injection(kind=InjectionKind.HANG),
    Fault.WATCHDOG_DEAD: Injection(kind=InjectionKind.WATCHDOG_DEATH),
}
"""What brings a fault about while the joint moves."""

BY_HAND: dict[Fault, str] = {
    Fault.STOP_PRESSED: "press STOP",
    Fault.SERVICE_ENDED: "end the service, by Ctrl+C or a signal",
}
"""What a person does to bring about the faults that nothing has to be broken for."""


def fault_list() -> FaultList:
    """Return all faults with their words and what brings them about."""
    return FaultList(
        faults=[
            FaultKind(
                code=fault,
                message=told.message,
                remedy=told.remedy,
                injection=LEADS_TO.get(fault),
                by_hand=BY_HAND.get(fault, ""),
            )
            for fault, told in ((fault, EXPLAINED[fault]) for fault in FAULTS if fault is not Fault.NONE)
        ]
    )


async def inject(bench: Bench, control: Control, injection: Injection, who: str) -> None:
    """Break what is asked for. Raises ApiError 409 where the plant is not simulated: nobody breaks a rig on purpose."""
    plant = bench.picture.plant
    if not plant.simulated:
        message = f"faults are injected only into what is simulated, and this is a {plant.name}"
        raise ApiError(409, message, code="not_a_simulator")
    match injection.kind:
        case InjectionKind.SERVICE_SILENT:
            bench.fall_silent(SERVICE_SILENT_S, who)
        case InjectionKind.PAGE_SILENT:
            control.mute()
        case kind:
            await bench.break_plant(Broken(Breakage(kind.value), injection.sensor), who)


async def mend(bench: Bench, who: str) -> None:
    """Mend whatever is broken."""
    await bench.break_plant(None, who)
