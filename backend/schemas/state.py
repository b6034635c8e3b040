"""Schemas of the live state and the live messages.

Control lease, faults, system, contact, formulas and trigger.
"""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import FailFast, Field

from backend.execution import RunPhase
from backend.experiments import MAX_LENGTH, Stage
from backend.faults import Fault
from backend.plain_text import ONE_LINE
from backend.realtime import Mode, RealTimeStatus
from backend.recording import ConditionKind, FormulaStep
from backend.sample import Field as SampleField
from backend.schemas.base import ANY_SIZE, HUGE, RowNumber, Schema, quantity
from backend.schemas.run import PlayerView
from backend.schemas.session import PersonView
from backend.schemas.tuning import ChosenTuning, TuningParts, TuningView
from plant import InjectedFaultKind, PlantKind, Sensor

# Control lease -------------------------------------------------------------------------------------


PageKey = Annotated[str, Field(max_length=16, pattern="^[A-Za-z0-9_-]{16}$")]


class ControlRequest(Schema):
    """Request for the control lease; another holder loses it only with ``take_over``."""

    take_over: bool = Field(default=False, description="whether to take control even if another session holds it")
    resume: PageKey | None = Field(
        default=None,
        description="key of this page before it was reloaded, to continue its lease; "
        "rejected if the page has lost control",
    )
    handed: RowNumber | None = Field(
        default=None,
        description="number of the handover or offer to accept; rejected if it is not open for this session",
    )


class Lease(Schema):
    """A granted control lease.

    Commands have the header ``Sinew-Control: page.sequence``, sequence 1, 2, 3 ...
    """

    epoch: int
    page: PageKey = Field(description="secret key of this page")
    name: str


class HolderView(Schema):
    """The session that holds the control lease."""

    name: str
    epoch: int
    page: bool = Field(description="true for a page, which must send heartbeats; false for a script")
    silent_s: float = quantity("s", "time since the last heartbeat or command of the holder")
    lost: bool = Field(description="whether heartbeats are missing: references are held, and a soft stop follows")


Reason = Annotated[str, Field(max_length=200, description="reason in a few words; recorded in the log")]


class HandoverRequest(Schema):
    """Request for the control lease, or its offer by the holder."""

    reason: Reason
    to: str | None = Field(
        default=None, max_length=60, description="the person to whom control is offered; null requests control"
    )


class HandoverAnswer(StrEnum):
    """Answer to a request for the control lease, or to an offer of it."""

    HAND_OVER = "hand_over"
    DECLINE = "decline"
    """The holder keeps the lease, the other one does not take it, or either withdraws."""


class HandoverReply(Schema):
    """Reply to a request or an offer; a holder who keeps the lease gives a reason."""

    answer: HandoverAnswer
    reason: Reason = ""


class HandoverStatus(StrEnum):
    """Status of a request or an offer: the first three are open, the others closed."""

    ASKED = "asked"
    OFFERED = "offered"
    HANDED = "handed"
    """Granted to the page that asked, which takes it next."""

    TAKEN = "taken"
    DECLINED = "declined"
    WITHDRAWN = "withdrawn"
    LAPSED = "lapsed"
    LEFT = "left"
    FREED = "freed"
    """The lease was released or lost, or the one who offered it no longer holds it."""


OPEN_HANDOVERS = (HandoverStatus.ASKED, HandoverStatus.OFFERED, HandoverStatus.HANDED)
"""Status of requests and offers that are open."""


class HandoverView(Schema):
    """A request for the control lease, or an offer of it."""

    number: int
    name: str = Field(description="person who will hold the lease")
    by: str = Field(description="present holder of the lease")
    reason: str
    standing: HandoverStatus
    answer: str = Field(description="reason or comment in the reply")
    offered: bool = Field(description="whether the holder offered the lease without a request")
    epoch: int | None = Field(description="epoch of the lease that this handover started; null before")


# Faults --------------------------------------------------------------------------------------------


class SilentPart(StrEnum):
    """Part of the safety chain that stops sending heartbeats in an injected fault."""

    SERVICE_SILENT = "service_silent"
    PAGE_SILENT = "page_silent"


class Injection(Schema):
    """An injected fault."""

    kind: InjectedFaultKind | SilentPart
    sensor: Sensor = Field(default=Sensor.Q, description="affected reading, for the kinds that affect one reading")


