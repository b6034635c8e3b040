from . import status
from .procedure import ProcedureContext, StepFinding
from .session import BlockedError, DriveLockout, Prompt, Session, collect_values, open_session, run_step, switch_drives
from .status import (
    Kept,
    StepState,
    StepStatus,
    find_blocking_steps,
    find_completed_commissioning,
    find_for_next_start,
)
from .steps import ALTERNATIVES, FURTHER_WEIGHTS, STEP, STEPS, CommissioningStep, Input, StepId

__all__ = [
    "ALTERNATIVES",
    "FURTHER_WEIGHTS",
    "STEP",
    "STEPS",
    "BlockedError",
    "CommissioningStep",
    "DriveLockout",
    "Input",
    "Kept",
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
