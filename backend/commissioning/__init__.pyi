from . import status
from .procedure import ProcedureContext, StepFinding
from .session import (
    BlockedError,
    CommissioningSession,
    DriveLockout,
    OperatorDialog,
    collect_values,
    open_session,
    run_step,
    switch_drives,
)
from .status import (
    StepState,
    StepStatus,
    StoredResults,
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
    "CommissioningSession",
    "CommissioningStep",
    "DriveLockout",
    "Input",
    "OperatorDialog",
    "ProcedureContext",
    "StepFinding",
    "StepId",
    "StepState",
    "StepStatus",
    "StoredResults",
    "collect_values",
    "find_blocking_steps",
    "find_completed_commissioning",
    "find_for_next_start",
    "open_session",
    "run_step",
    "status",
    "switch_drives",
]
