"""State of the actuator: samples, timing, safety chain, tuning and faults."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, assert_never

from backend import __version__
from backend.control import Bounds, compute_bounds
from backend.faults import EXPLANATIONS, FAULTS, Fault, describe_fault
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
    HandoverView,
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
)
from backend.services import messages
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
# Reads the newest sample and the timing of the control loop from the ring buffer.


Sample = dict[str, float]

TIMING_PERIOD_S = 0.25
"""Period [s] at which the timing is computed anew."""


class Observation:
    """Reads the ring buffer of the current loop process, which ``ring`` returns."""

    def __init__(self, ring: Callable[[], Ring], clock: Callable[[], float] = time.monotonic) -> None:
        self._ring = ring
        self._clock = clock
        self._seen = (0, clock())
        self._timing: TimingView | None = None
        self._timing_due = 0.0

    def sample(self) -> Sample | None:
        """Return the newest sample; None before the first."""
        row = self._ring().newest()
        return None if row is None else dict(zip(NAMES, row.tolist(), strict=True))

    def link(self, alive: bool, starts: int, restart: Restart | None = None) -> LinkView:
        """Return whether the loop process is alive, and the age of its last sample.

        ``starts`` counts the loop processes; ``restart`` is a planned restart in progress.
        """
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
        """Return rate, lateness and overruns of the control steps.

        The values are at most TIMING_PERIOD_S old.
        """
        if self._timing is None or self._clock() >= self._timing_due:
            self._timing_due = self._clock() + TIMING_PERIOD_S
            t = compute_timing(self._ring())
            self._timing = TimingView(
                period_s=T_s,
                rate_Hz=_finite_or_zero(t.rate_Hz),
                lateness_p50_ms=_finite_or_zero(1e3 * t.lateness_p50_s),
                lateness_p99_ms=_finite_or_zero(1e3 * t.lateness_p99_s),
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
    """Return the active references.

    Without them the measured position and stiffness, from which a mode would start. S_ref is None while the tendons are
    slack, because the stiffness is then unknown.
    """
    if sample is None:
        return ReferencesView(q_ref=0.0, S_ref=None, in_force=False)
    q_ref, S_ref = sample["q_ref"], sample["S_ref"]
    return ReferencesView(
        q_ref=_finite_or_zero(sample["q"]) if math.isnan(q_ref) else q_ref,
        S_ref=_finite_or_none(sample["S"] if math.isnan(S_ref) else S_ref),
        in_force=not (math.isnan(q_ref) or math.isnan(S_ref)),
    )


def read_entry(sample: Sample | None) -> float:
    """Return the index of the active operating point; fractional if interpolated."""
    return 0.0 if sample is None else _finite_or_zero(sample["bank_entry"])


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _finite_or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0


# Safety chain --------------------------------------------------------------------------------------
# State of the five parts that can stop the actuator: page, service, control loop, watchdog and
# safety module. Each part monitors the one before it.


LOOP_SILENT_S = 1.0
"""Time [s] without a new sample after which the control loop counts as failed."""


def build_safety_chain(
    supervisor: Supervisor, holder: HolderView | None, link: LinkView, fault: Fault
) -> list[ChainLinkView]:
    """Return the five links of the safety chain in order.

    ``holder`` is None while no session has the control lease; ``fault`` is the latched fault of the newest sample.
    """
    alive = supervisor.is_alive
    heartbeat_age_s = supervisor.heartbeat_age_s
    is_ticking = alive and link.silent_s < LOOP_SILENT_S
    if supervisor.restarting is not None and not is_ticking:
        return [_build_page_link(holder), *_build_restarting_links(supervisor, link, fault)]
    return [
        _build_page_link(holder),
        ChainLinkView(
            name="service",
            good=heartbeat_age_s is not None and heartbeat_age_s < SILENCE_S,
            silent_s=heartbeat_age_s,
            says=messages.last_heartbeat() if heartbeat_age_s is not None else messages.no_heartbeats(),
        ),
        ChainLinkView(
            name="loop",
            good=is_ticking,
            silent_s=link.silent_s,
            says=messages.last_sample() if is_ticking else messages.no_new_samples(),
        ),
        *build_downstream_links(
            supervisor.setup.plant, supervisor.card.state(), supervisor.watchdog_monitor, alive, fault
        ),
    ]


def _build_restarting_links(supervisor: Supervisor, link: LinkView, fault: Fault) -> list[ChainLinkView]:
    """Return the links after the page during a planned restart of the loop.

    The restart is no fault, because the drives are off.
    """
    card, monitor = supervisor.card.state(), supervisor.watchdog_monitor
    downstream = build_downstream_links(supervisor.setup.plant, card, monitor, False, fault)
    is_intact = not (card.expired or card.safety_tripped or monitor.is_watchdog_lost or fault is Fault.SAFETY_MODULE)
    return [
        ChainLinkView(name="service", good=True, silent_s=None, says=messages.waiting_for_loop()),
        ChainLinkView(name="loop", good=True, silent_s=None, says=messages.loop_restarting(purpose=link.restarting)),
        *(one.model_copy(update={"good": one.good or is_intact}) for one in downstream),
    ]


def build_downstream_links(
    plant: PlantChoice, card: CardState, monitor: WatchdogMonitor, alive: bool, fault: Fault
) -> tuple[ChainLinkView, ChainLinkView]:
    """Return the links of watchdog and safety module.

    They act without the control loop. Their state is read from the registers of the card. The registers of a real card
    are known only while its loop runs. A recording needs neither, because nothing moves. Those of a hardware package
    cannot be read, so they are not reported as good.
    """
    tripped = fault is Fault.SAFETY_MODULE
    match plant.kind:
        case PlantKind.SIMULATOR | PlantKind.RIG | PlantKind.VIRTUAL_CARD:
            links = (
                _build_watchdog_link(card, monitor, alive),
                _build_safety_module_link(card.safety_tripped or tripped),
            )
            if plant.kind is PlantKind.RIG and not alive:
                return _mark_as_outdated(card, links[0]), _mark_as_outdated(card, links[1])
            return links
        case PlantKind.REPLAY:
            good, says = True, messages.not_needed_in_replay()
        case PlantKind.PACKAGE:
            good, says = False, messages.not_monitored(plant=plant.name)
        case _:
            assert_never(plant.kind)
    watchdog = ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)
    unknown = ChainLinkView(name="safety_module", good=good, silent_s=None, says=says)
    return watchdog, _build_safety_module_link(tripped) if tripped else unknown


def _build_page_link(holder: HolderView | None) -> ChainLinkView:
    if holder is None:
        return ChainLinkView(name="page", good=True, silent_s=None, says=messages.no_user_holds_control())
    if not holder.page:
        return ChainLinkView(
            name="page", good=True, silent_s=None, says=messages.script_holds_control(name=holder.name)
        )
    says = messages.page_lost(name=holder.name) if holder.lost else messages.page_holds_control(name=holder.name)
    return ChainLinkView(name="page", good=not holder.lost, silent_s=holder.silent_s, says=says)


def _build_watchdog_link(card: CardState, monitor: WatchdogMonitor, alive: bool) -> ChainLinkView:
    drives_enabled = card.drive_enabled
    if monitor.is_watchdog_lost:
        says = messages.watchdog_dead(silent_s=monitor.watchdog_silent_s, drives_enabled=drives_enabled)
    elif card.expired:
        says = messages.watchdog_expired(timeout_s=card.watchdog_s, drives_enabled=drives_enabled)
    elif card.armed:
        says = messages.watchdog_armed(drives_enabled=drives_enabled)
    else:
        says = messages.watchdog_disarmed(drives_enabled=drives_enabled)
    good = alive and card.armed and not card.expired and not monitor.is_watchdog_lost
    return ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)


def _build_safety_module_link(tripped: bool) -> ChainLinkView:
    says = messages.safety_module_tripped() if tripped else messages.safety_module_monitoring()
    return ChainLinkView(name="safety_module", good=not tripped, silent_s=None, says=says)


def _mark_as_outdated(card: CardState, link: ChainLinkView) -> ChainLinkView:
    says = messages.unknown_since_loop_ended(state=link.says) if card.mirror else messages.unknown_without_loop()
    return link.model_copy(update={"good": False, "says": says})


# Obstacle ------------------------------------------------------------------------------------------
# The simulated obstacle (page label: wall), for page and event log.


class WallBounds(NamedTuple):
    """Bounds of stiffness and damping of an obstacle.

    All are 0 on a plant without simulated obstacle.
    """

    k_min: float
    """Smallest stiffness [N/m]."""

    k_max: float
    """Largest stiffness [N/m]."""

    c_max: float
    """Largest damping [s/m]."""


NO_WALL_POSSIBLE = WallBounds(0.0, 0.0, 0.0)


def compute_wall_bounds(parameters: PlantParameters) -> WallBounds:
    """Return the bounds within which the steps of the simulation resolve an obstacle."""
    joint, step_s = parameters.make_dynamics().joint, T_s / SUBSTEPS
    return WallBounds(
        K_LEAST, largest_wall_stiffness(joint, step_s), largest_wall_damping(joint, parameters.safety.F_max, step_s)
    )


def build_wall_view(wall: Obstacle | None) -> WallView | None:
    """Return the obstacle as the page shows it."""
    if wall is None:
        return None
    side, q_wall, k_wall, c_wall = wall
    return WallView(q_wall=q_wall, side="above" if side > 0.0 else "below", k_wall=k_wall, c_wall=c_wall)


# Live state ----------------------------------------------------------------------------------------
# The current state of the actuator, from samples, events of the control loop and the active tuning.


UNDO_STEPS = 20
"""Number of tuning changes that can be undone."""

F_PUSH_MAX = 30.0
"""Largest push [N] that an operator may command on the simulator."""


class LiveState:
    """The current state of the actuator.

    Samples and events of the control loop update it. The services that change the tuning, run jobs or commission the
    rig set the public attributes.
    """

    def __init__(self, supervisor: Supervisor, parameters: PlantParameters, tuning: ActiveTuning) -> None:
        self.overridden_tuning: ActiveTuning | None = None
        """The operator's tuning while a run has replaced it by a temporary one."""

        self.tuning_problem = ""
        """Why a tuning that should have been restored is not active."""

        self.program_tunings: Sequence[ResolvedTuning] = ()
        """Tunings that the running experiment activates; the control loop reports their numbers, from 1."""

        self._tuning_number = 0
        self.undo_stack: deque[ResolvedTuning] = deque(maxlen=UNDO_STEPS)
        self.redo_stack: deque[ResolvedTuning] = deque(maxlen=UNDO_STEPS)
        self.task: TaskView | None = None
        """The job in progress."""

        self.starts = 1
        """Number of loop processes that this service has started."""

        self.occupied_by = ""
        """The commissioning step that has exclusive use of the rig; empty for none."""

        self.provoked_fault = Fault.NONE
        """Fault that the commissioning step provokes on purpose."""

        self.wall: Obstacle | None = None
        self._loop_not_ready_reason = ""
        self.set_parameters(parameters, tuning)
        self._supervisor = supervisor
        self._observation = Observation(lambda: supervisor.ring)
        self._pretension_done = False
        self._stop: Stopped | None = None
        self._plant_problem = ""

    def set_parameters(self, parameters: PlantParameters, tuning: ActiveTuning) -> None:
        """Set the active parameters and the tuning that belongs to them."""
        self.parameters, self.tuning = parameters, tuning
        self.bounds = compute_bounds(parameters)
        self._tensions = _compute_tension_table(parameters, self.bounds)
        self._wall_bounds = compute_wall_bounds(parameters)

    @property
    def plant(self) -> PlantChoice:
        """The plant that is controlled."""
        return self._supervisor.setup.plant

    @property
    def card_lost(self) -> bool:
        """Whether the card does not answer.

        Its open channels are lost then; a new loop process opens them again.
        """
        return bool(self._plant_problem) and self.plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD)

    @property
    def operator_tuning(self) -> ActiveTuning:
        """The operator's tuning, also while a run has replaced it by a temporary one."""
        return self.overridden_tuning or self.tuning

    @property
    def not_ready_reason(self) -> str:
        """What must be done before pretension can start; empty if nothing."""
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
        """Active references; without them the measured position and stiffness."""
        return self._references_view(self._observation.sample())

    def _references_view(self, sample: Sample | None) -> ReferencesView:
        references = read_references(sample)
        if self.plant.kind is PlantKind.REPLAY:  # recorded references command nothing
            return references.model_copy(update={"in_force": False})
        return references

    @property
    def entry(self) -> float:
        """Index of the active operating point of the bank, fractional if interpolated."""
        return read_entry(self._observation.sample())

    def list_legal_modes(self, mode: Mode) -> list[Mode]:
        """Return the modes that an operator may select in ``mode`` now."""
        if not self._supervisor.is_alive:
            return []
        if mode is Mode.OFF and self.not_ready_reason:
            return []
        if mode is Mode.PRETENSION and not self._pretension_done:
            return [Mode.STOPPING, Mode.OFF]
        paused = self.task is not None and self.task.paused
        return [one for one in LEGAL[mode] if not paused or one not in MOVING]

    def handle_event(self, event: Event | LoopExited) -> None:
        """Update the state with an event of the control loop."""
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
                self._stop = None  # the recording that STOP had paused continues
            case PlantFailing(_, reason):
                self._plant_problem = messages.plant_failing(reason=reason)
            case PlantAnswers():
                self._plant_problem = ""
            case ReadinessChanged(_, unready):
                self._loop_not_ready_reason = unready
            case Accepted() | Refused() | RunEnded() | PushReleased() | ContactDetected() | BiasLost() | PlayerMoved():
                pass
            case _:
                assert_never(event)

    def clear_stop(self) -> None:
        """Drop the stop proof and the problem of the plant after a reset."""
        self._stop = None
        self._plant_problem = ""

    def build_stop_proof(self, stopped: Stopped) -> StopProof:
        """Return the stop proof: ticks of arrival and of zero volts.

        A recording has only been paused.
        """
        return StopProof(
            arrived_tick=stopped.arrived_tick,
            zero_tick=stopped.zero_tick,
            milliseconds=stopped.milliseconds,
            paused_recording=self.plant.kind is PlantKind.REPLAY,
        )

    def health(self) -> Health:
        """Return the health of the service, which needs no sign-in."""
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
        """Return the state that pages show.

        ``parts`` supplies the views of other services. All values come from one sample, because the control loop writes
        newer ones meanwhile.
        """
        sample = self._observation.sample()
        mode = read_mode(sample)
        tick = 0 if sample is None else int(sample["tick"])
        holder = parts.holder()
        link = self._observation.link(self._supervisor.is_alive, self.starts, self._supervisor.restarting)
        return State(
            mode=mode,
            legal_modes=self.list_legal_modes(mode),
            plant=self._plant_view(),
            parameters=self.parameters.name,
            tick=tick,
            link=link,
            timing=self._observation.timing(),
            references=self._references_view(sample),
            tuning=self._tuning_view(read_entry(sample)),
            limits=self._limits(),
            touch=parts.contact(),
            fault=self._fault_view(sample),
            unready=self.not_ready_reason,
            pretension_done=self._pretension_done,
            stop_proof=None if self._stop is None else self.build_stop_proof(self._stop),
            holder=holder,
            people=parts.users(),
            wishes=parts.handovers(),
            chain=build_safety_chain(self._supervisor, holder, link, read_fault(sample)),
            task=self.task,
            trial=parts.trial(),
            trigger=parts.trigger(),
            own_tuning=None if self.overridden_tuning is None else build_chosen_tuning(self.overridden_tuning),
            wall=build_wall_view(self.wall),
            player=parts.player(tick),
            earlier=build_chosen_tuning(self.undo_stack[-1]) if self.undo_stack else None,
            later=build_chosen_tuning(self.redo_stack[-1]) if self.redo_stack else None,
            recording_run=None if sample is None or sample["run"] == 0 else int(sample["run"]),
            problems=[*parts.problems(), *filter(None, (self._plant_problem, self.tuning_problem))],
        )

    def reset_undo(self, earlier: ResolvedTuning | None) -> None:
        """Clear both undo stacks.

        ``earlier`` becomes the only tuning that undo returns to.
        """
        self.undo_stack.clear()
        self.redo_stack.clear()
        if earlier is not None:
            self.undo_stack.append(earlier)

    def _tuning_view(self, entry: float) -> TuningView:
        """Return the active tuning, which the running experiment may have activated."""
        number, tunings = self._tuning_number, self.program_tunings
        if not 0 < number <= len(tunings):
            return self.tuning.view(entry)
        return overlay_tuning(self.tuning.view(entry), tunings[number - 1], entry)

    def _plant_view(self) -> PlantView:
        plant = self.plant
        says, geometry = self._supervisor.plant_description, self.parameters.geometry
        return PlantView(
            kind=plant.kind, simulated=plant.simulated, name=plant.name, says=says, r_m=geometry.r_m, r_j=geometry.r_j
        )

    def _limits(self) -> LimitsView:
        bounds = self.bounds
        wall = self._wall_bounds if self.plant.simulated else NO_WALL_POSSIBLE
        return LimitsView(
            q_min=bounds.q_min,
            q_max=bounds.q_max,
            S_min=bounds.S_min,
            S_max=bounds.S_max,
            F_min=bounds.F_slack,
            F_max=bounds.F_max,
            F_push_max=F_PUSH_MAX if self.plant.simulated else 0.0,
            F_contact_min=CONTACT_MIN_N,
            F_contact_max=CONTACT_MAX_N,
            k_wall_min=wall.k_min,
            k_wall_max=wall.k_max,
            c_wall_max=wall.c_max,
            u_max=bounds.u_max,
            q_trip=bounds.q_trip,
            tensions=self._tensions,
        )

    def _fault_view(self, sample: Sample | None) -> FaultView | None:
        fault = read_fault(sample)
        if fault is Fault.NONE:
            return None
        detail, tick = "", 0 if sample is None else int(sample["tick"])
        if self._stop is not None and self._stop.fault is fault:
            detail, tick = self._stop.detail, self._stop.arrived_tick
        message, remedy, is_expected = (
            describe_fault(fault, detail),
            EXPLANATIONS[fault].remedy,
            self.is_expected(fault),
        )
        if is_expected:
            message, remedy = messages.trip_of_bring_up(fault=message), ""
        elif fault is Fault.SAFETY_MODULE and self.plant.simulated:
            remedy = messages.remedy_for_simulated_safety_module()
        return FaultView(code=fault, message=message, remedy=remedy, tick=tick, expected=is_expected)

    def is_expected(self, fault: Fault) -> bool:
        """Return whether a fault is no alarm.

        Commissioning provokes it, or it is part of a replayed recording.
        """
        return fault is not Fault.NONE and (fault is self.provoked_fault or self.plant.kind is PlantKind.REPLAY)


