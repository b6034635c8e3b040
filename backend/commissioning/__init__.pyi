from . import status
from .procedure import ProcedureContext, StepFinding
from .session import BlockedError, KeptHands, Prompt, Session, collect_values, open_session, run_step, switch_drives
from .status import (
    Kept,
    StepState,
    StepStatus,
    find_blocking_steps,
    find_completed_commissioning,
    find_for_next_start,
)
from .steps import INSTEAD, MORE_WEIGHTS, STEP, STEPS, CommissioningStep, Input, StepId

__all__ = [
    "INSTEAD",
    "MORE_WEIGHTS",
    "STEP",
    "STEPS",
    "BlockedError",
    "CommissioningStep",
    "Input",
    "Kept",
    "KeptHands",
    "ProcedureContext",
    "Prompt",
    "Session",
    "StepFinding",
    "StepId",
    "StepState",
    "StepStatus",
    "collect_values",
    "find_blocking_steps",
    "find_completed_commissioning",
    "find_for_next_start",
    "open_session",
    "run_step",
    "status",
    "switch_drives",
]
