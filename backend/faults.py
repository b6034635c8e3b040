"""Faults, limits and their explanations.

A fault stops the actuator and stays latched; a limit clips a command and clears by itself. Each fault has a remedy.
``docs/reference/faults.md`` lists the cause, reaction and remedy of each; a test compares both.
"""

from enum import IntFlag, StrEnum
from typing import NamedTuple


class Fault(StrEnum):
    """Reason why the loop stopped. The position in this enum is the code in the sample."""

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
    WATCHDOG = "watchdog"
    WATCHDOG_DEAD = "watchdog_dead"
    SERVICE_ENDED = "service_ended"
    SENSOR_SATURATED = "sensor_saturated"
    MOTOR_REVERSED = "motor_reversed"
    INTERNAL_ERROR = "internal_error"


FAULTS: tuple[Fault, ...] = tuple(Fault)
FAULT_CODE: dict[Fault, int] = {fault: code for code, fault in enumerate(FAULTS)}


class Limit(IntFlag):
    """Limits that clipped the command in a tick, as bits in the sample."""

    VOLTAGE_A = 1
    VOLTAGE_B = 2
    GOVERNOR = 4
    TENSION_FLOOR = 8
    TENSION_CEILING = 16
    JOINT_RANGE = 32
    CONTACT = 64


class Explanation(NamedTuple):
    """Meaning of a fault, and what a person at the rig does about it."""

    message: str
    remedy: str


EXPLANATIONS: dict[Fault, Explanation] = {
    Fault.NONE: Explanation("No fault.", "Nothing to do."),
    Fault.STOP_PRESSED: Explanation("STOP was pressed.", "Make sure that the rig is clear, then reset."),
    Fault.FORCE_LIMIT: Explanation(
        "The tension of a tendon exceeded its limit.",
        "Check for a blocked joint or a tendon off its reel; reset, then use smaller or slower references.",
    ),
    Fault.JOINT_LIMIT: Explanation(
        "The joint left its range.", "Move the joint back by hand while the motors are off, then reset."
    ),
    Fault.SLACK: Explanation(
        "A tendon was slack for too long.",
        "Check both tendons and load cells; reset, repeat pretension, then use a higher stiffness.",
    ),
    Fault.SENSOR_INVALID: Explanation(
        "A sensor returned no valid value.", "Check its cable and supply; reset when the reading is valid again."
    ),
    Fault.SENSOR_STUCK: Explanation(
        "A sensor did not change while the rig moved.", "Check the encoder or load cell and its cable, then reset."
    ),
    Fault.SENSOR_JUMP: Explanation(
        "A sensor changed faster than the rig can move.", "Check connectors and shielding, then reset."
    ),
    Fault.IMPLAUSIBLE: Explanation(
        "Tendon tension and encoder positions are inconsistent.",
        "Check for a slipped or torn tendon and the load cell's zero; reset, then repeat pretension.",
    ),
    Fault.DEADLINES_MISSED: Explanation(
        "The control loop missed several deadlines in a row.",
        "Close other programs on this machine and check the control loop timing; then reset.",
    ),
    Fault.SERVICE_LOST: Explanation(
        "The control loop lost the heartbeat of the service and stopped softly.", "Check the service log, then reset."
    ),
    Fault.OPERATOR_LOST: Explanation(
        "The connection to the page that held control was lost.", "Open the dashboard again, take control, then reset."
    ),
    Fault.SAFETY_MODULE: Explanation(
        "The independent safety module disabled the motors.",
        "Remove the cause that the module shows, acknowledge the trip at the module, then reset.",
    ),
    Fault.PLANT_ERROR: Explanation(
        "The plant could not be read or written.", "Check the DAQ card and its connections, then reset."
    ),
    Fault.WATCHDOG: Explanation(
        "The card's watchdog disabled the drives.",
        "The control loop did not write in time: close other programs on this machine, then reset.",
    ),
    Fault.WATCHDOG_DEAD: Explanation(
        "The card's watchdog has failed.",
        "Reset: this starts a new control loop with a new watchdog after its proof test. If the fault "
        "recurs, do not continue.",
    ),
    Fault.SERVICE_ENDED: Explanation(
        "The service shut down and stopped the control loop.", "Start the service again; it starts without the fault."
    ),
    Fault.SENSOR_SATURATED: Explanation(
        "The signal of a load cell reached the limit of its input or of its calibration.",
        "Check for a blocked joint, then check the load cell's amplifier, supply and calibration; "
        "reset when the reading is valid again.",
    ),
    Fault.MOTOR_REVERSED: Explanation(
        "A motor turns against its command.",
        "Check for swapped wires of motors or encoders, and for a wrong sign in the wiring file; "
        "repeat the direction test before you close the loop again.",
    ),
    Fault.INTERNAL_ERROR: Explanation(
        "The control loop failed because of an error in its own code.",
        "Reset: this starts a new control loop. Report the error with the flight record and the log; "
        "if the fault recurs, do not continue.",
    ),
}


def describe_fault(fault: Fault, seen: str = "") -> str:
    """Return the meaning of a fault, followed by the observation ``seen``."""
    message = EXPLANATIONS[fault].message
    return f"{message.removesuffix('.')}: {seen.removesuffix('.')}." if seen else message
