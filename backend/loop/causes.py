"""Why the loop has moved between modes: what decides hangs on these, their words are for people."""

from enum import StrEnum

from backend.faults import Fault


class Cause(StrEnum):
    """What led from one mode to the next, where nothing went wrong."""

    ASKED_FOR = "asked for"
    PROGRAM = "program"
    PROGRAM_ENDED = "program ended"
    CONTACT = "contact"
    STANDING = "standing"
    RESET = "reset"
    MOTOR_TRIAL = "motor trial"
    MOTOR_TRIED = "motor tried"
    HOMING = "homing"


class HomingEnd(StrEnum):
    """How it ended; HOMED alone sets a zero."""

    HOMED = "homed at the end switch"
    NOT_REACHED = "homing: the end switch did not close"
    STUCK_CLOSED = "homing: the end switch stayed closed"
    WRONG_WAY = "homing: the joint went the wrong way"
    JOINT_HELD = "homing: the joint did not follow the motors"
    MOTOR_OFF = "homing: a motor did not go where it was sent"
    TENSION = "homing: a tendon was too taut"
    SLACK = "homing: a tendon was slack"
    TOO_LONG = "homing: it took too long"


Why = Cause | HomingEnd | Fault
"""A fault, where it was one that stopped the loop."""