@dataclass(frozen=True)
class ServiceState:
    """The live state, and functions that return the views of other services."""

    live_state: LiveState
    contact: Callable[[], TouchView]
    trial: Callable[[], TrialView | None]
    trigger: Callable[[], TriggerView | None]
    player: Callable[[int], PlayerView | None]
    """Returns the position in a replayed recording at a tick."""

    holder: Callable[[], HolderView | None]
    users: Callable[[], list[PersonView]]
    handovers: Callable[[], list[HandoverView]]
    problems: Callable[[], list[str]]
    """Returns problems of the service that are no fault of the control loop."""

    def view(self) -> State:
        """Return the state that pages show."""
        return self.live_state.build_view(self)


def _compute_tension_table(parameters: PlantParameters, bounds: Bounds) -> list[TensionView]:
    """Return the stiffness at rest over the tension [N].

    S = r_j² (F'(x_A) + F'(x_B)), equation 14.
    """
    r_j = parameters.geometry.r_j
    springs = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    return [
        TensionView(F=F, S=r_j**2 * sum(spring_slope(spring, spring_elongation(spring, F)) for spring in springs))
        for F in (bounds.F_slack, 10.0, 20.0, 30.0, 40.0, min(bounds.F_max, *(spring.F_solid for spring in springs)))
    ]
