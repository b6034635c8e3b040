"""The modes of the loop, the transitions between them as a table, and their causes."""

from enum import StrEnum

from backend.faults import Fault
from plant import ErrorCode, SinewError

# Causes --------------------------------------------------------------------------------------------
#
# Why the loop has moved between modes: what decides hangs on these, their words are for people.


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


# Mode ----------------------------------------------------------------------------------------------
#
# The modes of the loop and the moves between them, as an explicit table.


class Mode(StrEnum):
    """What the loop is doing. The position in this enum is the code in the sample."""

    OFF = "off"
    PRETENSION = "pretension"
    RUN = "run"
    COMPLIANCE = "compliance"
    IDENTIFY = "identify"
    EXPERIMENT = "experiment"
    STOPPING = "stopping"
    TRIPPED = "tripped"


MODES: tuple[Mode, ...] = tuple(Mode)
MODE_CODE: dict[Mode, int] = {mode: code for code, mode in enumerate(MODES)}

MOVING = (Mode.RUN, Mode.COMPLIANCE, Mode.IDENTIFY, Mode.EXPERIMENT)

LEGAL: dict[Mode, tuple[Mode, ...]] = {
    Mode.OFF: (Mode.PRETENSION,),
    Mode.PRETENSION: (*MOVING, Mode.STOPPING, Mode.OFF),
    Mode.RUN: (Mode.PRETENSION, Mode.COMPLIANCE, Mode.IDENTIFY, Mode.EXPERIMENT, Mode.STOPPING),
    Mode.COMPLIANCE: (Mode.PRETENSION, Mode.RUN, Mode.STOPPING),
    Mode.IDENTIFY: (Mode.PRETENSION, Mode.STOPPING),
    Mode.EXPERIMENT: (Mode.PRETENSION, Mode.RUN, Mode.STOPPING),
    Mode.STOPPING: (),
    Mode.TRIPPED: (),
}
"""Moves that an operator may ask for. TRIPPED is left by reset (to OFF) only; a hard stop leads there from anywhere.

STOPPING ends in OFF by itself. The moves out of PRETENSION towards motion are granted once both tendons hold the
pretension (``Refused`` says so before that).
"""


DRIVES_OFF = (
    "the drives are switched off, as hands may be at the rig: take them off, then switch the drives on in the bring-up"
)
"""Why nothing starts while hands are at the rig."""


class CommandRejectedError(SinewError):
    """A command that cannot be carried out now; ``legal`` lists the modes that could be asked for instead."""

    category = ErrorCode.NOT_NOW

    def __init__(self, reason: str, legal: tuple[Mode, ...] = ()) -> None:
        super().__init__(reason)
        self.legal = legal
