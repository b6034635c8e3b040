"""The state of the session at the bench: mode, references, tuning, limits, faults."""

from typing import Literal

from pydantic import Field

from backend.execution.runner import Doing
from backend.experiments.forecast import Stage
from backend.faults import Fault
from backend.messages.base import ANY_SIZE, Schema, quantity
from backend.messages.control import HolderView, WishView
from backend.messages.player import PlayerView
from backend.messages.session import PersonView
from backend.messages.touch import TouchView
from backend.messages.trigger import TriggerView
from backend.messages.tuning import ChosenTuning, TuningParts, TuningView
from backend.realtime.program import Mode
from plant.interface import PlantKind


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


class Push(Schema):
    """An external force on a simulated joint, held for a time."""

    F_push: float = quantity("N", "force, tangential at the joint pulley, positive towards +q; 0 lets go", **ANY_SIZE)
    duration_s: float = quantity("s", "time after which the loop lets go by itself", default=1.0, **ANY_SIZE)


class Wall(Schema):
    """An obstacle in a simulated joint's way."""

    q_wall: float = quantity("rad", "where it stands", **ANY_SIZE)
    side: Literal["above", "below"] = Field(default="above", description="on which side of that angle it stands")
    k_wall: float = quantity("N/m", "its stiffness, at the joint pulley", default=20000.0, **ANY_SIZE)
    c_wall: float = quantity("s/m", "its damping, at the joint pulley", default=1.0, **ANY_SIZE)


class WallOrder(Schema):
    """What is to stand in the joint's way; null takes it away."""

    wall: Wall | None


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
    phase: Doing
    part: PartView | None = Field(description="null where the program has no parts, or is not played")
    number: int = Field(description="which run of its order this is, from 1 on")
    following: int = Field(default=0, description="runs of the same order that follow this one")
    pause_wanted: bool = Field(default=False, description="whether the next run of the order is to wait")

    @property
    def paused(self) -> bool:
        """Whether the next run of its order waits, in pretension."""
        return self.phase is Doing.PAUSED


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
    wishes: list[WishView] = Field(description="who asks for control or is offered it, and what came of that")
    chain: list[ChainLinkView] = Field(description="the safety chain in order, from the page to the safety module")
    task: TaskView | None
    trial: TrialView | None = Field(description="a tuning that is reverted by itself")
    trigger: TriggerView | None = Field(
        description="the trigger that was armed last since the service started; null where none was"
    )
    wall: Wall | None = Field(description="what stands in a simulated joint's way; null where nothing does")
    player: PlayerView | None = Field(default=None, description="where a recording stands that is played; else null")
    own_tuning: ChosenTuning | None = Field(
        description="what the operator had chosen, in force again after the run; null while no run has the tuning"
    )
    earlier: ChosenTuning | None = Field(
        description="what was in force before the last change, and is again once that is undone; null for nothing"
    )
    undone: bool = Field(default=False, description="the last change was an undo: to undo that is to do it again")
    recording_run: int | None = Field(description="run that the samples belong to at present")
    problems: list[str] = Field(description="what is wrong with the service without being a fault of the loop")
