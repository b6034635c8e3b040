"""The state of the actuator: samples, timing, safety chain, walls."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, assert_never

from backend import __version__
from backend.control import Bounds, compute_bounds
from backend.faults import EXPLAINED, FAULTS, Fault, explained
from backend.realtime import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    LEGAL,
    MODES,
    MOVING,
    SILENCE_S,
    Accepted,
    BiasLost,
    ContactDetected,
    Event,
    LoopExited,
    Mode,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    PlayerMoved,
    PretensionReached,
    PushReleased,
    ReadinessChanged,
    Refused,
    Restart,
    Ring,
    RunEnded,
    Stopped,
    Supervisor,
    TuningChanged,
    WallChanged,
    WatchdogMonitor,
    compute_timing,
)
from backend.sample import NAMES
from backend.schemas import (
    ChainLinkView,
    FaultView,
    Health,
    HolderView,
    LimitsView,
    LinkView,
    PersonView,
    PlantView,
    PlayerView,
    ReferencesView,
    State,
    StopProof,
    TaskView,
    TensionView,
    TimingView,
    TouchView,
    TrialView,
    TriggerView,
    TuningView,
    WallView,
    WishView,
)
from backend.services.tuning_state import ActiveTuning, ResolvedTuning, build_chosen_tuning, overlay_tuning
from plant import (
    K_LEAST,
    SUBSTEPS,
    CardState,
    Obstacle,
    PlantChoice,
    PlantKind,
    PlantParameters,
    T_s,
    largest_wall_damping,
    largest_wall_stiffness,
    spring_elongation,
    spring_slope,
)

# Observation ---------------------------------------------------------------------------------------
#
# What the ring tells about the loop at present: the newest sample, the timing, whether it is alive.


Sample = dict[str, float]

TIMING_PERIOD_S = 0.25


class Observation:
    """Reads the ring of whichever loop process runs at present."""

    def __init__(self, ring: Callable[[], Ring], clock: Callable[[], float] = time.monotonic) -> None:
        self._ring = ring
        self._clock = clock
        self._seen = (0, clock())
        self._timing: TimingView | None = None
        self._timing_due = 0.0

    def sample(self) -> Sample | None:
        """Return the newest sample, None before the first."""
        row = self._ring().newest()
        return None if row is None else dict(zip(NAMES, row.tolist(), strict=True))

    def link(self, alive: bool, starts: int, restart: Restart | None = None) -> LinkView:
        """Return the state of the connection to the loop."""
        count, now = self._ring().count, self._clock()
        if count != self._seen[0]:
            self._seen = (count, now)
        return LinkView(
            alive=alive,
            silent_s=now - self._seen[1],
            starts=starts,
            restarting="" if restart is None else restart.purpose,
            restarting_s=None if restart is None else now - restart.began_s,
        )

    def timing(self) -> TimingView:
        """Return how well the loop keeps its period, renewed four times a second."""
        if self._timing is None or self._clock() >= self._timing_due:
            self._timing_due = self._clock() + TIMING_PERIOD_S
            t = compute_timing(self._ring())
            self._timing = TimingView(
                period_s=T_s,
                rate_Hz=_number(t.rate_Hz),
                lateness_p50_ms=_number(1e3 * t.lateness_p50_s),
                lateness_p99_ms=_number(1e3 * t.lateness_p99_s),
                overruns=t.overruns,
            )
        return self._timing


def read_mode(sample: Sample | None) -> Mode:
    """Return the mode in a sample; OFF before the first."""
    return Mode.OFF if sample is None else MODES[int(sample["mode"])]


def read_fault(sample: Sample | None) -> Fault:
    """Return the latched fault in a sample."""
    return Fault.NONE if sample is None else FAULTS[int(sample["fault"])]


def read_references(sample: Sample | None) -> ReferencesView:
    """Return the references in force; where none are, what the joint does, from where a mode would start.

    Slack tendons have no stiffness: S_ref is None then.
    """
    if sample is None:
        return ReferencesView(q_ref=0.0, S_ref=None, in_force=False)
    q_ref, S_ref = sample["q_ref"], sample["S_ref"]
    return ReferencesView(
        q_ref=_number(sample["q"]) if math.isnan(q_ref) else q_ref,
        S_ref=_known(sample["S"] if math.isnan(S_ref) else S_ref),
        in_force=not (math.isnan(q_ref) or math.isnan(S_ref)),
    )


def read_entry(sample: Sample | None) -> float:
    """Return the active entry of the bank, fractional while interpolating."""
    return 0.0 if sample is None else _number(sample["bank_entry"])


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0


# Safety chain --------------------------------------------------------------------------------------
#
# The safety chain as it stands: from the page that holds control to the safety module, each watched
# by the next.


LOOP_SILENT_S = 1.0
"""A loop without a new sample for so long [s] is not well."""


def chain(supervisor: Supervisor, holder: HolderView | None, link: LinkView, fault: Fault) -> list[ChainLinkView]:
    """Return the five links of the chain in order."""
    alive = supervisor.is_alive
    beat_s = supervisor.beat_age_s
    ticks = alive and link.silent_s < LOOP_SILENT_S
    if supervisor.restarting is not None and not ticks:
        return [_page(holder), *_restarting(supervisor, link, fault)]
    return [
        _page(holder),
        ChainLinkView(
            name="service",
            good=beat_s is not None and beat_s < SILENCE_S,
            silent_s=beat_s,
            says="beats" if beat_s is not None else "has no loop to beat for",
        ),
        ChainLinkView(name="loop", good=ticks, silent_s=link.silent_s, says="ticks" if ticks else "does not tick"),
        *build_downstream_links(
            supervisor.setup.plant, supervisor.card.state(), supervisor.watchdog_monitor, alive, fault
        ),
    ]


def _restarting(supervisor: Supervisor, link: LinkView, fault: Fault) -> list[ChainLinkView]:
    """Return the links behind the page while the loop process is replaced as planned, drives off: that is no fault."""
    card, guard = supervisor.card.state(), supervisor.watchdog_monitor
    behind = build_downstream_links(supervisor.setup.plant, card, guard, False, fault)
    sound = not (card.expired or card.safety_tripped or guard.is_watchdog_lost or fault is Fault.SAFETY_MODULE)
    return [
        ChainLinkView(name="service", good=True, silent_s=None, says="waits for the loop"),
        ChainLinkView(name="loop", good=True, silent_s=None, says=f"is restarted: {link.restarting}"),
        *(one.model_copy(update={"good": one.good or sound}) for one in behind),
    ]


def build_downstream_links(
    plant: PlantChoice, card: CardState, guard: WatchdogMonitor, alive: bool, fault: Fault
) -> tuple[ChainLinkView, ChainLinkView]:
    """Return watchdog and safety module: what is left when the loop is not.

    Only the registers of a card tell of them, and of a rig's card nothing is seen but through its loop. A recording
    has none and moves nothing; what a package has is not seen from here, so it is not called good.
    """
    tripped = fault is Fault.SAFETY_MODULE
    match plant.kind:
        case PlantKind.SIMULATOR | PlantKind.RIG | PlantKind.VIRTUAL_CARD:
            links = _watchdog(card, guard, alive), _safety_module(card.safety_tripped or tripped)
            if plant.kind is PlantKind.RIG and not alive:
                return _last_known(card, links[0]), _last_known(card, links[1])
            return links
        case PlantKind.REPLAY:
            good, says = True, "not needed: a recording is played, nothing moves"
        case PlantKind.PACKAGE:
            good, says = False, f"not seen from here: {plant.name} has to bring its own"
        case _:
            assert_never(plant.kind)
    watchdog = ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)
    unseen = ChainLinkView(name="safety_module", good=good, silent_s=None, says=says)
    return watchdog, _safety_module(tripped) if tripped else unseen


def _page(holder: HolderView | None) -> ChainLinkView:
    if holder is None:
        return ChainLinkView(name="page", good=True, silent_s=None, says="nobody holds control")
    if not holder.page:
        return ChainLinkView(name="page", good=True, silent_s=None, says=f"a script holds control ({holder.name})")
    says = f"{holder.name} is not heard: references are held" if holder.lost else f"{holder.name} is heard"
    return ChainLinkView(name="page", good=not holder.lost, silent_s=holder.silent_s, says=says)


def _watchdog(card: CardState, guard: WatchdogMonitor, alive: bool) -> ChainLinkView:
    line = "drive-enable on" if card.drive_enabled else "drive-enable off, zero volts"
    if guard.is_watchdog_lost:
        says = f"dead, not seen for {guard.watchdog_silent_s:.1f} s: {line}; reset starts a new one"
    elif card.expired:
        says = f"expired after {card.watchdog_s:g} s without a write: {line}"
    elif card.armed:
        says = f"armed, {line}"
    else:
        says = f"disarmed, {line}"
    good = alive and card.armed and not card.expired and not guard.is_watchdog_lost
    return ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)


def _safety_module(tripped: bool) -> ChainLinkView:
    says = "tripped: the motors are cut" if tripped else "watching"
    return ChainLinkView(name="safety_module", good=not tripped, silent_s=None, says=says)


def _last_known(card: CardState, link: ChainLinkView) -> ChainLinkView:
    says = f"not seen since the loop ended; last known: {link.says}" if card.mirror else "not seen: no loop has run yet"
    return link.model_copy(update={"good": False, "says": says})


# Standing wall -------------------------------------------------------------------------------------
#
# What stands in the joint's way, for page and journal.


class WallBounds(NamedTuple):
    """Least and largest stiffness [N/m] and largest damping [s/m] of a wall; all 0 where none can be put up."""

    k_min: float
    k_max: float
    c_max: float


NO_WALL_POSSIBLE = WallBounds(0.0, 0.0, 0.0)


def compute_wall_bounds(parameters: PlantParameters) -> WallBounds:
    """Return what the steps of the simulation resolve of a wall."""
    joint, step_s = parameters.make_dynamics().joint, T_s / SUBSTEPS
    return WallBounds(
        K_LEAST, largest_wall_stiffness(joint, step_s), largest_wall_damping(joint, parameters.safety.F_max, step_s)
    )


def describe_wall(wall: Obstacle | None) -> str:
    """Say what stands in the joint's way."""
    if wall is None:
        return "no wall"
    side = "above" if wall.side > 0.0 else "below"
    return f"wall {side} {wall.q_wall:.4g} rad, {wall.k_wall:.4g} N/m, {wall.c_wall:.4g} s/m"


