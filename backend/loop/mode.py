"""The modes of the loop and the moves between them, as an explicit table."""

from enum import StrEnum


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


class RefusedError(Exception):
    """A command that cannot be carried out now; ``legal`` lists the modes that could be asked for instead."""

    def __init__(self, reason: str, legal: tuple[Mode, ...] = ()) -> None:
        super().__init__(reason)
        self.legal = legal
