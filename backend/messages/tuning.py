"""λ of the three loops, what they would do, and where their ranges end."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from backend.messages.base import ANY_SIZE, Schema, quantity

Motion = Literal["lambda", "time-optimal"]


class BankReference(Schema):
    """The bank in use."""

    id: int
    name: str
    version: int


class TuningParts(Schema):
    """A tuning, whatever is said of it: the parts of ``TuningChoice`` but for the bank."""

    lam_q: float = quantity("s", "tuning parameter of the position loop")
    lam_S: float = quantity("s", "tuning parameter of the stiffness loop")
    lam_motor: float = quantity("s", "tuning parameter of the motor loops")
    b: float = quantity("1", "weight of the reference in the outer loops' proportional part")
    interpolate: bool = Field(description="gain scheduling between entries instead of switching")
    motion: Motion = Field(description="how references are followed: by the paper's law, or by a trajectory")
    u_plan: float = quantity("V", "voltage limit of time-optimal motion")
    k_ext: float = quantity("1", "share of the estimated outside force that is fed forward against it; 0: none")


class ChosenTuning(TuningParts):
    """A tuning with the bank whose models it is for."""

    bank: BankReference | None = Field(description="bank in use; None while the gains come from geometry")


class TuningView(ChosenTuning):
    """The tuning in force."""

    lam_q_min: float = quantity("s", "smallest λ_q offered (M_s = 1.7 on the high-order model)")
    lam_q_max: float = quantity("s", "largest λ_q offered")
    lam_S_min: float = quantity("s", "smallest λ_S offered (M_s = 1.7 on the high-order model)")
    lam_S_max: float = quantity("s", "largest λ_S offered")
    lam_motor_min: float = quantity("s", "smallest λ_motor offered (M_s of the sampled loop at most 1.7)")
    lam_motor_max: float = quantity("s", "largest λ_motor offered")
    u_plan_min: float = quantity("V", "smallest voltage limit of time-optimal motion that is offered")
    u_plan_max: float = quantity("V", "largest voltage limit offered: the rest is for load, friction and feedback")
    entry: float = Field(description="active entry of the bank, fractional while interpolating")
    entry_name: str = Field(description="what that entry is called, by its tension; empty without a bank")


class TuningRequest(Schema):
    """The tuning wanted; what is left out stays as it is."""

    lam_q: float | None = quantity("s", "tuning parameter of the position loop", default=None, **ANY_SIZE)
    lam_S: float | None = quantity("s", "tuning parameter of the stiffness loop", default=None, **ANY_SIZE)
    lam_motor: float | None = quantity("s", "tuning parameter of the motor loops", default=None, **ANY_SIZE)
    b: float | None = quantity("1", "weight of the reference, 0 to 1", default=None, **ANY_SIZE)
    interpolate: bool | None = Field(default=None, description="gain scheduling instead of switching")
    motion: Motion | None = Field(default=None, description="how references are followed")
    u_plan: float | None = quantity(
        "V",
        "voltage limit of time-optimal motion; without a motion it also chooses that motion, and 0 chooses lambda",
        default=None,
        **ANY_SIZE,
    )
    k_ext: float | None = quantity("1", "share of the outside force fed forward, 0: none", default=None, **ANY_SIZE)


class TrialRequest(TuningRequest):
    """A tuning to try: the service itself puts the earlier one back."""

    duration_s: float = quantity("s", "how long it stays in force", ge=1.0, le=600.0)


class SavedTuning(TuningParts):
    """What the bank in use is meant to run with; ``who`` is null while nobody has saved: the defaults then."""

    who: str | None
    at: datetime | None
    moved: str = Field(description="which λ of the method's defaults is not offered here, and what stands for it")


class PrintedFormula(Schema):
    """The loop with k_p = 2/(K λ) as table 2 prints it: erratum E1, for comparison only, never in force."""

    stable: bool
    M_s: float | None = Field(description="maximum of the sensitivity function; null when unstable")
    t: list[float] = quantity("s", "time of the step it would make; empty where λ does not make the steps")
    y: list[float] = Field(description="progress of that step, 0 before it and 1 at the new reference [1]")


class LoopPreview(Schema):
    """How robust one outer loop is at a λ, at the stiffness and with the bank entry of the preview."""

    lam: float = quantity("s", "λ previewed")
    lam_min: float = quantity("s", "where the safe range begins")
    lam_max: float = quantity("s", "where the offered range ends")
    stable: bool
    M_s: float | None = Field(description="maximum of the sensitivity function; null when unstable")
    gain_margin: float | None = Field(
        description="factor by which the gain may grow before instability; null when unstable or unlimited"
    )
    phase_margin_deg: float | None = quantity("°", "phase left before instability; null when unstable or unlimited")
    printed: PrintedFormula | None = Field(description="with the printed formula; null where it was not asked for")


class StepPreview(Schema):
    """A step of one reference, the other one held: simulated on the identified plant with its friction and sensors."""

    start: float = Field(description="reference before the step [rad or N·m/rad]")
    end: float = Field(description="reference after it [rad or N·m/rad]")
    rise_s: float | None = quantity("s", "when 90 % of the step are reached; null where they are not")
    settling_s: float | None = quantity("s", "from when on it stays within 2 % of the step; null where it does not")
    overshoot_percent: float = quantity("%", "overshoot of the step")
    u_peak_V: float = quantity("V", "largest motor voltage of the step")
    F_min_N: float = quantity("N", "least tendon tension of the step")
    t: list[float] = quantity("s", "time from the step on")
    y: list[float] = Field(description="progress of the step, 0 before it and 1 at the new reference [1]")


class MotorPreview(Schema):
    """How robust the motor loops are at a λ_motor, as sampled and with L/R: the less robust of the two."""

    M_s: float = Field(description="maximum of the sensitivity function")
    gain_margin: float | None = Field(
        description="factor by which the gain may grow before instability; null when unlimited"
    )
    gain_reduction_margin: float | None = Field(
        description="factor to which the gain may fall before instability; null when it may fall to nothing"
    )
    phase_margin_deg: float | None = quantity("°", "phase left before instability; null when unlimited")


class RobustLambda(Schema):
    """The λ of one loop for a wanted M_s, or why there is none."""

    lam: float | None = quantity(
        "s", "smallest λ offered that has this M_s at every entry of the bank; null where there is none"
    )
    reason: str = Field(description="why there is none, or an empty text")


class RobustTuning(Schema):
    """λ of the three loops for a wanted M_s, on the high-order models."""

    M_s: float = Field(description="wanted maximum of the sensitivity function")
    lam_motor: RobustLambda
    lam_q: RobustLambda
    lam_S: RobustLambda


class PushPreview(Schema):
    """What a push does to the joint that is held, at the active entry of the bank."""

    give: float = quantity("rad", "largest deviation under the push")
    t: list[float] = quantity("s", "time from the begin of the push on")
    off: list[float] = quantity("rad", "deviation from the reference over that time")
    back_s: float | None = quantity("s", "from when on it stays near its reference; null where it does not come back")
    felt_slow: float = quantity("N·m/rad", "outside torque over deviation when leant on, at 0.1 Hz")
    felt_fast: float = quantity("N·m/rad", "outside torque over deviation when shaken, at 1 Hz")


class PushedPreview(Schema):
    """A held push of ``F`` without a rejection and, where ``k_ext`` is not 0, with it."""

    F: float = quantity("N", "the push")
    near: float = quantity("rad", "the joint is back when it stays so near to its reference")
    k_ext: float = quantity("1", "share of the push that is fed forward")
    without: PushPreview
    rejected: PushPreview | None = Field(description="with the rejection; null where k_ext is 0")


class TuningPreview(Schema):
    """What a tuning would do at one stiffness: how robust its loops are, a step of each reference, and a push."""

    motion: Motion = Field(
        description="lambda: λ sets the time of the steps; time-optimal: a trajectory within U_plan does"
    )
    S: float = quantity("N·m/rad", "stiffness reference that all of it is for")
    motor: MotorPreview
    position: LoopPreview
    stiffness: LoopPreview
    step_q: StepPreview
    step_S: StepPreview
    pushed: PushedPreview