class FaultKind(Schema):
    """A fault with its texts, and the injection that causes it while the joint moves."""

    code: Fault
    message: str
    remedy: str
    injection: Injection | None = Field(description="injection that causes it; null if there is none")
    by_hand: str = Field(description="how a person can cause it instead, or why not; empty if there is an injection")


class CardFault(Schema):
    """A fault of a card or its wires."""

    injection: Injection
    says: str = Field(description="text that describes it")
    leads_to: list[Fault] = Field(description="faults that it may cause while the joint moves")


class FaultList(Schema):
    """All faults in the order of their codes, and faults of the virtual card."""

    faults: list[FaultKind]
    card: list[CardFault]


# System --------------------------------------------------------------------------------------------


class LatenessClass(Schema):
    """Number of control steps whose lateness lies between two bounds."""

    from_us: float = quantity("µs", "lower bound of the lateness")
    to_us: float | None = quantity("µs", "upper bound of the lateness; null for none")
    ticks: int


class DatabaseView(Schema):
    """The database and its disk."""

    kind: str
    schema_revision: str | None
    size_bytes: int | None = Field(description="null for a database server")
    disk_free_bytes: int


class BackupView(Schema):
    """A copy of the database in the data folder."""

    name: str
    at: datetime
    size_bytes: int


class SystemView(Schema):
    """Content of the System page, in addition to the state."""

    granted: RealTimeStatus | None = Field(description="null while no loop runs")
    lateness: list[LatenessClass] = Field(description="distribution of the lateness over the last minute")
    versions: dict[str, str]
    database: DatabaseView
    backups: list[BackupView]


class DatabaseCheck(Schema):
    """Errors found in the database."""

    problems: list[str]


class DeletableRun(Schema):
    """A run whose samples may be deleted."""

    run: int
    kind: str
    who: str
    note: str
    started: datetime
    size_bytes: int


class RecordingsView(Schema):
    """Size of the recordings, and those that may be deleted, oldest first.

    There are none while the recordings are below the limit.
    """

    total_bytes: int
    limit_bytes: int
    in_use_bytes: int = Field(
        description="size of the recordings that models, results or reports depend on; they are never deleted"
    )
    keep_days: int = Field(description="age in days below which no recording is deleted")
    may_go: list[DeletableRun]
    says: str = Field(description="text for the operator; empty if there is nothing to decide")


class RemovalRequest(Schema):
    """Runs whose samples to delete; each must be in the current list of deletable runs."""

    runs: Annotated[list[RowNumber], FailFast()] = Field(min_length=1, max_length=10_000)


# Contact -------------------------------------------------------------------------------------------
# Bias of the external force, and contact reaction.


class TouchPoint(Schema):
    """Bias of the external force at one stiffness."""

    S: float = quantity("N·m/rad", "joint stiffness at which it was calibrated")
    F: float = quantity("N", "mean of the estimate without external force, subtracted from then on")
    std_N: float = quantity("N", "standard deviation of the estimate at rest")


class ContactView(Schema):
    """The contact that the joint reacts to."""

    F_ext_hat: float = quantity("N", "estimated external force at the time of detection")
    contact_N: float = quantity("N", "threshold of the detection")
    tick: int


class SweepView(Schema):
    """Progress or result of the calibration of the bias over the stiffness range."""

    under_way: bool
    point: int = Field(description="number of the current or last point, from 1")
    points: int
    S_ref: float = quantity("N·m/rad", "stiffness reference at that point", **ANY_SIZE)
    why: str = Field(description="reason for an early end; else empty")


class TouchView(Schema):
    """Bias and contact reaction that are active."""

    contact_N: float = quantity("N", "threshold of the contact reaction; 0 for none")
    learned: list[TouchPoint] = Field(
        description="bias at each calibrated stiffness in ascending order; linear interpolation between them"
    )
    felt: ContactView | None = Field(description="contact that the joint reacts to at present; null for none")
    sweep: SweepView | None = Field(default=None, description="calibration over the stiffness range; null for none")


