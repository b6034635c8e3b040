"""Faults stop the actuator and stay latched; limits clip a command and pass. Few, named, each with a remedy.

``docs/faults.md`` carries cause, reaction and remedy of each; a test holds the two together.
"""

from enum import IntFlag, StrEnum


class Fault(StrEnum):
    """Why the loop stopped. The position in this enum is the code in the sample."""

    NONE = "none"
    STOP_PRESSED = "stop_pressed"
    FORCE_LIMIT = "force_limit"
    JOINT_LIMIT = "joint_limit"
    SLACK = "slack"
    SENSOR_INVALID = "sensor_invalid"
    SENSOR_STUCK = "sensor_stuck"
    SENSOR_JUMP = "sensor_jump"
    IMPLAUSIBLE = "implausible"
    DEADLINES_MISSED = "deadlines_missed"
    SERVICE_LOST = "service_lost"
    OPERATOR_LOST = "operator_lost"
    SAFETY_MODULE = "safety_module"
    PLANT_ERROR = "plant_error"


FAULTS: tuple[Fault, ...] = tuple(Fault)
FAULT_CODE: dict[Fault, int] = {fault: code for code, fault in enumerate(FAULTS)}


class Limit(IntFlag):
    """What clipped the command in a tick; the bits ride in the sample."""

    VOLTAGE_A = 1
    VOLTAGE_B = 2
    GOVERNOR = 4
    TENSION_FLOOR = 8
    TENSION_CEILING = 16
    JOINT_RANGE = 32
