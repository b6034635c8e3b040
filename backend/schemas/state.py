"""Schemas of the live state: control, session, faults, touch, trigger, system."""

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
from plant import Breakage, PlantKind, Sensor

# Control -------------------------------------------------------------------------------------------
#
# Control of the actuator: who holds it, and how it is taken.


PageKey = Annotated[str, Field(max_length=16, pattern="^[A-Za-z0-9_-]{16}$")]


class ControlRequest(Schema):
    """Take control; over from somebody else only if that is said."""

    take_over: bool = Field(default=False, description="take control although somebody else holds it")
    resume: PageKey | None = Field(
        default=None, description="the key of this page before it was loaded again: goes on, or is refused"
    )
    handed: RowNumber | None = Field(
        default=None, description="the number under which it was handed over or offered: takes that, or is refused"
    )


class Lease(Schema):
    """Control was given: commands carry ``Sinew-Control: page.sequence``, the sequence counting 1, 2, 3 ..."""

    epoch: int
    page: PageKey = Field(description="known to this page alone, told to nobody else")
    name: str


class HolderView(Schema):
    """Who holds control."""

    name: str
    epoch: int
    page: bool = Field(description="a page, which is missed when it falls silent, or a script")
    silent_s: float = quantity("s", "time since the holder was last heard")
    lost: bool = Field(description="not heard any more: references are held, a soft stop follows")


Reason = Annotated[str, Field(max_length=200, description="why, in a few words; stands in the log")]


class HandoverRequest(Schema):
    """Ask whoever holds control for it, or offer it to somebody as the page that holds it."""

    reason: Reason
    to: str | None = Field(default=None, max_length=60, description="to whom it is offered; null asks for it")


class HandoverAnswer(StrEnum):
    """What one of the two says to a request or an offer."""

    HAND_OVER = "hand_over"
    DECLINE = "decline"
    """Of the holder: keep control; of who is offered it: do not take it; also what either takes back."""


class HandoverReply(Schema):
    """What is said to a request or an offer; whoever keeps control says why."""

    answer: HandoverAnswer
    reason: Reason = ""


class HandoverStatus(StrEnum):
    """How a request or an offer stands: the first three wait for somebody, the others are its end."""

    ASKED = "asked"
    OFFERED = "offered"
    HANDED = "handed"
    """To who asked for it, whose page takes it now."""

    TAKEN = "taken"
    DECLINED = "declined"
    WITHDRAWN = "withdrawn"
    LAPSED = "lapsed"
    LEFT = "left"
    FREED = "freed"
    """Control was given up or lost, or who offered it does not hold it any more."""


OPEN_HANDOVERS = (HandoverStatus.ASKED, HandoverStatus.OFFERED, HandoverStatus.HANDED)
"""Those that wait for somebody."""


class HandoverView(Schema):
    """Control that somebody asks for, or that is offered to somebody."""

    number: int
    name: str = Field(description="who is to have it")
    by: str = Field(description="who holds it: is asked, or offers it")
    reason: str
    standing: HandoverStatus
    answer: str = Field(description="why it was declined, or what was said beside handing it over")
    offered: bool = Field(description="offered without being asked for")
    epoch: int | None = Field(description="what others know the control by that was taken by this; null before")


# Faults --------------------------------------------------------------------------------------------
#
# What can go wrong, and how to make it happen where the plant is simulated.


class SilentPart(StrEnum):
    """What falls silent in the safety chain, the plant being whole."""

    SERVICE_SILENT = "service_silent"
    PAGE_SILENT = "page_silent"


class Injection(Schema):
    """One thing to break."""

    kind: Breakage | SilentPart
    sensor: Sensor = Field(default=Sensor.Q, description="which reading, where the kind is about one")


class FaultKind(Schema):
    """A fault with its words, and what brings it about while the joint moves."""

    code: Fault
    message: str
    remedy: str
    injection: Injection | None = Field(description="what to break; null where there is nothing to be broken")
    by_hand: str = Field(description="what a person does instead; empty where something can be broken")


class CardFault(Schema):
    """Something that can go wrong with a card and its wires."""

    injection: Injection
    says: str = Field(description="what is broken, as a person reads it")
    leads_to: list[Fault] = Field(description="the faults it may end in while the joint moves")


