"""The steps of the commissioning: texts, inputs, prerequisites and validity."""

from dataclasses import dataclass
from enum import StrEnum

from backend.commissioning import messages


class StepId(StrEnum):
    """Identifiers of the steps, in order."""

    WIRING_TEST = "wiring_test"
    TARE = "tare"
    CALIBRATE = "calibrate"
    ZERO = "zero"
    DIRECTION = "direction"
    HOME = "home"
    PRETENSION = "pretension"
    SAFETY_MODULE = "safety_module"


@dataclass(frozen=True)
class Input:
    """A number that the person enters for a step, with bounds in its unit."""

    name: str
    words: str
    unit: str
    default: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class CommissioningStep:
    """A step; its result is valid for ``holds_days``, and the steps ``needs`` must have passed before."""

    id: StepId
    title: str
    instruction: str
    holds_days: float
    needs: tuple[StepId, ...] = ()
    inputs: tuple[Input, ...] = ()


WEIGHT_MAX_N = 45.0
"""Heaviest weight [N] of a calibration; load cells and springs bear 50 N."""

FURTHER_WEIGHTS = tuple(
    Input(
        name=f"weight_{n}_N", words=messages.further_weight(), unit="N", default=15.0, minimum=0.0, maximum=WEIGHT_MAX_N
    )
    for n in range(3, 10)
)
"""Optional weights of a calibration, in addition to the two required ones."""

STEPS: tuple[CommissioningStep, ...] = (
    CommissioningStep(
        StepId.WIRING_TEST,
        "Wiring test",
        messages.instruction_wiring_test(),
        holds_days=30.0,
    ),
    CommissioningStep(
        StepId.TARE,
        "Tare",
        messages.instruction_tare(),
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.CALIBRATE,
        "Calibration",
        messages.instruction_calibrate(),
        holds_days=180.0,
        needs=(StepId.WIRING_TEST,),
        inputs=(
            Input(
                name="weight_1_N",
                words=messages.lighter_weight(),
                unit="N",
                default=5.0,
                minimum=0.0,
                maximum=WEIGHT_MAX_N,
            ),
            Input(
                name="weight_2_N",
                words=messages.heavier_weight(),
                unit="N",
                default=25.0,
                minimum=0.0,
                maximum=WEIGHT_MAX_N,
            ),
        ),
    ),
    CommissioningStep(
        StepId.ZERO,
        "Zero",
        messages.instruction_zero(),
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.DIRECTION,
        "Motor directions",
        messages.instruction_direction(),
        holds_days=30.0,
        needs=(StepId.WIRING_TEST, StepId.ZERO),
    ),
    CommissioningStep(
        StepId.HOME,
        "Homing",
        messages.instruction_home(),
        holds_days=1.0,
        needs=(StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.PRETENSION,
        "Pretension",
        messages.instruction_pretension(),
        holds_days=30.0,
        needs=(StepId.TARE, StepId.CALIBRATE, StepId.ZERO, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.SAFETY_MODULE,
        "Safety module",
        messages.instruction_safety_module(),
        holds_days=30.0,
        needs=(StepId.PRETENSION,),
    ),
)

ALTERNATIVES = {StepId.ZERO: StepId.HOME, StepId.HOME: StepId.ZERO}
"""Steps that replace each other: both set the zero of the encoders."""

STEP: dict[StepId, CommissioningStep] = {step.id: step for step in STEPS}