class TouchOrder(Schema):
    """Changes of bias and contact reaction; null and false change nothing."""

    contact_N: float | None = quantity(
        "N", "threshold of the contact reaction, 0 if it is disabled", default=None, **ANY_SIZE
    )
    learn: bool = Field(
        default=False, description="calibrate: use the present estimate as the bias at the present stiffness"
    )
    forget: bool = Field(
        default=False, description="discard the calibrated bias; with learn, all points except the new one"
    )
    sweep: Literal["begin", "stop"] | None = Field(
        default=None,
        description="calibrate over the whole stiffness range, point by point; nobody may touch the "
        "joint; not permitted together with another field",
    )


# Derived signals -----------------------------------------------------------------------------------


FormulaName = Annotated[str, Field(min_length=1, max_length=20, pattern="^[A-Za-z][A-Za-z0-9_]*$")]


class FormulaText(Schema):
    """Formula of a derived signal."""

    expression: Annotated[str, Field(min_length=1, max_length=MAX_LENGTH), ONE_LINE] = Field(
        description="expression over signals in SI, as in experiments: + - * / % **, comparisons, min, max, abs, sqrt, "
        "round, if else"
    )
    unit: Annotated[str, Field(min_length=1, max_length=20), ONE_LINE] = Field(
        description="SI unit of the result, as stated by the author; 1 for a dimensionless number"
    )
    meaning: Annotated[str, Field(max_length=100), ONE_LINE] = Field(
        default="", description="description of the signal"
    )


class FormulaView(FormulaText):
    """A stored formula with its author and its compiled steps."""

    name: str
    who: str
    at: datetime
    signals: list[str] = Field(description="signals in the expression")
    steps: list[FormulaStep]


class FormulaList(Schema):
    """The formulas of the station, by name."""

    formulas: list[FormulaView]


# Trigger -------------------------------------------------------------------------------------------


LONGEST_S = 60.0
"""Maximum time before a trigger, limited by the ring buffer, and after it [s]."""

CAPTURES_MAX = 100

_Value = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class TriggerOrder(Schema):
    """A condition on one signal, and the time range to capture around it."""

    signal: str = Field(
        max_length=40, description="name of a sample column, of a combined signal or of a derived signal"
    )
    condition: ConditionKind = Field(description="a level, an edge through a level, or a window")
    level: _Value = Field(description="level, or lower end of the window, in the SI unit of the signal")
    upper: _Value | None = Field(default=None, description="upper end of the window; null without a window")
    before_s: float = quantity("s", "time to capture before the trigger", default=1.0, ge=0.0, le=LONGEST_S)
    after_s: float = quantity("s", "time to capture after the trigger", default=1.0, ge=0.001, le=LONGEST_S)
    captures: int = Field(
        default=1, ge=1, le=CAPTURES_MAX, description="number of captures after which the trigger disarms itself"
    )


class TriggerView(TriggerOrder):
    """The trigger that was armed last, and its state."""

    unit: str = Field(description="SI unit of the signal")
    says: str = Field(description="text of the condition, in SI")
    who: str
    at: datetime
    phase: Literal["armed", "capturing", "ended"]
    captured: int = Field(description="captures made so far")
    left_s: float = quantity("s", "remaining time of the current capture; 0 without one")
    ended: str = Field(description="why the trigger is no longer armed; empty while it is armed")


# State ---------------------------------------------------------------------------------------------


class PlantView(Schema):
    """The plant: kind, name in runs, and a text about connection and timing."""

    kind: PlantKind
    simulated: bool = Field(description="whether the joint is simulated, so that pushes and faults can be injected")
    name: str
    says: str
    r_m: float = quantity("m", "radius of a motor's reel")
    r_j: float = quantity("m", "radius of the joint's pulley")


class LinkView(Schema):
    """Connection to the control loop process."""

    alive: bool
    silent_s: float = quantity("s", "age of the newest sample")
    starts: int = Field(description="number of starts of the control loop by this service")
    restarting: str = Field(default="", description="purpose of the current planned restart; empty without one")
    restarting_s: float | None = quantity("s", "time since that restart began; null while there is none", default=None)


class TimingView(Schema):
    """Timing of the control loop."""

    period_s: float = quantity("s", "sampling period")
    rate_Hz: float = quantity("Hz", "control steps per second over the last 5 s")
    lateness_p50_ms: float = quantity("ms", "median lateness of the control steps in the last 5 s")
    lateness_p99_ms: float = quantity("ms", "99th percentile of the lateness of the control steps in the last 5 s")
    overruns: int = Field(description="deadlines missed since the control loop started")


