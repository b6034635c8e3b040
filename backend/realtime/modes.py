"""Modes of the loop, the table of transitions between them, and their causes."""

from enum import StrEnum

from backend.faults import Fault
from backend.realtime import messages
from plant import ErrorCode, SinewError

# Mode change causes --------------------------------------------------------------------------------
# Causes of mode changes: code depends on the members, people read their values.


class Cause(StrEnum):
    """Cause of a mode change without a fault."""

    ASKED_FOR = "requested"
    PROGRAM = "program"
    PROGRAM_ENDED = "program ended"
    CONTACT = "contact"
    STANDING = "standing"
    RESET = "reset"
    MOTOR_TRIAL = "motor trial"
    MOTOR_TRIED = "motor tried"
    HOMING = "homing"


class HomingEnd(StrEnum):
    """Result of homing; only HOMED sets a zero."""

    HOMED = "homed at the end switch"
    NOT_REACHED = "homing: the end switch did not close"
    STUCK_CLOSED = "homing: the end switch stayed closed"
    WRONG_WAY = "homing: the joint moved in the wrong direction"
    JOINT_HELD = "homing: the joint did not follow the motors"
    MOTOR_OFF = "homing: a motor did not reach its reference"
    TENSION = "homing: a tendon was too taut"
    SLACK = "homing: a tendon was slack"
    TOO_LONG = "homing: the motion took too long"


ModeCause = Cause | HomingEnd | Fault
"""Cause of a mode change; a fault if it stopped the loop."""


# Mode ----------------------------------------------------------------------------------------------
# Modes of the loop and the permitted transitions between them.


class Mode(StrEnum):
    """Mode of the loop. The position in this enum is the code in the sample."""

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
"""Transitions that an operator may request. Only reset leaves TRIPPED (to OFF); a hard stop leads to TRIPPED from any
mode. STOPPING ends in OFF. The transitions from PRETENSION to motion are permitted once both tendons hold the
pretension (before that the command is answered by ``Refused``)."""


DRIVES_OFF = messages.drives_switched_off()
"""Reason why no motion starts while people may be working at the rig."""


class CommandRejectedError(SinewError):
    """A command that cannot be executed now; ``legal`` lists the modes to choose from."""

    category = ErrorCode.NOT_NOW

    def __init__(self, reason: str, legal: tuple[Mode, ...] = ()) -> None:
        super().__init__(reason)
        self.legal = legal