def build_wall_view(wall: Obstacle | None) -> WallView | None:
    """Return a wall as the page shows it."""
    if wall is None:
        return None
    side, q_wall, k_wall, c_wall = wall
    return WallView(q_wall=q_wall, side="above" if side > 0.0 else "below", k_wall=k_wall, c_wall=c_wall)


# Present state -------------------------------------------------------------------------------------
#
# What the actuator does at present, put together from samples, events and the tuning in force.


UNDO_STEPS = 20
"""How many changes of the tuning can be taken back."""

F_PUSH_MAX = 30.0
"""Largest push [N] that an operator may ask the simulator for."""


class LiveState:
    """What the actuator does at present.

    Whoever changes them sets ``tuning``, ``task``, ``occupied`` and ``provoked_trip``; the rest is seen and heard.
    ``own_tuning`` is what the operator had chosen while a run has the tuning, else None; ``tuning_problem`` says why a
    tuning that should be back in force is not; ``earlier`` is what the operator had before the last change.
    ``on_the_way`` are the tunings that the experiment under way puts into use, in the order of their numbers.
    ``occupied`` says what has the rig for itself, empty for nothing, ``provoked_trip`` the fault that it provokes,
    ``wall`` is what is in a simulated joint's way.
    """

    def __init__(self, supervisor: Supervisor, parameters: PlantParameters, tuning: ActiveTuning) -> None:
        self.own_tuning: ActiveTuning | None = None
        self.tuning_problem = ""
        self.program_tunings: Sequence[ResolvedTuning] = ()
        self._tuning_number = 0
        self.undo_stack: deque[ResolvedTuning] = deque(maxlen=UNDO_STEPS)
        self.redo_stack: deque[ResolvedTuning] = deque(maxlen=UNDO_STEPS)
        self.task: TaskView | None = None
        self.starts = 1
        self.occupied_by = ""
        self.provoked_fault = Fault.NONE
        self.wall: Obstacle | None = None
        self._loop_not_ready_reason = ""
        self.set_parameters(parameters, tuning)
        self._supervisor = supervisor
        self._observation = Observation(lambda: supervisor.ring)
        self._pretension_done = False
        self._stop: Stopped | None = None
        self._plant_problem = ""

    def set_parameters(self, parameters: PlantParameters, tuning: ActiveTuning) -> None:
        """Take over the parameters in force, and the tuning that goes with them."""
        self.parameters, self.tuning = parameters, tuning
        self.bounds = compute_bounds(parameters)
        self._tensions = _tensions(parameters, self.bounds)
        self._wall_bounds = compute_wall_bounds(parameters)

    @property
    def plant(self) -> PlantChoice:
        """What is controlled."""
        return self._supervisor.setup.plant

    @property
    def card_lost(self) -> bool:
        """Whether a card does not answer: what was opened there is gone for good, and a new loop opens it anew."""
        return bool(self._plant_problem) and self.plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD)

    @property
    def operator_tuning(self) -> ActiveTuning:
        """What the operator has chosen, also while a run has another in force."""
        return self.own_tuning or self.tuning

    @property
    def not_ready_reason(self) -> str:
        """What has to come before pretension; empty where nothing has."""
        return self.occupied_by or self._loop_not_ready_reason

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample."""
        return read_mode(self._observation.sample())

    @property
    def fault(self) -> Fault:
        """Fault latched in the newest sample."""
        return read_fault(self._observation.sample())

    @property
    def tick(self) -> int:
        """Index of the newest sample."""
        sample = self._observation.sample()
        return 0 if sample is None else int(sample["tick"])

    @property
    def references(self) -> ReferencesView:
        """References in use; where none are, what the joint does."""
        return self._references_view(self._observation.sample())

    def _references_view(self, sample: Sample | None) -> ReferencesView:
        references = read_references(sample)
        if self.plant.kind is PlantKind.REPLAY:  # what was asked for then is asked of nothing now
            return references.model_copy(update={"in_force": False})
        return references

    @property
    def entry(self) -> float:
        """Active entry of the bank, fractional while interpolating."""
        return read_entry(self._observation.sample())

    def legal(self, mode: Mode) -> list[Mode]:
        """Return where an operator may go from ``mode`` now."""
        if not self._supervisor.is_alive:
            return []
        if mode is Mode.OFF and self.not_ready_reason:
            return []
        if mode is Mode.PRETENSION and not self._pretension_done:
            return [Mode.STOPPING, Mode.OFF]
        paused = self.task is not None and self.task.paused
        return [one for one in LEGAL[mode] if not paused or one not in MOVING]

    def handle_event(self, event: Event | LoopExited) -> None:
        """Take in what the loop tells."""
        match event:
            case ModeChanged():
                self._pretension_done = False
            case TuningChanged(_, number):
                self._tuning_number = number
            case WallChanged(_, _, wall):
                self.wall = wall
            case LoopExited():
                self.wall = None
                self._pretension_done = False
                self._tuning_number = 0
                self._plant_problem = ""
                self._loop_not_ready_reason = ""
            case PretensionReached():
                self._pretension_done = True
            case Stopped():
                self._stop = event
            case PlayerMoved(playing=True):
                self._stop = None  # what it had paused goes on
            case PlantFailing(_, reason):
                self._plant_problem = f"the plant cannot be read or written: {reason}"
            case PlantAnswers():
                self._plant_problem = ""
            case ReadinessChanged(_, unready):
                self._loop_not_ready_reason = unready
            case Accepted() | Refused() | RunEnded() | PushReleased() | ContactDetected() | BiasLost() | PlayerMoved():
                pass
            case _:
                assert_never(event)

    def clear_stop(self) -> None:
        """Drop the proof of a stop that has been reset, and the trouble that a reset is refused for."""
        self._stop = None
        self._plant_problem = ""

    def build_stop_proof(self, stopped: Stopped) -> StopProof:
        """Return the proof of a stop; what is played was not driven, so that a stop has paused it only."""
        return StopProof(
            arrived_tick=stopped.arrived_tick,
            zero_tick=stopped.zero_tick,
            milliseconds=stopped.milliseconds,
            paused_recording=self.plant.kind is PlantKind.REPLAY,
        )

    def health(self) -> Health:
        """Return what anybody may know."""
        timing = self._observation.timing()
        alive = self._supervisor.is_alive
        return Health(
            alive=alive,
            mode=self.mode if alive else None,
            rate_Hz=timing.rate_Hz,
            overruns=timing.overruns,
            version=__version__,
        )

    def build_view(self, parts: "ServiceState") -> State:
        """Return what the status line and the controls show; ``parts`` has the views of the other parts.

        All values of a sample come from one sample, as the loop writes newer ones meanwhile.
        """
        sample = self._observation.sample()
        mode = read_mode(sample)
        tick = 0 if sample is None else int(sample["tick"])
        holder = parts.holder()
        link = self._observation.link(self._supervisor.is_alive, self.starts, self._supervisor.restarting)
        return State(
            mode=mode,
            legal_modes=self.legal(mode),
            plant=self._plant_view(),
            parameters=self.parameters.name,
            tick=tick,
            link=link,
            timing=self._observation.timing(),
            references=self._references_view(sample),
            tuning=self._tuning_view(read_entry(sample)),
            limits=self._limits(),
            touch=parts.touch(),
            fault=self._fault_view(sample),
            unready=self.not_ready_reason,
            pretension_done=self._pretension_done,
            stop_proof=None if self._stop is None else self.build_stop_proof(self._stop),
            holder=holder,
            people=parts.people(),
            wishes=parts.wishes(),
            chain=chain(self._supervisor, holder, link, read_fault(sample)),
            task=self.task,
            trial=parts.trial(),
            trigger=parts.trigger(),
            own_tuning=None if self.own_tuning is None else build_chosen_tuning(self.own_tuning),
            wall=build_wall_view(self.wall),
            player=parts.player(tick),
            earlier=build_chosen_tuning(self.undo_stack[-1]) if self.undo_stack else None,
            later=build_chosen_tuning(self.redo_stack[-1]) if self.redo_stack else None,
            recording_run=None if sample is None or sample["run"] == 0 else int(sample["run"]),
            problems=[*parts.problems(), *filter(None, (self._plant_problem, self.tuning_problem))],
        )

    def begin_steps(self, earlier: ResolvedTuning | None) -> None:
        """Let one step lead back to ``earlier``, none where that is None, and none forward."""
        self.undo_stack.clear()
        self.redo_stack.clear()
        if earlier is not None:
            self.undo_stack.append(earlier)

    def _tuning_view(self, entry: float) -> TuningView:
        """Return the tuning in force: while an experiment has put one into use on its way, that one."""
        number, changed = self._tuning_number, self.program_tunings
        if not 0 < number <= len(changed):
            return self.tuning.view(entry)
        return overlay_tuning(self.tuning.view(entry), changed[number - 1], entry)

    def _plant_view(self) -> PlantView:
        plant = self.plant
        says, geometry = self._supervisor.plant_description, self.parameters.geometry
        return PlantView(
            kind=plant.kind, simulated=plant.simulated, name=plant.name, says=says, r_m=geometry.r_m, r_j=geometry.r_j
        )

    def _limits(self) -> LimitsView:
        b = self.bounds
        wall = self._wall_bounds if self.plant.simulated else NO_WALL_POSSIBLE
        return LimitsView(
            q_min=b.q_min,
            q_max=b.q_max,
            S_min=b.S_min,
            S_max=b.S_max,
            F_min=b.F_slack,
            F_max=b.F_max,
            F_push_max=F_PUSH_MAX if self.plant.simulated else 0.0,
            F_contact_min=CONTACT_MIN_N,
            F_contact_max=CONTACT_MAX_N,
            k_wall_min=wall.k_min,
            k_wall_max=wall.k_max,
            c_wall_max=wall.c_max,
            u_max=b.u_max,
            q_trip=b.q_trip,
            tensions=self._tensions,
        )

    def _fault_view(self, sample: Sample | None) -> FaultView | None:
        fault = read_fault(sample)
        if fault is Fault.NONE:
            return None
        seen, tick = "", 0 if sample is None else int(sample["tick"])
        if self._stop is not None and self._stop.fault is fault:
            seen, tick = self._stop.detail, self._stop.arrived_tick
        message, remedy, expected = explained(fault, seen), EXPLAINED[fault].remedy, self.is_expected(fault)
        if expected:
            message, remedy = f"The bring-up provoked this trip: {message}", ""
        elif fault is Fault.SAFETY_MODULE and self.plant.simulated:
            remedy = (
                "Take away the wall or the push that caused it, then reset: that acknowledges the simulated module."
            )
        return FaultView(code=fault, message=message, remedy=remedy, tick=tick, expected=expected)

    def is_expected(self, fault: Fault) -> bool:
        """Tell whether a stop with this fault is no alarm: provoked by the bring-up, or the pause of a recording."""
        return fault is not Fault.NONE and (fault is self.provoked_fault or self.plant.kind is PlantKind.REPLAY)


@dataclass(frozen=True)
class ServiceState:
    """The state of the service: what the actuator does at ``present``, and what the other parts show.

    ``player`` tells where a recording stands in a tick, ``problems`` what is wrong with the service without being a
    fault of the loop.
    """

    live_state: LiveState
    touch: Callable[[], TouchView]
    trial: Callable[[], TrialView | None]
    trigger: Callable[[], TriggerView | None]
    player: Callable[[int], PlayerView | None]
    holder: Callable[[], HolderView | None]
    people: Callable[[], list[PersonView]]
    wishes: Callable[[], list[WishView]]
    problems: Callable[[], list[str]]

    def view(self) -> State:
        """Return everything the status line and the controls show."""
        return self.live_state.build_view(self)


def _tensions(parameters: PlantParameters, bounds: Bounds) -> list[TensionView]:
    """Stiffness at rest for tensions from slack to the trip: S = r_j² (F'(x_A) + F'(x_B)), equation 14."""
    r_j = parameters.geometry.r_j
    springs = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    return [
        TensionView(F=F, S=r_j**2 * sum(spring_slope(spring, spring_elongation(spring, F)) for spring in springs))
        for F in (bounds.F_slack, 10.0, 20.0, 30.0, 40.0, min(bounds.F_max, *(spring.F_solid for spring in springs)))
    ]