class References(Schema):
    """Active references of the cascade."""

    q_ref: float = quantity("rad", "joint position reference", **ANY_SIZE)
    S_ref: float = quantity("N·m/rad", "joint stiffness reference", **ANY_SIZE)


class ReferencesView(Schema):
    """Active references, or the measured values from which a mode would start."""

    q_ref: float = quantity("rad", "joint position reference", **ANY_SIZE)
    S_ref: float | None = quantity("N·m/rad", "joint stiffness reference; null while a tendon is slack", **ANY_SIZE)
    in_force: bool = Field(description="whether the references are active; else they are measured values")


class PushRequest(Schema):
    """An external force on a simulated joint, held for a time."""

    F_push: float = quantity("N", "force, tangential at the joint pulley, positive towards +q; 0 releases", **ANY_SIZE)
    duration_s: float = quantity("s", "time after which the control loop ends the push", default=1.0, **ANY_SIZE)


class WallView(Schema):
    """Obstacle of a simulated joint."""

    q_wall: float = quantity("rad", "angle of the obstacle", **ANY_SIZE)
    side: Literal["above", "below"] = Field(default="above", description="side of this angle that the obstacle blocks")
    k_wall: float = quantity("N/m", "stiffness of the obstacle at the joint pulley", default=20000.0, **ANY_SIZE)
    c_wall: float = quantity("s/m", "damping of the obstacle at the joint pulley", default=1.0, **ANY_SIZE)


class WallOrder(Schema):
    """Obstacle to set; null removes it."""

    wall: WallView | None


class TensionView(Schema):
    """Stiffness of the joint at rest with the same tension in both tendons."""

    F: float = quantity("N", "tension in both tendons")
    S: float = quantity("N·m/rad", "joint stiffness")


class LimitsView(Schema):
    """Bounds of the operator's inputs, and limits that the charts show."""

    q_min: float = quantity("rad", "smallest joint position reference")
    q_max: float = quantity("rad", "largest joint position reference")
    S_min: float = quantity("N·m/rad", "smallest stiffness reference")
    S_max: float = quantity("N·m/rad", "largest stiffness reference")
    F_min: float = quantity("N", "smallest tendon tension that keeps a tendon taut")
    F_max: float = quantity("N", "tendon tension above which the control loop trips")
    F_push_max: float = quantity("N", "largest push in either direction; 0 if pushes are not possible")
    F_contact_min: float = quantity("N", "smallest threshold of the contact reaction")
    F_contact_max: float = quantity("N", "largest threshold of the contact reaction")
    k_wall_min: float = quantity("N/m", "smallest stiffness of an obstacle; 0 if obstacles are not possible")
    k_wall_max: float = quantity("N/m", "largest stiffness of an obstacle")
    c_wall_max: float = quantity("s/m", "largest damping of an obstacle; the smallest is 0")
    u_max: float = quantity("V", "largest motor voltage in either direction")
    q_trip: float = quantity("rad", "joint position in either direction at which the control loop trips")
    tensions: list[TensionView] = Field(description="joint stiffness versus tension, from F_min to at most F_max")


class FaultView(Schema):
    """The latched fault."""

    code: Fault
    message: str
    remedy: str
    tick: int
    expected: bool = Field(
        default=False,
        description="whether commissioning caused this trip as planned",
    )


class StopProof(Schema):
    """Proof of a STOP: the ticks of its arrival in the control loop and of zero volts."""

    arrived_tick: int
    zero_tick: int
    milliseconds: float = quantity("ms", "time from the arrival of STOP in the control loop to zero volts")
    paused_recording: bool = Field(
        default=False, description="whether a replay was paused instead, which latches nothing"
    )


class ChainLinkView(Schema):
    """One link of the safety chain; each monitors the previous one, except the independent safety module."""

    name: Literal["page", "service", "loop", "watchdog", "safety_module"]
    good: bool
    silent_s: float | None = quantity("s", "time since its last heartbeat; null for a link without heartbeats")
    says: str


class PartView(Schema):
    """Current named part of a program.

    For an identification, the operating point and its stage.
    """

    title: str
    number: int = Field(description="number of the part from 1; operating points count over all runs of the request")
    of: int
    doing: Stage | None = Field(default=None, description="stage at an operating point; null in an experiment")
    left_s: float = quantity("s", "remaining time of the part")
    t: float = quantity("s", "time since the program began")


