"""Schemas of banks, parameters and tunings."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from backend.banks import BankEntryChange, BankEntryFigures
from backend.plain_text import ONE_LINE
from backend.schemas.base import ANY_SIZE, Finite, RowNumber, Schema, quantity
from backend.storage import StoredFit

# Bank ----------------------------------------------------------------------------------------------
#
# Banks: built from identification runs, compared, taken out and brought in.


Text = Annotated[str, Field(max_length=100), ONE_LINE]
BankName = Annotated[str, Field(min_length=1, max_length=60, description="name of the bank"), ONE_LINE]


class BankRequest(Schema):
    """A new bank, or a new version of the bank of that name, from chosen identification runs."""

    name: BankName
    identifications: list[RowNumber] = Field(min_length=1, max_length=20)


class BankEntryView(Schema):
    """One point of a bank and the identification it came from."""

    identification: int | None = Field(description="identification run it came from; null for an imported entry")
    tension_N: float | None = quantity("N", "tendon tension of the point")
    S_nominal: float = quantity("N·m/rad", "stiffness of the point")
    q_nominal: float | None = quantity("rad", "joint position it was identified at; null where that is not known")
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
    """Where the models of an entry came from, and how good they are."""

    identification: int | None = Field(description="identification run; null for data from elsewhere")
    estimate: int = Field(description="number of the stored estimate, of which a run may have several")
    method: str
    verdict: str
    position: StoredFit
    stiffness: StoredFit
    run: int | None
    created: datetime
    who: str
    plant: str | None
    parameters: str | None = Field(description="name of the parameter set of that run; its numbers are with the run")


class BankEntryDetail(Schema):
    """An entry in full."""

    figures: BankEntryFigures
    lineage: EntryLineage | None = Field(description="null for an imported entry")


class BankDetail(Schema):
    """A bank in full, at the λ in force."""

    lam_q: float = quantity("s", "λ_q that the gains are for")
    lam_S: float = quantity("s", "λ_S that the gains are for")
    entries: list[BankEntryDetail]


class BankDifference(Schema):
    """What using other entries would change, at the λ in force."""

    lam_q: float = quantity("s", "λ_q that the gains are for")
    lam_S: float = quantity("s", "λ_S that the gains are for")
    entries: list[BankEntryChange]


class BankFileEntry(Schema):
    """One point in a bank's file."""

    S_nominal: Finite = quantity("N·m/rad", "stiffness of the point")
    K_q: Finite = Field(description="K of G_q")
    T_q: Finite = quantity("s", "T of G_q")
    K_S: Finite = Field(description="K of G_S")
    T_S: Finite = quantity("s", "T of G_S")
    tension_N: Finite | None = quantity("N", "tendon tension of the point", default=None)


class BankOrigin(Schema):
    """Where a bank's file came from."""

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


# Parameters ----------------------------------------------------------------------------------------
#
# The parameters in force: what the controller knows of motors and springs, by versions over the
# parameter file.


class ParameterChange(Schema):
    """An entry that a version changes, of one side; null where it has no such entry before or after."""

    name: str
    side: str
    unit: str
    before: float | None
    after: float | None
    percent: float | None = Field(description="change in per cent of what it was; null where it was 0 or nothing")


class ParameterVersion(Schema):
    """A version; number 0 is the parameter file as it is."""

    number: int
    digest: str = Field(description="of all numbers with their sources, as lineage shows it")
    who: str
    at: datetime | None
    estimate: int | None = Field(description="stored identification that its values came from last")
    run: int | None = Field(description="run of that identification; null for a table")
    undone: bool = Field(description="whether it put a former version back")
    changes: list[ParameterChange] = Field(description="against the version before")


class ParameterProposal(Schema):
    """What applying an identification would change, or why it cannot be applied."""

    estimate: int
    problem: str = Field(description="why it cannot be applied; empty where it can")
    digest: str
    changes: list[ParameterChange]


class ParametersView(Schema):
    """The set in force, newest version first, and what was asked about an identification."""

    name: str
    versions: list[ParameterVersion]
    proposal: ParameterProposal | None


class ApplyRequest(Schema):
    """The stored identification to apply, of motors or springs, by the number of its estimate."""

    estimate: RowNumber


class UndoRequest(Schema):
    """The version to undo: the newest, as whoever undoes it sees it."""

    version: RowNumber


# Tuning --------------------------------------------------------------------------------------------
#
# λ of the three loops, what they would do, and where their ranges end.


Motion = Literal["lambda", "time-optimal"]


class BankReference(Schema):
    """The bank in use."""

    id: int
    name: str
    version: int


class TuningParts(Schema):
    """A tuning, whatever is said of it: the parts of ``TuningSettings`` but for the bank."""

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