class FaultList(Schema):
    """All faults there are, in the order of their codes; and what can be broken of the card, where it is virtual."""

    faults: list[FaultKind]
    card: list[CardFault]


# System --------------------------------------------------------------------------------------------
#
# How the machine, the loop's timing, the disk and the database do; backups.


class LatenessClass(Schema):
    """Ticks that began later than one bound and not later than the next."""

    from_us: float = quantity("µs", "lower bound of the lateness")
    to_us: float | None = quantity("µs", "upper bound; null for none")
    ticks: int


class DatabaseView(Schema):
    """The database and the disk it lies on."""

    kind: str
    schema_revision: str | None
    size_bytes: int | None = Field(description="null where another server keeps it")
    disk_free_bytes: int


class BackupView(Schema):
    """A copy of the database in the data folder."""

    name: str
    at: datetime
    size_bytes: int


class SystemView(Schema):
    """What the System page shows beside the state."""

    granted: RealTimeStatus | None = Field(description="null while no loop runs")
    lateness: list[LatenessClass] = Field(description="of the last minute's ticks")
    versions: dict[str, str]
    database: DatabaseView
    backups: list[BackupView]


class DatabaseCheck(Schema):
    """All that is wrong with the database; empty when it is sound."""

    problems: list[str]


class DeletableRun(Schema):
    """A run whose samples may go."""

    run: int
    kind: str
    who: str
    note: str
    started: datetime
    size_bytes: int


class RecordingsView(Schema):
    """What recordings take, and which may go, oldest first; empty while they take less than the limit."""

    total_bytes: int
    limit_bytes: int
    in_use_bytes: int = Field(description="of runs that models, results or reports came from: these never go")
    keep_days: int = Field(description="nothing younger may go")
    may_go: list[DeletableRun]
    says: str = Field(description="empty while there is nothing to decide")


class RemovalRequest(Schema):
    """The runs whose samples are to be deleted, each of them on the list as it is now."""

    runs: Annotated[list[RowNumber], FailFast()] = Field(min_length=1, max_length=10_000)


# Touch ---------------------------------------------------------------------------------------------
#
# Touch: the outside force, what was learned of it, and the joint that gives way.


class TouchPoint(Schema):
    """What is estimated at one stiffness with nothing outside."""

    S: float = quantity("N·m/rad", "joint stiffness at which it was learned")
    F: float = quantity("N", "mean of the estimate with nothing outside, taken off from then on")
    std_N: float = quantity("N", "standard deviation of the estimate at rest")


class ContactView(Schema):
    """The contact that the joint gives way to."""

    F_ext_hat: float = quantity("N", "outside force in the tick in which it was felt")
    contact_N: float = quantity("N", "force from which on it counted as a contact")
    tick: int


class SweepView(Schema):
    """Learning over all of the stiffness by itself: how far it is, or how the last time ended."""

    under_way: bool
    point: int = Field(description="the one that is learned, or was when it ended, from 1")
    points: int
    S_ref: float = quantity("N·m/rad", "stiffness reference at that point", **ANY_SIZE)
    why: str = Field(description="why it ended before its end; empty where it did not")


class TouchView(Schema):
    """What is in force of touch."""

    contact_N: float = quantity("N", "force from which on the joint gives way; 0 for never")
    learned: list[TouchPoint] = Field(description="by rising stiffness; between them straight lines are taken off")
    felt: ContactView | None = Field(description="given way to at present; null for none")
    sweep: SweepView | None = Field(default=None, description="learning over S by itself; null where there was none")


class TouchOrder(Schema):
    """What is to change: null and false leave what is."""

    contact_N: float | None = quantity(
        "N", "force from which on the joint gives way to a contact, 0 for never", default=None, **ANY_SIZE
    )
    learn: bool = Field(default=False, description="take what is estimated now for nothing outside, at this stiffness")
    forget: bool = Field(default=False, description="forget what was learned; with learn, all but that")
    sweep: Literal["begin", "stop"] | None = Field(
        default=None, description="learn over all of the stiffness, point by point, with nobody at the joint; alone"
    )