class TaskView(Schema):
    """The current identification or experiment."""

    kind: str
    title: str = Field(default="", description="title of an experiment; empty for an identification")
    run: int
    elapsed_s: float = quantity("s", "time since the run began")
    duration_s: float = quantity("s", "expected duration of the run")
    phase: RunPhase
    part: PartView | None = Field(description="null if the program has no parts or is not executed yet")
    number: int = Field(description="number of this run in its request, from 1")
    following: int = Field(default=0, description="number of later runs of the same request")
    pause_wanted: bool = Field(default=False, description="whether the next run of the request will wait")

    @property
    def paused(self) -> bool:
        """Whether the next run of the request waits, in pretension."""
        return self.phase is RunPhase.PAUSED


class TrialView(TuningParts):
    """A trial: the tuning that is restored at its end, and the time until then."""

    remaining_s: float = quantity("s", "time until the earlier tuning is restored")
    duration_s: float = quantity("s", "duration of the trial")


class ModeRequest(Schema):
    """The requested mode."""

    mode: Mode


class State(Schema):
    """State of actuator, control loop and service."""

    mode: Mode
    legal_modes: list[Mode]
    plant: PlantView
    parameters: str
    tick: int
    link: LinkView
    timing: TimingView
    references: ReferencesView
    tuning: TuningView
    limits: LimitsView
    touch: TouchView
    fault: FaultView | None
    unready: str = Field(description="what this plant requires before pretension; empty if nothing")
    pretension_done: bool
    stop_proof: StopProof | None
    holder: HolderView | None
    people: list[PersonView] = Field(description="persons with an open page; equal names get a number")
    wishes: list[HandoverView] = Field(description="requests and offers of the control lease, with their status")
    chain: list[ChainLinkView] = Field(description="the safety chain in order, from the page to the safety module")
    task: TaskView | None
    trial: TrialView | None = Field(description="trial of a tuning; null without one")
    trigger: TriggerView | None = Field(
        description="trigger that was armed last since the start of the service; null without one"
    )
    wall: WallView | None = Field(description="obstacle of a simulated joint; null without one")
    player: PlayerView | None = Field(default=None, description="position of a replay; null for other plants")
    own_tuning: ChosenTuning | None = Field(
        description="tuning of the operator, restored after the run; null unless a run applies a temporary tuning"
    )
    earlier: ChosenTuning | None = Field(description="tuning that an undo would restore; null without one")
    later: ChosenTuning | None = Field(default=None, description="tuning that a redo would restore; null without one")
    recording_run: int | None = Field(description="run that is being recorded; null without one")
    problems: list[str] = Field(description="problems of the service other than faults of the control loop")


# Live messages -------------------------------------------------------------------------------------
# JSON messages of the websocket /api/live; samples are sent in binary frames (backend.wire).


Whole = Annotated[int, Field(ge=0, le=2**53)]


class LayoutMessage(Schema):
    """First message: the layout of all later messages."""

    type: Literal["layout"] = "layout"
    fields: list[SampleField]
    period_s: float = quantity("s", "sampling period")
    modes: list[str] = Field(description="mode by its code in the sample")
    faults: list[str] = Field(description="fault by its code in the sample")
    limits: dict[str, int] = Field(description="bit of each limit in the sample")


class StateMessage(State):
    """The state, sent after the layout, on each change and at least twice a second."""

    type: Literal["state"] = "state"


class MarkKind(StrEnum):
    """Kind of a mark on the time axis."""

    MODE = "mode"
    TUNING = "tuning"
    BANK = "bank"
    FAULT = "fault"
    TRIP = "trip"
    TRIGGER = "trigger"
    REFERENCES = "references"
    NOTE = "note"


class EventMessage(Schema):
    """An event to mark on the time axis."""

    type: Literal["event"] = "event"
    tick: int
    kind: MarkKind
    text: str


class Ping(Schema):
    """Request of the page that measures the round-trip time.

    ``control`` is the key of its control lease, if any.
    """

    type: Literal["ping"] = "ping"
    id: Whole
    control: PageKey | None = None


class Pong(Schema):
    """Answer to a ping."""

    type: Literal["pong"] = "pong"
    id: int


LiveMessage = LayoutMessage | StateMessage | EventMessage | Pong
