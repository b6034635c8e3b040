"""What the actuator does at present, put together from samples, events and the tuning in force."""

from collections.abc import Callable, Sequence
from typing import assert_never

from backend import __version__
from backend.control.decoupler import Bounds, bounds_for
from backend.faults import EXPLAINED, Fault, explained
from backend.operating.observation import Observation, Sample, entry_of, fault_of, mode_of, references_of
from backend.operating.safety_chain import chain
from backend.operating.standing_wall import NO_WALL_POSSIBLE, wall_bounds, wall_view
from backend.operating.tuning_in_use import Chosen, TuningInUse, chosen_view, shown_with
from backend.realtime.commands import (
    Accepted,
    Event,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    PlayerMoved,
    PretensionReached,
    PushReleased,
    ReadinessChanged,
    Refused,
    RunEnded,
    Stopped,
    TuningChanged,
    WallChanged,
)
from backend.realtime.program import CONTACT_MAX_N, CONTACT_MIN_N, LEGAL, MOVING, ContactFelt, Mode, TouchForgotten
from backend.realtime.supervisor import LoopDied, Supervisor
from backend.schemas.run import PlayerView
from backend.schemas.state import (
    FaultView,
    Health,
    HolderView,
    LimitsView,
    PersonView,
    PlantView,
    ReferencesView,
    State,
    StopProof,
    TaskView,
    TensionView,
    TouchView,
    TrialView,
    TriggerView,
    WishView,
)
from backend.schemas.tuning import TuningView
from plant.dynamics import Obstacle, elongation, slope
from plant.interface import PlantChoice, PlantKind
from plant.parameters import PlantParameters

F_PUSH_MAX = 30.0
"""Largest push [N] that an operator may ask the simulator for."""