# Formula -------------------------------------------------------------------------------------------
#
# Derived signals by formula: as written, and as the steps that compute them.


FormulaName = Annotated[str, Field(min_length=1, max_length=20, pattern="^[A-Za-z][A-Za-z0-9_]*$")]


class FormulaText(Schema):
    """What a person writes."""

    expression: Annotated[str, Field(min_length=1, max_length=MAX_LENGTH), ONE_LINE] = Field(
        description="expression over signals in SI, as in experiments: + - * / % **, comparisons, min, max, abs, sqrt, "
        "round, if else"
    )
    unit: Annotated[str, Field(min_length=1, max_length=20), ONE_LINE] = Field(
        description="SI unit of the result, as the writer says; 1 for a plain number"
    )
    meaning: Annotated[str, Field(max_length=100), ONE_LINE] = Field(default="", description="what it is, in words")


class FormulaView(FormulaText):
    """A formula as it is in force."""

    name: str
    who: str
    at: datetime
    signals: list[str] = Field(description="the signals that it is made of")
    steps: list[FormulaStep]


class FormulaList(Schema):
    """The formulas of the station, by name."""

    formulas: list[FormulaView]


# Trigger -------------------------------------------------------------------------------------------
#
# The trigger: what is waited for, and what it does at present.


LONGEST_S = 60.0
"""Longest time before a trigger, which the ring still holds, and longest time after it."""

CAPTURES_MAX = 100

_Value = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class TriggerOrder(Schema):
    """A condition on one signal, and how much is kept around it."""

    signal: str = Field(max_length=40, description="name of a signal of the sample, of a combined one, or of a formula")
    condition: ConditionKind = Field(description="a level, an edge through a level, or a window")
    level: _Value = Field(description="level, or lower end of the window, in the SI unit of the signal")
    upper: _Value | None = Field(default=None, description="upper end of the window; null without a window")
    before_s: float = quantity("s", "time kept before the trigger", default=1.0, ge=0.0, le=LONGEST_S)
    after_s: float = quantity("s", "time kept from the trigger on", default=1.0, ge=0.001, le=LONGEST_S)
    captures: int = Field(default=1, ge=1, le=CAPTURES_MAX, description="how many are made before it disarms itself")


class TriggerView(TriggerOrder):
    """What was armed last, and what it does at present."""

    unit: str = Field(description="SI unit of the signal")
    says: str = Field(description="the condition in words, in SI")
    who: str
    at: datetime
    phase: Literal["armed", "capturing", "ended"]
    captured: int = Field(description="captures made so far")
    left_s: float = quantity("s", "time until the capture under way is complete; 0 while none is")
    ended: str = Field(description="why it waits for nothing any more; empty while it does")


# State ---------------------------------------------------------------------------------------------
#
# The state of the session at the bench: mode, references, tuning, limits, faults.


class PlantView(Schema):
    """What is driven: its kind, its name as runs keep it, and in words how it is connected and timed."""

    kind: PlantKind
    simulated: bool = Field(description="whether what moves is computed: it can be pushed, and broken to order")
    name: str
    says: str
    r_m: float = quantity("m", "radius of a motor's reel")
    r_j: float = quantity("m", "radius of the joint's pulley")


class LinkView(Schema):
    """The road to the loop process."""

    alive: bool
    silent_s: float = quantity("s", "time since the loop's newest sample was seen")
    starts: int = Field(description="how many times the loop process has been started by this service")
    restarting: str = Field(
        default="", description="purpose of the planned restart under way; empty while there is none"
    )
    restarting_s: float | None = quantity("s", "time since that restart began; null while there is none", default=None)


class TimingView(Schema):
    """How well the loop keeps its period."""

    period_s: float = quantity("s", "sampling period")
    rate_Hz: float = quantity("Hz", "ticks per second over the last 5 s")
    lateness_p50_ms: float = quantity("ms", "median lateness of the ticks of the last 5 s")
    lateness_p99_ms: float = quantity("ms", "99th percentile of lateness of the ticks of the last 5 s")
    overruns: int = Field(description="deadlines missed since the loop started")


