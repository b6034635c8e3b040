"""Schemas of banks, parameters and tunings."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from backend.banks import BankEntryChange, BankEntryFigures
from backend.plain_text import ONE_LINE
from backend.schemas.base import ANY_SIZE, Finite, RowNumber, Schema, quantity
from backend.storage import StoredFit

# Banks ---------------------------------------------------------------------------------------------


Text = Annotated[str, Field(max_length=100), ONE_LINE]
BankName = Annotated[str, Field(min_length=1, max_length=60, description="name of the bank"), ONE_LINE]


class BankRequest(Schema):
    """Identification runs from which to build a bank or its next version."""

    name: BankName
    identifications: list[RowNumber] = Field(min_length=1, max_length=20)


class BankEntryView(Schema):
    """One operating point of a bank and its identification."""

    identification: int | None = Field(description="run of its identification; null for an imported one")
    tension_N: float | None = quantity("N", "tendon tension of the point")
    S_nominal: float = quantity("N·m/rad", "stiffness of the point")
    q_nominal: float | None = quantity("rad", "joint position of the identification; null if unknown")
    K_q: float
    T_q: float = quantity("s", "time constant of G_q")
    K_S: float
    T_S: float = quantity("s", "time constant of G_S")


class BankView(Schema):
    """One version of a bank."""

    id: int
    name: str
    version: int
    created: datetime
    who: str
    note: str
    active: bool
    entries: list[BankEntryView]


class BankList(Schema):
    """All versions of all banks, newest first."""

    banks: list[BankView]


class EntryLineage(Schema):
    """Origin and quality of the models of an operating point."""

    identification: int | None = Field(description="identification run; null for imported data")
    estimate: int = Field(description="number of the stored estimate; a run may have several")
    method: str
    verdict: str
    position: StoredFit
    stiffness: StoredFit
    run: int | None
    created: datetime
    who: str
    plant: str | None
    parameters: str | None = Field(description="name of the parameter set of that run; the run stores its values")


class BankEntryDetail(Schema):
    """An operating point with its gains, margins and lineage."""

    figures: BankEntryFigures
    lineage: EntryLineage | None = Field(description="null for an imported operating point")


class BankDetail(Schema):
    """All operating points of a bank, with gains for the active λ."""

    lam_q: float = quantity("s", "λ_q for which the gains are computed")
    lam_S: float = quantity("s", "λ_S for which the gains are computed")
    entries: list[BankEntryDetail]


class BankDifference(Schema):
    """Changes of gains and margins between two sets of operating points, for the active λ."""

    lam_q: float = quantity("s", "λ_q for which the gains are computed")
    lam_S: float = quantity("s", "λ_S for which the gains are computed")
    entries: list[BankEntryChange]


class BankFileEntry(Schema):
    """One operating point in the file of a bank."""

    S_nominal: Finite = quantity("N·m/rad", "stiffness of the point")
    K_q: Finite = Field(description="K of G_q")
    T_q: Finite = quantity("s", "T of G_q")
    K_S: Finite = Field(description="K of G_S")
    T_S: Finite = quantity("s", "T of G_S")
    tension_N: Finite | None = quantity("N", "tendon tension of the point", default=None)


class BankOrigin(Schema):
    """Origin of the file of a bank."""

    bank: RowNumber
    version: RowNumber
    who: Text
    made: Text


class BankFile(Schema):
    """A bank as a file."""

    format: Text = "sinew-bank"
    version: RowNumber = 1
    name: BankName
    exported_from: BankOrigin | None = None
    units: dict[Text, Text] = Field(default_factory=dict, max_length=20)
    entries: list[BankFileEntry] = Field(min_length=1, max_length=20)


# Active parameters ---------------------------------------------------------------------------------


class ParameterChange(Schema):
    """An entry that a version changes.

    ``before`` or ``after`` is null if only the other has it.
    """

    name: str
    side: str
    unit: str
    before: float | None
    after: float | None
    percent: float | None = Field(description="change in percent; null if the earlier value is 0 or missing")


class ParameterVersion(Schema):
    """A version of the parameters; number 0 is the parameter file."""

    number: int
    digest: str = Field(description="digest of all values with their sources, as in the lineage")
    who: str
    at: datetime | None
    estimate: int | None = Field(description="stored identification that was applied last")
    run: int | None = Field(description="run of that identification; null for a table")
    undone: bool = Field(description="whether it restored an earlier version")
    changes: list[ParameterChange] = Field(description="changes from the previous version")


class ParameterProposal(Schema):
    """Changes that applying an identification would make, or why it cannot be applied."""

    estimate: int
    problem: str = Field(description="why it cannot be applied; else empty")
    digest: str
    changes: list[ParameterChange]


class ParametersView(Schema):
    """Active parameters, newest version first, and a requested proposal."""

    name: str
    versions: list[ParameterVersion]
    proposal: ParameterProposal | None


class ApplyRequest(Schema):
    """Stored identification of motors or springs to apply."""

    estimate: RowNumber


class UndoRequest(Schema):
    """Version to undo, which must be the newest one."""

    version: RowNumber


# Tuning --------------------------------------------------------------------------------------------


Motion = Literal["lambda", "time-optimal"]


class BankReference(Schema):
    """A version of a bank."""

    id: int
    name: str
    version: int


class TuningParts(Schema):
    """Parts of ``TuningSettings`` without the bank."""

    lam_q: float = quantity("s", "tuning parameter of the position loop")
    lam_S: float = quantity("s", "tuning parameter of the stiffness loop")
    lam_motor: float = quantity("s", "tuning parameter of the motor loops")
    b: float = quantity("1", "weight of the reference in the outer loops' proportional part")
    interpolate: bool = Field(description="whether gains are interpolated between operating points instead of switched")
    motion: Motion = Field(description="how references are followed: by the paper's law, or by a trajectory")
    u_plan: float = quantity("V", "voltage limit of time-optimal motion")
    k_ext: float = quantity("1", "gain of the disturbance rejection; 0 for none")


class ChosenTuning(TuningParts):
    """A tuning with its bank."""

    bank: BankReference | None = Field(description="bank of the gains; null for geometric gains")


class TuningView(ChosenTuning):
    """The active tuning, with the ranges of its parts."""

    lam_q_min: float = quantity(
        "s", "smallest λ_q accepted: M_s at most 1.7 on the high-order model, no step saturates"
    )
    lam_q_max: float = quantity("s", "largest λ_q accepted")
    lam_S_min: float = quantity(
        "s", "smallest λ_S accepted: M_s at most 1.7 on the high-order model, no step saturates"
    )
    lam_S_max: float = quantity("s", "largest λ_S accepted")
    lam_motor_min: float = quantity("s", "smallest λ_motor accepted (M_s of the sampled loop at most 1.7)")
    lam_motor_max: float = quantity("s", "largest λ_motor accepted")
    u_plan_min: float = quantity("V", "smallest voltage limit of time-optimal motion accepted")
    u_plan_max: float = quantity(
        "V", "largest voltage limit accepted: the remaining voltage is reserved for load, friction and feedback"
    )
    entry: float = Field(description="index of the active operating point in the bank, fractional during interpolation")
    entry_name: str = Field(description="name of that operating point, from its tension; empty without a bank")


class TuningRequest(Schema):
    """Requested changes of the tuning; parts that are null do not change."""

    lam_q: float | None = quantity("s", "tuning parameter of the position loop", default=None, **ANY_SIZE)
    lam_S: float | None = quantity("s", "tuning parameter of the stiffness loop", default=None, **ANY_SIZE)
    lam_motor: float | None = quantity("s", "tuning parameter of the motor loops", default=None, **ANY_SIZE)
    b: float | None = quantity("1", "weight of the reference, 0 to 1", default=None, **ANY_SIZE)
    interpolate: bool | None = Field(
        default=None, description="whether gains are interpolated between operating points instead of switched"
    )
    motion: Motion | None = Field(default=None, description="how references are followed")
    u_plan: float | None = quantity(
        "V",
        "voltage limit of time-optimal motion; if motion is omitted, a value above 0 also selects "
        "time-optimal, and 0 selects lambda",
        default=None,
        **ANY_SIZE,
    )
    k_ext: float | None = quantity("1", "gain of the disturbance rejection, 0 for none", default=None, **ANY_SIZE)


class TrialRequest(TuningRequest):
    """A trial of a tuning, after which the service restores the earlier one."""

    duration_s: float = quantity("s", "duration of the trial", ge=1.0, le=600.0)


class SavedTuning(TuningParts):
    """Saved tuning of the active bank.

    It has the defaults, with ``who`` null, if nobody has saved one.
    """

    who: str | None
    at: datetime | None
    moved: str = Field(description="default λ of the method that is not accepted here, and the value that replaces it")


class PrintedFormula(Schema):
    """The loop with k_p = 2/(K λ) as in table 2 of the paper, for comparison only.

    The formula is erratum E1.
    """

    stable: bool
    M_s: float | None = Field(description="maximum of the sensitivity function; null when unstable")
    t: list[float] = quantity("s", "time of the step response; empty if λ does not determine the steps")
    y: list[float] = Field(
        description="progress of the step response, 0 before the step and 1 at the new reference [1]"
    )


class LoopPreview(Schema):
    """Robustness of one outer loop for a λ, at the stiffness and operating point of the preview."""

    lam: float = quantity("s", "λ of the preview")
    lam_min: float = quantity("s", "smallest λ accepted")
    lam_max: float = quantity("s", "largest λ accepted")
    stable: bool
    M_s: float | None = Field(description="maximum of the sensitivity function; null when unstable")
    gain_margin: float | None = Field(
        description="factor by which the loop gain may increase before the loop becomes unstable; null when "
        "unstable or unlimited"
    )
    phase_margin_deg: float | None = quantity(
        "°", "additional phase lag that makes the loop unstable; null when unstable or unlimited"
    )
    printed: PrintedFormula | None = Field(description="result with the printed formula; null if not requested")


class StepPreview(Schema):
    """Simulated step of one reference, with the other one constant.

    The plant is the identified one, with friction and sensors.
    """

    start: float = Field(description="reference before the step [rad or N·m/rad]")
    end: float = Field(description="reference after the step [rad or N·m/rad]")
    rise_s: float | None = quantity("s", "time to 90 % of the step; null if it is not reached")
    settling_s: float | None = quantity(
        "s", "settling time, until the signal stays within 2 % of the step; null if it does not"
    )
    overshoot_percent: float = quantity("%", "overshoot of the step")
    u_peak_V: float = quantity("V", "largest motor voltage of the step")
    F_min_N: float = quantity("N", "smallest tendon tension of the step")
    t: list[float] = quantity("s", "time since the step")
    y: list[float] = Field(description="progress of the step, 0 before it and 1 at the new reference [1]")


class MotorPreview(Schema):
    """Robustness of the less robust motor loop for a λ_motor, with sampling and L/R."""

    M_s: float = Field(description="maximum of the sensitivity function")
    gain_margin: float | None = Field(
        description="factor by which the loop gain may increase before the loop becomes unstable; null when unlimited"
    )
    gain_reduction_margin: float | None = Field(
        description="factor to which the loop gain may fall before the loop becomes unstable; null when "
        "it may fall to zero"
    )
    phase_margin_deg: float | None = quantity(
        "°", "additional phase lag that makes the loop unstable; null when unlimited"
    )


class RobustLambda(Schema):
    """λ of one loop for a requested M_s, or why there is none."""

    lam: float | None = quantity(
        "s",
        "smallest accepted λ for which M_s does not exceed the requested value at any operating point "
        "of the bank; null if there is none",
    )
    reason: str = Field(description="why there is none; else empty")


class RobustTuning(Schema):
    """λ of the three loops for a requested M_s, computed with the high-order models."""

    M_s: float = Field(description="requested maximum of the sensitivity function")
    lam_motor: RobustLambda
    lam_q: RobustLambda
    lam_S: RobustLambda


class PushPreview(Schema):
    """Response of the joint at constant references to a constant push.

    The models are those of the active operating point.
    """

    give: float = quantity("rad", "largest deviation under the push")
    t: list[float] = quantity("s", "time since the start of the push")
    off: list[float] = quantity("rad", "deviation from the reference at these times")
    back_s: float | None = quantity(
        "s", "time after which the joint stays near its reference; null if it does not return"
    )
    felt_slow: float = quantity("N·m/rad", "apparent stiffness at 0.1 Hz: external torque over deviation")
    felt_fast: float = quantity("N·m/rad", "apparent stiffness at 1 Hz: external torque over deviation")


class PushedPreview(Schema):
    """Response to a constant push of ``F`` with and without disturbance rejection."""

    F: float = quantity("N", "external force")
    near: float = quantity("rad", "largest deviation at which the joint counts as returned")
    k_ext: float = quantity("1", "gain of the disturbance rejection")
    without: PushPreview
    rejected: PushPreview | None = Field(description="response with disturbance rejection; null if k_ext is 0")


class TuningPreview(Schema):
    """Effect of a tuning at one stiffness: robustness, reference steps and a push."""

    motion: Motion = Field(
        description="lambda: λ determines the duration of steps; time-optimal: a trajectory within u_plan determines it"
    )
    S: float = quantity("N·m/rad", "stiffness reference of the preview")
    motor: MotorPreview
    position: LoopPreview
    stiffness: LoopPreview
    step_q: StepPreview
    step_S: StepPreview
    pushed: PushedPreview