class PresentState:
    """The present state.

    Whoever changes them sets ``tuning``, ``task``, ``trial``, ``trigger``, ``touch``, ``holder``, ``people`` and
    ``wishes``; the rest is seen and heard. ``own_tuning`` is what the operator had chosen while a run has the tuning,
    else None; ``tuning_problem`` says why a tuning that should be back in force is not; ``earlier`` is what the
    operator had before the last change.
    ``on_the_way`` are the tunings that the experiment under way puts into use, in the order of their numbers.
    ``occupied`` says what has the rig for itself, ``provoked_trip`` the fault that it provokes, ``wall`` is what is in
    a simulated joint's way, ``player`` where a recording stands in a tick. ``problems`` tells what is wrong with the
    service without being a fault of the loop.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        parameters: PlantParameters,
        tuning: TuningInUse,
        problems: Callable[[], list[str]],
    ) -> None:
        self.own_tuning: TuningInUse | None = None
        self.tuning_problem = ""
        self.on_the_way: Sequence[Chosen] = ()
        self._tuning_number = 0
        self.earlier: Chosen | None = None
        self.undone = False
        self.task: TaskView | None = None
        self.trial: Callable[[], TrialView | None] = lambda: None
        self.trigger: Callable[[], TriggerView | None] = lambda: None
        self.holder: Callable[[], HolderView | None] = lambda: None
        self.touch: Callable[[], TouchView] = lambda: TouchView(contact_N=0.0, learned=[], felt=None)
        self.people: Callable[[], list[PersonView]] = list
        self.wishes: Callable[[], list[WishView]] = list
        self.starts = 1
        self.occupied: Callable[[], str] = str
        self.provoked_trip: Callable[[], Fault] = lambda: Fault.NONE
        self.wall: Obstacle | None = None
        self.player: Callable[[int], PlayerView | None] = lambda _tick: None
        self._unready = ""
        self.use(parameters, tuning)
        self._supervisor = supervisor
        self._problems = problems
        self._observation = Observation(lambda: supervisor.ring)
        self._pretension_done = False
        self._stop: Stopped | None = None
        self._plant_problem = ""

    def use(self, parameters: PlantParameters, tuning: TuningInUse) -> None:
        """Take over the parameters in force, and the tuning that goes with them."""
        self.parameters, self.tuning = parameters, tuning
        self.bounds = bounds_for(parameters)
        self._tensions = _tensions(parameters, self.bounds)
        self._wall_bounds = wall_bounds(parameters)

    @property
    def plant(self) -> PlantChoice:
        """What is controlled."""
        return self._supervisor.setup.plant

    @property
    def card_lost(self) -> bool:
        """Whether a card does not answer: what was opened there is gone for good, and a new loop opens it anew."""
        return bool(self._plant_problem) and self.plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD)

    @property
    def operators_tuning(self) -> TuningInUse:
        """What the operator has chosen, also while a run has another in force."""
        return self.own_tuning or self.tuning

    @property
    def unready(self) -> str:
        """What has to come before pretension; empty where nothing has."""
        return self.occupied() or self._unready

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample."""
        return mode_of(self._observation.sample())

    @property
    def fault(self) -> Fault:
        """Fault latched in the newest sample."""
        return fault_of(self._observation.sample())

    @property
    def tick(self) -> int:
        """Index of the newest sample."""
        sample = self._observation.sample()
        return 0 if sample is None else int(sample["tick"])

    @property
    def references(self) -> ReferencesView:
        """References in use; where none are, what the joint does."""
        references = references_of(self._observation.sample())
        if self.plant.kind is PlantKind.REPLAY:  # what was asked for then is asked of nothing now
            return references.model_copy(update={"in_force": False})
        return references

    @property
    def entry(self) -> float:
        """Active entry of the bank, fractional while interpolating."""
        return entry_of(self._observation.sample())

    def legal(self, mode: Mode) -> list[Mode]:
        """Return where an operator may go from ``mode`` now."""
        if not self._supervisor.alive:
            return []
        if mode is Mode.OFF and self.unready:
            return []
        if mode is Mode.PRETENSION and not self._pretension_done:
            return [Mode.STOPPING, Mode.OFF]
        paused = self.task is not None and self.task.paused
        return [one for one in LEGAL[mode] if not paused or one not in MOVING]

    def hear(self, event: Event | LoopDied) -> None:
        """Take in what the loop tells."""
        match event:
            case ModeChanged():
                self._pretension_done = False
            case TuningChanged(_, number):
                self._tuning_number = number
            case WallChanged(_, _, wall):
                self.wall = wall
            case LoopDied():
                self.wall = None
                self._pretension_done = False
                self._tuning_number = 0
                self._plant_problem = ""
                self._unready = ""
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
                self._unready = unready
            case (
                Accepted() | Refused() | RunEnded() | PushReleased() | ContactFelt() | TouchForgotten() | PlayerMoved()
            ):
                pass
            case _:
                assert_never(event)

    def forget_stop(self) -> None:
        """Drop the proof of a stop that has been reset, and the trouble that a reset is refused for."""
        self._stop = None
        self._plant_problem = ""

    def proof_of(self, stopped: Stopped) -> StopProof:
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
        alive = self._supervisor.alive
        return Health(
            alive=alive,
            mode=self.mode if alive else None,
            rate_Hz=timing.rate_Hz,
            overruns=timing.overruns,
            version=__version__,
        )

    def state(self) -> State:
        """Return everything the status line and the controls show."""
        sample = self._observation.sample()
        mode = mode_of(sample)
        holder = self.holder()
        link = self._observation.link(self._supervisor.alive, self.starts, self._supervisor.restarting)
        return State(
            mode=mode,
            legal_modes=self.legal(mode),
            plant=self._plant_view(),
            parameters=self.parameters.name,
            tick=self.tick,
            link=link,
            timing=self._observation.timing(),
            references=self.references,
            tuning=self._tuning_view(entry_of(sample)),
            limits=self._limits(),
            touch=self.touch(),
            fault=self._fault_view(sample),
            unready=self.unready,
            pretension_done=self._pretension_done,
            stop_proof=None if self._stop is None else self.proof_of(self._stop),
            holder=holder,
            people=self.people(),
            wishes=self.wishes(),
            chain=chain(self._supervisor, holder, link, fault_of(sample)),
            task=self.task,
            trial=self.trial(),
            trigger=self.trigger(),
            own_tuning=None if self.own_tuning is None else chosen_view(self.own_tuning),
            wall=wall_view(self.wall),
            player=self.player(self.tick),
            earlier=None if self.earlier is None else chosen_view(self.earlier),
            undone=self.undone,
            recording_run=None if sample is None or sample["run"] == 0 else int(sample["run"]),
            problems=[*self._problems(), *filter(None, (self._plant_problem, self.tuning_problem))],
        )

    def _tuning_view(self, entry: float) -> TuningView:
        """Return the tuning in force: while an experiment has put one into use on its way, that one."""
        number, changed = self._tuning_number, self.on_the_way
        if not 0 < number <= len(changed):
            return self.tuning.view(entry)
        return shown_with(self.tuning.view(entry), changed[number - 1], entry)

    def _plant_view(self) -> PlantView:
        plant = self.plant
        says, geometry = self._supervisor.driven, self.parameters.geometry
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
        fault = fault_of(sample)
        if fault is Fault.NONE:
            return None
        seen, tick = "", self.tick
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
        return fault is not Fault.NONE and (fault is self.provoked_trip() or self.plant.kind is PlantKind.REPLAY)


def _tensions(parameters: PlantParameters, bounds: Bounds) -> list[TensionView]:
    """Stiffness at rest for tensions from slack to the trip: S = r_j² (F'(x_A) + F'(x_B)), equation 14."""
    r_j = parameters.geometry.r_j
    springs = parameters.identified_spring("A"), parameters.identified_spring("B")
    return [
        TensionView(F=F, S=r_j**2 * sum(slope(spring, elongation(spring, F)) for spring in springs))
        for F in (bounds.F_slack, 10.0, 20.0, 30.0, 40.0, min(bounds.F_max, *(spring.F_solid for spring in springs)))
    ]
