"""The steps of the commissioning: texts, inputs, prerequisites and validity."""

from dataclasses import dataclass
from enum import StrEnum


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
    Input(name=f"weight_{n}_N", words="further weight", unit="N", default=15.0, minimum=0.0, maximum=WEIGHT_MAX_N)
    for n in range(3, 10)
)
"""Optional weights of a calibration, in addition to the two required ones."""

STEPS: tuple[CommissioningStep, ...] = (
    CommissioningStep(
        StepId.WIRING_TEST,
        "Wiring test",
        "Drives off, tendons slack. Turn the joint, then each motor, and pull at each tendon, as "
        "prompted: each time, the expected sensor must change in the expected direction.",
        holds_days=30.0,
    ),
    CommissioningStep(
        StepId.TARE,
        "Tare",
        "Slacken both tendons and remove all load from the load cells: the mean voltage over 1 s becomes their "
        "zero. The control loop restarts and the encoder zeros are lost: repeat Zero afterwards.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.CALIBRATE,
        "Calibration",
        "Hang two known weights on each load cell, one after the other: they determine slope and offset. "
        "The control loop restarts and the encoder zeros are lost: repeat Zero afterwards.",
        holds_days=180.0,
        needs=(StepId.WIRING_TEST,),
        inputs=(
            Input(name="weight_1_N", words="lighter weight", unit="N", default=5.0, minimum=0.0, maximum=WEIGHT_MAX_N),
            Input(name="weight_2_N", words="heavier weight", unit="N", default=25.0, minimum=0.0, maximum=WEIGHT_MAX_N),
        ),
    ),
    CommissioningStep(
        StepId.ZERO,
        "Zero",
        "Move the joint to a known position, its zero mark or the end switch: the encoders count from "
        "there. Each start of the control loop clears this zero.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.DIRECTION,
        "Motor directions",
        "Keep clear of the rig. Each motor turns a little, with 1 V at most, and back: its encoder count "
        "and its tension must increase, and the joint must move to its side.",
        holds_days=30.0,
        needs=(StepId.WIRING_TEST, StepId.ZERO),
    ),
    CommissioningStep(
        StepId.HOME,
        "Homing",
        "Keep clear of the rig. Both motors hold the tendons at 4 N and drive the joint to its end "
        "switch, slowly and with 1.5 V "
        "at most, and back to its middle: the encoders count from there. Any unexpected reading stops "
        "the homing at zero volts.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.PRETENSION,
        "Pretension",
        "Keep clear of the rig. Both motors apply the pretension: both tensions must rise together "
        "without exceeding their limit.",
        holds_days=30.0,
        needs=(StepId.TARE, StepId.CALIBRATE, StepId.ZERO, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.SAFETY_MODULE,
        "Safety module",
        "With pretension applied, lower the limit at the safety module until it trips. The control loop drives "
        "both motors for another 0.3 s, with 1 V at most: they must turn back, because the module has "
        "disabled the drives.",
        holds_days=30.0,
        needs=(StepId.PRETENSION,),
    ),
)

ALTERNATIVES = {StepId.ZERO: StepId.HOME, StepId.HOME: StepId.ZERO}
"""Steps that replace each other: both set the zero of the encoders."""

STEP: dict[StepId, CommissioningStep] = {step.id: step for step in STEPS}