class References(Schema):
    """What the cascade is asked to follow, as in force."""

    q_ref: float = quantity("rad", "joint position reference", **ANY_SIZE)
    S_ref: float = quantity("N·m/rad", "joint stiffness reference", **ANY_SIZE)


class ReferencesView(Schema):
    """References as the page shows them; where none are in force, what is measured, from where a mode would start."""

    q_ref: float = quantity("rad", "joint position reference", **ANY_SIZE)
    S_ref: float | None = quantity("N·m/rad", "joint stiffness reference; null while a tendon is slack", **ANY_SIZE)
    in_force: bool = Field(description="whether something is asked to follow them; else they are what is measured")


class PushRequest(Schema):
    """An external force on a simulated joint, held for a time."""

    F_push: float = quantity("N", "force, tangential at the joint pulley, positive towards +q; 0 lets go", **ANY_SIZE)
    duration_s: float = quantity("s", "time after which the loop lets go by itself", default=1.0, **ANY_SIZE)


class WallView(Schema):
    """An obstacle in a simulated joint's way."""

    q_wall: float = quantity("rad", "where it stands", **ANY_SIZE)
    side: Literal["above", "below"] = Field(default="above", description="on which side of that angle it stands")
    k_wall: float = quantity("N/m", "its stiffness, at the joint pulley", default=20000.0, **ANY_SIZE)
    c_wall: float = quantity("s/m", "its damping, at the joint pulley", default=1.0, **ANY_SIZE)


class WallOrder(Schema):
    """What is to stand in the joint's way; null takes it away."""

    wall: WallView | None


class TensionView(Schema):
    """How stiff the joint is at rest with one tension in both tendons, wherever it stands."""

    F: float = quantity("N", "tension in both tendons")
    S: float = quantity("N·m/rad", "joint stiffness")


class LimitsView(Schema):
    """Where the operator's inputs end, and the lines the charts draw."""

    q_min: float = quantity("rad", "smallest joint position reference")
    q_max: float = quantity("rad", "largest joint position reference")
    S_min: float = quantity("N·m/rad", "smallest stiffness reference")
    S_max: float = quantity("N·m/rad", "largest stiffness reference")
    F_min: float = quantity("N", "slack line: least tendon tension wanted")
    F_max: float = quantity("N", "tendon tension at which the spring is solid")
    F_push_max: float = quantity("N", "largest external push, either way; 0 where nothing can push")
    F_contact_min: float = quantity("N", "least outside force that a joint may give way to as a contact")
    F_contact_max: float = quantity("N", "largest such force")
    k_wall_min: float = quantity("N/m", "least stiffness of a wall in the joint's way; 0 where none can be put up")
    k_wall_max: float = quantity("N/m", "largest such stiffness")
    c_wall_max: float = quantity("s/m", "largest damping of such a wall; the least is 0")
    u_max: float = quantity("V", "largest motor voltage, either way")
    q_trip: float = quantity("rad", "joint position at which the joint trips, either way")
    tensions: list[TensionView] = Field(description="from slack to solid spring: where tension limits stiffness")


class FaultView(Schema):
    """The latched fault."""

    code: Fault
    message: str
    remedy: str
    tick: int
    expected: bool = Field(
        default=False,
        description="whether this trip is a planned event: provoked by the bring-up",
    )


class StopProof(Schema):
    """What a stop took: when it arrived in the loop and when the outputs were at zero."""

    arrived_tick: int
    zero_tick: int
    milliseconds: float = quantity("ms", "from arrival in the loop to zero volts")
    paused_recording: bool = Field(
        default=False, description="whether a recording was paused: nothing is driven, and nothing is latched"
    )


class ChainLinkView(Schema):
    """One link of the safety chain; each watches the one before it."""

    name: Literal["page", "service", "loop", "watchdog", "safety_module"]
    good: bool
    silent_s: float | None = quantity("s", "time since it was last heard; null where there is nothing to hear")
    says: str


class PartView(Schema):
    """The named part of a program that is being played; of an identification the set point, and what is done there."""

    title: str
    number: int = Field(description="which of the parts it is, from 1 on; set points count over all runs of the order")
    of: int
    doing: Stage | None = Field(default=None, description="what is done at a set point; null in an experiment")
    left_s: float = quantity("s", "time until the part is over")
    t: float = quantity("s", "time since the program began")


class TaskView(Schema):
    """The identification or experiment that is running."""

    kind: str
    title: str = Field(default="", description="title of an experiment that is data; empty where the kind says it")
    run: int
    elapsed_s: float = quantity("s", "time since the task began")
    duration_s: float = quantity("s", "expected length of the task")
    phase: RunPhase
    part: PartView | None = Field(description="null where the program has no parts, or is not played")
    number: int = Field(description="which run of its order this is, from 1 on")
    following: int = Field(default=0, description="runs of the same order that follow this one")
    pause_wanted: bool = Field(default=False, description="whether the next run of the order is to wait")

    @property
    def paused(self) -> bool:
        """Whether the next run of its order waits, in pretension."""
        return self.phase is RunPhase.PAUSED


class TrialView(TuningParts):
    """A tuning on trial: when it ends; the tuning here is what comes back then."""

    remaining_s: float = quantity("s", "time until the earlier tuning is put back")
    duration_s: float = quantity("s", "length of the trial")


class ModeRequest(Schema):
    """The mode wanted."""

    mode: Mode


class State(Schema):
    """Everything the status line and the controls show."""

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
    unready: str = Field(description="what has to come before pretension on what is driven; empty where nothing has")
    pretension_done: bool
    stop_proof: StopProof | None
    holder: HolderView | None
    people: list[PersonView] = Field(description="who has a page open; a number tells persons of one name apart")
    wishes: list[HandoverView] = Field(description="who asks for control or is offered it, and what came of that")
    chain: list[ChainLinkView] = Field(description="the safety chain in order, from the page to the safety module")
    task: TaskView | None
    trial: TrialView | None = Field(description="a tuning that is reverted by itself")
    trigger: TriggerView | None = Field(
        description="the trigger that was armed last since the service started; null where none was"
    )
    wall: WallView | None = Field(description="what stands in a simulated joint's way; null where nothing does")
    player: PlayerView | None = Field(default=None, description="where a recording stands that is played; else null")
    own_tuning: ChosenTuning | None = Field(
        description="what the operator had chosen, in force again after the run; null while no run has the tuning"
    )
    earlier: ChosenTuning | None = Field(
        description="what was in force before the last change, and is again once that is undone; null for nothing"
    )
    later: ChosenTuning | None = Field(
        default=None,
        description="what the last undo took back, and is in force again after a redo; null for nothing",
    )
    recording_run: int | None = Field(description="run that the samples belong to at present")
    problems: list[str] = Field(description="what is wrong with the service without being a fault of the loop")


# Live ----------------------------------------------------------------------------------------------
#
# The JSON messages of the websocket /api/live; the samples themselves travel in binary frames
# (backend.wire).


Whole = Annotated[int, Field(ge=0, le=2**53)]


class LayoutMessage(Schema):
    """First message: how to read everything after it."""

    type: Literal["layout"] = "layout"
    fields: list[SampleField]
    period_s: float = quantity("s", "sampling period")
    modes: list[str] = Field(description="mode by its code in the sample")
    faults: list[str] = Field(description="fault by its code in the sample")
    limits: dict[str, int] = Field(description="bit of each limit in the sample")


class StateMessage(State):
    """The state, at once, on each change and at least twice a second."""

    type: Literal["state"] = "state"


class MarkKind(StrEnum):
    """What a mark on the time axis is about."""

    MODE = "mode"
    TUNING = "tuning"
    BANK = "bank"
    FAULT = "fault"
    TRIP = "trip"
    TRIGGER = "trigger"
    REFERENCES = "references"
    NOTE = "note"


class EventMessage(Schema):
    """A mark on the time axis."""

    type: Literal["event"] = "event"
    tick: int
    kind: MarkKind
    text: str


class Ping(Schema):
    """Asked by the page to measure the link; ``control`` is the key of the control it holds, if it does."""

    type: Literal["ping"] = "ping"
    id: Whole
    control: PageKey | None = None


class Pong(Schema):
    """Answer to a ping."""

    type: Literal["pong"] = "pong"
    id: int


LiveMessage = LayoutMessage | StateMessage | EventMessage | Pong
