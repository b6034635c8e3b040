"""Jobs: identifications and experiments that run in this service, one at a time."""

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from backend.analysis import Evaluation
from backend.auth import User
from backend.banks import TuningSettings
from backend.errors import InvalidValueError, OutOfRangeError, RequestRejectedError
from backend.execution import (
    SLICE_S,
    ExperimentRig,
    NotReadyError,
    ProgressCallback,
    RunPhase,
    RunRequest,
    compile_program,
    create_run,
    current_mode,
    evaluate_closed_run,
    execute_run,
    list_plan_banks,
    list_plan_tunings,
    make_bank_loader,
    require_ready,
)
from backend.experiments import (
    IDENTIFICATIONS,
    KIND,
    ActuatorIdentificationPlan,
    Expectation,
    Expected,
    ExperimentDefinition,
    ExperimentPlan,
    IdentificationPlan,
    LoopSettings,
    MotorIdentificationPlan,
    Plan,
    PredictedRun,
    SpringIdentificationPlan,
    Stage,
    Start,
    experiments_by_name,
    forecast_duration,
    forecast_identifications,
    list_setting_values,
    predict_excitation,
    predict_motor,
    predict_spring,
    read_start,
)
from backend.faults import Fault
from backend.models import Setting, SettingError, build_plan, describe_settings
from backend.plain_text import escape_line
from backend.realtime import NO_WALL, CommandRejectedError, LoopClient, Mode, require_plant_ability
from backend.schemas import (
    ActuatorRequest,
    CheckedExperiment,
    DryRunView,
    ExperimentCheckRequest,
    ExperimentKind,
    ExperimentRequest,
    IdentificationKind,
    IdentificationRequest,
    MotorRequest,
    OwnExperiment,
    PartView,
    PathPoint,
    Prediction,
    SpringRequest,
    TaskView,
    TuningView,
)
from backend.services.actuator import ActuatorService, SafeStop
from backend.services.background_work import Compute, IsDisconnected, TextWork
from backend.services.banks import StoredBanks
from backend.services.library import ExperimentCheck, OwnExperiments, build_own_experiment
from backend.services.queue import DryRuns, ExperimentQueue
from backend.services.state import LiveState
from backend.services.tuning_state import ResolvedTuning
from backend.storage import Bank, Database, EndState, Run
from backend.supervision import Supervision
from plant import ErrorCode, PlantKind, PlantParameters, T_s

# Identification orders -----------------------------------------------------------------------------
#
# From what is asked for to plans of identification, and what these would do to the rig.


def build_plans(request: IdentificationRequest) -> tuple[IdentificationPlan, ...]:
    """Return the plans that are asked for, several where tensions are listed. Raises SettingError, OutOfRangeError."""
    match request:
        case MotorRequest():
            return (_motor_plan(request),)
        case SpringRequest():
            return (_spring_plan(request),)
        case ActuatorRequest():
            return _actuator_plans(request)


def predict_runs(
    request: IdentificationRequest, parameters: PlantParameters, lam_motor: float, start: Start
) -> Prediction:
    """Tell what a run would do from ``start``; of several runs, the whole way and the largest figures."""
    plans = build_plans(request)
    told = forecast_identifications(plans, parameters, start, lam_motor)
    worth = _assess(request, plans, parameters, lam_motor)
    try:
        told.require_within_range(parameters)
        problem = worth.problem
        within_range = True
    except OutOfRangeError as error:
        problem, within_range = str(error), False
    return Prediction(
        duration_s=told.duration_s,
        q_start=told.q_start,
        q_low=told.q_low,
        q_high=told.q_high,
        F_low=told.F_low,
        F_high=told.F_high,
        path=[PathPoint(q=q, S=S) for q, S in zip(told.q_path.tolist(), told.S_path.tolist(), strict=True)],
        within_range=within_range,
        figures=worth.figures,
        q_counts=worth.q_counts,
        u_peak_V=worth.u_peak_V,
        F_min_N=worth.F_min_N,
        enough_motion=not problem,
        message=problem or f"{told.message}; {worth.message}",
    )


@dataclass(frozen=True)
class _Assessment:
    """What the run is for: its figures, what it shows, and what ``problem`` makes it not worth starting."""

    figures: list[Expectation]
    message: str
    problem: str
    q_counts: float | None = None
    u_peak_V: float | None = None
    F_min_N: float | None = None


def _assess(
    request: IdentificationRequest,
    plans: tuple[IdentificationPlan, ...],
    parameters: PlantParameters,
    lam_motor: float,
) -> _Assessment:
    match request:
        case MotorRequest():
            run = predict_motor(_motor_plan(request), parameters)
            return _Assessment(
                _list_expectations(run), run.message, "" if run.is_feasible else run.message, u_peak_V=request.u_high
            )
        case SpringRequest():
            run = predict_spring(_spring_plan(request), parameters)
            return _Assessment(_list_expectations(run), run.message, "" if run.is_feasible else run.message)
        case ActuatorRequest():
            excited = [plan for plan in plans if isinstance(plan, ActuatorIdentificationPlan)]
            return _assess_actuator(excited, parameters, lam_motor)


def _motor_plan(request: MotorRequest) -> MotorIdentificationPlan:
    return build_plan(MotorIdentificationPlan, request.model_dump(exclude={"kind"}))


def _spring_plan(request: SpringRequest) -> SpringIdentificationPlan:
    return build_plan(SpringIdentificationPlan, request.model_dump(exclude={"kind"}))


def _actuator_plans(request: ActuatorRequest) -> tuple[ActuatorIdentificationPlan, ...]:
    values = request.model_dump(exclude={"kind", "tensions_N", "tension_N"})
    if request.tensions_N is None:
        return (build_plan(ActuatorIdentificationPlan, {**values, "tension_N": request.tension_N}),)
    return tuple(_plan_at_tension(values, place, tension) for place, tension in enumerate(request.tensions_N))


def _plan_at_tension(values: dict[str, Any], place: int, tension_N: float) -> ActuatorIdentificationPlan:
    try:
        return build_plan(ActuatorIdentificationPlan, {**values, "tension_N": tension_N})
    except OutOfRangeError as error:
        if error.quantity != "tension_N":
            raise
        raise OutOfRangeError(
            quantity=error.quantity,
            value=error.value,
            minimum=error.minimum,
            maximum=error.maximum,
            unit=error.unit,
            remedy=error.remedy,
            words=f"tension {place + 1}",
            path=("tensions_N", place),
        ) from None


def _assess_actuator(
    plans: list[ActuatorIdentificationPlan], parameters: PlantParameters, lam_motor: float
) -> _Assessment:
    predicted = [predict_excitation(plan, parameters, lam_motor) for plan in plans]
    # A run that fails for voltage or slack names that; among good ones the least motion counts.
    worst = min(predicted, key=lambda item: (item.is_feasible, item.q_counts))
    u_peak, F_min = max(item.u_peak_V for item in predicted), min(item.F_min_N for item in predicted)
    counts = "By the excitation alone, peak to peak"
    return _Assessment(
        figures=[
            Expectation(name="q_counts", label=counts, value=worst.q_counts, unit="encoder counts"),
            Expectation(
                name="u_peak_V", label=f"Peak voltage, of {parameters.motor.u_max:g} V", value=u_peak, unit="V"
            ),
        ],
        message=worst.message,
        problem=worst.problem,
        q_counts=worst.q_counts,
        u_peak_V=u_peak,
        F_min_N=F_min,
    )


def _list_expectations(run: PredictedRun) -> list[Expectation]:
    return list(run.figures)


# Pause ---------------------------------------------------------------------------------------------
#
# A pause between two runs of one order: the actuator stands in pretension until the next one is let
# begin.


_REASONS_MOTORS_OFF = {
    Mode.OFF: "the motors were switched off",
    Mode.STOPPING: "it was stopped softly",
    Mode.TRIPPED: "a fault or STOP took the motors",
}


class Pause:
    """Between runs is the only safe point: within one the loop plays a program whole, and its record is of one piece.

    ``wanted`` is what was last asked for of the order under way; ``following`` are its runs that have still to begin.
    """

    def __init__(self, live_state: LiveState, on_change: Callable[[], None]) -> None:
        self.is_requested = False
        self.remaining_runs = 0
        self._live_state = live_state
        self._on_change = on_change

    def begin(self, following: int) -> None:
        """Take note of an order whose first run begins; with none ``following``, that no further one will."""
        self.is_requested, self.remaining_runs = False, following

    def request(self, wanted: bool) -> None:
        """Let the next run of the order wait, or begin. Raises RequestRejectedError where none follows."""
        task = self._live_state.task
        if task is None or self.remaining_runs == 0:
            what = "nothing is under way" if task is None else "no run of the same order follows"
            remedy = "several tensions in turn can be paused between two of them"
            raise RequestRejectedError(ErrorCode.NOT_NOW, f"{what}: {remedy}")
        self.is_requested = wanted
        self._live_state.task = task.model_copy(update={"pause_wanted": wanted})
        self._on_change()

    async def wait_until_resumed(self, loop: LoopClient, show: Callable[[], None]) -> None:
        """Wait as long as a pause is wanted; then the next run begins, and one less follows.

        ``show`` tells meanwhile that the order waits. Raises NotReadyError once the motors were let go,
        LoopExitedError.
        """
        while self.is_requested:
            show()
            await loop.advance(SLICE_S)
            await asyncio.sleep(0)  # a loop that is computed takes no time: others have their turn
            if (why := _REASONS_MOTORS_OFF.get(mode := current_mode(loop))) is not None:
                raise NotReadyError(f"{why} in its pause", mode)
        self.remaining_runs -= (
            1  # at once: a pause behind the last run is not to be asked for while that one is prepared
        )


def describe_runs_not_started(run: int, why: Exception, count: int) -> str:
    """Say why an order ended after a run, and that ``count`` runs of it were not begun."""
    runs, them = ("1 run was", "it") if count == 1 else (f"{count} runs were", "them")
    return f"The order ended after run {run}: {str(why).rstrip('.')}; {runs} not begun. Order {them} anew."


# Results under way ---------------------------------------------------------------------------------
#
# Results of the runs of one order, computed while the next one plays.


class PendingEvaluations:
    """Belongs to the service's event loop. ``problem`` says why ``without``, a complete run, has no result."""

    def __init__(self) -> None:
        self._under_way: dict[int, tuple[EndState, asyncio.Task[Evaluation]]] = {}
        self.run_without_result: int | None = None
        self.problem = ""

    def __contains__(self, run_id: int) -> bool:
        return run_id in self._under_way

    def add(self, run_id: int, end_state: EndState, work: asyncio.Task[Evaluation]) -> None:
        """Take over the work on the result of a run that ended so."""
        self._under_way[run_id] = end_state, work

    def forget(self) -> None:
        """Say no more of a run without a result: another one began, or it has one after all."""
        self.run_without_result, self.problem = None, ""

    async def wait_for_results(self) -> bool:
        """Wait for the results under way; whether a run that completed came to none."""
        missing = False
        for run_id, (end_state, work) in tuple(self._under_way.items()):
            evaluation = await work
            del self._under_way[run_id]
            if evaluation.result is None and end_state is EndState.COMPLETED:
                self.run_without_result, missing = run_id, True
                self.problem = f"Run {run_id} is complete, but {evaluation.problem}. Evaluate it again."
        return missing

    async def end(self, *, giving_up: bool) -> None:
        """Wait for results under way after a run failed, or give them up: each run keeps why."""
        waiting = [work for _, work in self._under_way.values()]
        for work in waiting if giving_up else ():
            work.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        self._under_way.clear()


# Run kinds -----------------------------------------------------------------------------------------
#
# What there is to be run, with the settings of each: what a form offers is what the service takes.


_MOVED_BY_MOTORS_ALONE = (PlantKind.RIG, PlantKind.REPLAY)


def list_experiment_kinds(
    entries: Iterable[ExperimentDefinition], in_force: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    """Return experiments with their settings and those of the loop as ``in_force``.

    λ is offered as far as it is safe with the models of ``tuning``, and the seed is the service's own.
    """
    offered = {
        "lam_q": (tuning.lam_q_min, tuning.lam_q_max),
        "lam_S": (tuning.lam_S_min, tuning.lam_S_max),
        "lam_motor": (tuning.lam_motor_min, tuning.lam_motor_max),
        "seed": (in_force.seed, in_force.seed),
    }
    values = asdict(in_force)
    of_the_loop = [
        replace(_limit_setting(setting, offered), default=values[setting.name])
        for setting in describe_settings(LoopSettings)
    ]
    moved_by_motors_alone = plant in _MOVED_BY_MOTORS_ALONE
    return [
        ExperimentKind(
            name=entry.name,
            title=entry.title,
            description=entry.description,
            run_kind=entry.run_kind,
            duration_s=entry.default_plan.program().duration_s,
            settings=[*entry.settings, *of_the_loop],
            why_not=_explain_missing_ability(entry) if moved_by_motors_alone else "",
        )
        for entry in entries
    ]


def describe_identification_kinds() -> list[IdentificationKind]:
    """Return what can be identified, with the settings of each."""
    return [
        IdentificationKind(
            kind=kind,
            title=entry.title,
            description=entry.description,
            settings=list(describe_settings(entry.plan)),
        )
        for kind, entry in IDENTIFICATIONS.items()
    ]


def _explain_missing_ability(entry: ExperimentDefinition) -> str:
    """Return why nothing but its motors moving a plant is not enough for an experiment; empty where it is."""
    try:
        program = entry.default_plan.program()
        if program.walls:
            return NO_WALL
        for segment in program.segments:
            require_plant_ability(segment, pushes=False, loads_shafts=False)
    except CommandRejectedError as refused:
        return str(refused)
    return ""


def _limit_setting(setting: Setting, offered: Mapping[str, tuple[float, float]]) -> Setting:
    low, high = offered.get(setting.name, (setting.minimum, setting.maximum))
    return replace(setting, minimum=low, maximum=high)


# Run progress --------------------------------------------------------------------------------------
#
# How far a run is, as the state shows it: of the time that it is expected to take.


@dataclass(frozen=True)
class RunPart:
    """A part of a program until ``end_s`` after its begin, the ``number``th ``of``; ``doing`` what at a set point."""

    title: str
    number: int
    of: int
    end_s: float
    doing: Stage | None = None


@dataclass(frozen=True)
class ScheduledRun:
    """A run of a plan, as it is expected to go: the ``number``th ``of`` those that were ordered together."""

    plan: Plan
    run: int
    expected: Expected
    number: int = 1
    of: int = 1

    @property
    def parts(self) -> tuple[RunPart, ...]:
        """The parts of its program by their times; set points are counted over all that was ordered together."""
        told = self.expected.timetable
        if told is None:
            phases = self.plan.phases()
            return tuple(RunPart(one.title, at, len(phases), one.end_s) for at, one in enumerate(phases, start=1))
        return tuple(
            RunPart(
                title=told.title(one),
                number=(self.number - 1) * one.of + one.number,
                of=self.of * one.of,
                end_s=one.end * T_s,
                doing=one.stage,
            )
            for one in told.intervals
        )


def make_progress_callback(live_state: LiveState, ordered: ScheduledRun, pause: Pause) -> ProgressCallback:
    """Return what puts into ``present`` how far a run is.

    What it is told counts from the start of each part; what is shown counts from the start of the run. Once the program
    plays, the way to it took as long as it took.
    """
    before_s, expected_s, parts = 0.0, ordered.expected.duration_s, ordered.parts
    plan = ordered.plan
    title = escape_line(plan.experiment.title) if isinstance(plan, ExperimentPlan) and plan.kind == KIND else ""

    def show(doing: RunPhase, elapsed_s: float) -> None:
        nonlocal before_s, expected_s
        if doing is RunPhase.PRETENSION:
            before_s = elapsed_s
        if doing is RunPhase.PROGRAM:
            expected_s = before_s + ordered.expected.program_s
        passed_s = {
            RunPhase.STARTING: 0.0,
            RunPhase.PRETENSION: elapsed_s,
            RunPhase.PROGRAM: before_s + elapsed_s,
            RunPhase.PAUSED: expected_s,
            RunPhase.EVALUATION: expected_s,
        }[doing]
        live_state.task = TaskView(
            kind=plan.kind,
            title=title,
            run=ordered.run,
            elapsed_s=passed_s,
            duration_s=expected_s,
            phase=doing,
            part=find_part(parts, elapsed_s) if doing is RunPhase.PROGRAM else None,
            number=ordered.number,
            following=pause.remaining_runs,
            pause_wanted=pause.is_requested,
        )

    return show


def find_part(parts: tuple[RunPart, ...], t: float) -> PartView | None:
    """Return the part of a program ``t`` [s] after its start; what is past the end is in the last one."""
    if not parts:
        return None
    part = next((one for one in parts if t < one.end_s), parts[-1])
    left_s = max(0.0, part.end_s - t)
    return PartView(title=part.title, number=part.number, of=part.of, doing=part.doing, left_s=left_s, t=t)


# Ordered runs --------------------------------------------------------------------------------------
#
# Identifications and experiments that run in this service, one at a time.


_log = logging.getLogger(__name__)


class JobManager:
    """Starts what takes its time and keeps the state informed of how far it is."""

    def __init__(
        self,
        rig: ExperimentRig,
        actuator: ActuatorService,
        banks: StoredBanks,
        experiments: OwnExperiments,
        prepare_report: Callable[[], None],
        seed: int,
        dry_runs: DryRuns,
        text_work: TextWork,
        supervision: Supervision,
        safe_stop: SafeStop,
    ) -> None:
        self._rig = rig
        self._actuator = actuator
        self._banks = banks
        self._experiments = experiments
        self._prepare_report = prepare_report
        self._seed = seed
        self._dry_runs = dry_runs
        self._text_work = text_work
        self._safe_stop = safe_stop
        self.queue = ExperimentQueue(self.start_experiment, self.complete_request, supervision, rig.database)
        self._problem = ""
        self._evaluations = PendingEvaluations()
        self.pause = Pause(actuator.live_state, actuator.publish_change)
        self._running: asyncio.Task[None] | None = None
        self._closing = False

    @property
    def problems(self) -> list[str]:
        """What became of the last run that failed, until another one is started or it has its result after all."""
        return [problem for problem in (self._problem, self._evaluations.problem) if problem]

    def clear_missing_result(self, run_id: int) -> None:
        """Take note that a run has been evaluated again: that its result is missing is not so any more."""
        if run_id == self._evaluations.run_without_result:
            self._evaluations.forget()
            self._actuator.publish_change()

    async def list_experiment_kinds(self, person: User, is_disconnected: IsDisconnected) -> list[ExperimentKind]:
        """Return the experiments there are, with their settings and those of the loop as in force."""
        live_state = self._actuator.live_state
        settings = self._loop_settings()
        self._dry_runs.prepare(live_state.tuning.parameters, settings)  # who looks at experiments may well try one
        tuning, plant = live_state.operator_tuning.view(0.0), live_state.plant.kind
        asked = self._experiments, settings, tuning, plant
        if await asyncio.to_thread(self._experiments.has_own):
            return await self._text_work.run(person, is_disconnected, _list_experiment_kinds, *asked)
        return await asyncio.to_thread(_list_experiment_kinds, *asked)

    async def start_experiment(self, request: ExperimentRequest, who: str) -> int:
        """Start an experiment and return its run. Raises RequestRejectedError, SettingError, OutOfRangeError."""
        _, plan, wanted = await self._parse_request(request)
        self._require_seed(wanted)
        async with self._actuator.start_lock:
            self._require_free()
            require_ready(self._rig.loop)
            return await self._start(await self._load_bank(wanted), RunRequest(plan, wanted, who))

    async def complete_request(self, request: ExperimentRequest) -> ExperimentRequest:
        """Return an order with all that it leaves to what is in force now, for one that waits for its turn.

        Raises what a start would raise: SettingError, OutOfRangeError, UnknownRecordError, TuningError.
        """
        name, plan, wanted = await self._parse_request(request)
        self._require_seed(wanted)
        tuning, bank = self._actuator.live_state.tuning, await self._load_bank(wanted)
        await asyncio.to_thread(tuning.with_choice, wanted.tuning, bank)
        await self._text_work.run_for_operator(
            _require_playable, self._rig.database, tuning.parameters, plan, wanted.tuning
        )
        return ExperimentRequest(
            name=name, settings={**request.settings, **list_setting_values(plan), **asdict(wanted)}
        )

    async def check_experiment(
        self, asked: ExperimentCheckRequest, person: User, is_disconnected: IsDisconnected
    ) -> CheckedExperiment:
        """Look an own experiment over on this plant and the tuning in force, and predict its peaks on the simulator.

        Raises ExperimentError.
        """
        checked = await self._check_text(asked.text, person, is_disconnected)
        if not asked.play:
            return checked.build_view({}, "it was looked over only")
        try:
            played = await self._run_dry(
                RunRequest(checked.plan, self._loop_settings(), person.name), person, is_disconnected
            )
        except (RequestRejectedError, InvalidValueError) as error:
            busy = isinstance(error, RequestRejectedError) and error.category is ErrorCode.TOO_MANY
            return checked.build_view({}, str(error), busy=busy)
        return checked.build_view({item.name: item.value for item in played.metrics}, dry_run=played)

    async def store_experiment(self, written: str, person: User, is_disconnected: IsDisconnected) -> OwnExperiment:
        """Keep an own experiment as the next version of its name. Raises ExperimentError."""
        checked = await self._check_text(written, person, is_disconnected)
        kept = await asyncio.to_thread(self._experiments.store, checked, written, person.name)
        return build_own_experiment(kept, checked.title)

    async def _check_text(self, written: str, person: User, is_disconnected: IsDisconnected) -> ExperimentCheck:
        here = self._actuator.live_state.tuning.parameters, self._loop_settings().tuning
        return await self._text_work.run(person, is_disconnected, self._experiments.check, written, *here)

    async def dry_run(self, request: ExperimentRequest, person: User, is_disconnected: IsDisconnected) -> DryRunView:
        """Play an experiment on a simulator beside this service. Raises SettingError and what ``DryRuns.play`` does."""
        asked = request.name, self._loop_settings(), request.settings
        if request.name in experiments_by_name():
            _, plan, wanted = await asyncio.to_thread(self._experiments.build_plan, *asked)
        else:
            _, plan, wanted = await self._text_work.run(person, is_disconnected, self._experiments.build_plan, *asked)
        return await self._run_dry(RunRequest(plan, wanted, person.name), person, is_disconnected)

    async def _run_dry(self, order: RunRequest, person: User, is_disconnected: IsDisconnected) -> DryRunView:
        bank = await self._load_bank(order.loop_settings)
        others = list_plan_banks(order.plan) - {0 if bank is None else bank.id}
        used = [
            *([] if bank is None else [bank]),
            *(await asyncio.to_thread(self._banks.find_existing, others) if others else ()),
        ]
        return await self._dry_runs.play(
            self._actuator.live_state.tuning.parameters, order, used, person, is_disconnected
        )

    async def start_identification(self, request: IdentificationRequest, who: str) -> int:
        """Start an identification, or several in turn, and return the first run.

        Raises RequestRejectedError, SettingError, OutOfRangeError.
        """
        plans = build_plans(request)
        async with self._actuator.start_lock:
            self._require_free()
            parameters = self._rig.parameters
            loop, bank = self._loop_settings(), self._actuator.live_state.tuning.bank
            start = read_start(self._rig.loop.ring.newest())
            told = await self._text_work.run_for_operator(
                forecast_identifications, plans, parameters, start, loop.lam_motor
            )
            told.require_within_range(parameters)
            return await self._start(bank, *(RunRequest(plan, loop, who) for plan in plans))

    async def predict_identification(self, request: IdentificationRequest, compute: Compute) -> Prediction:
        """Tell what an identification would do to the rig. Raises SettingError, OutOfRangeError."""
        tuning, start = self._actuator.live_state.tuning, read_start(self._rig.loop.ring.newest())
        told: Prediction = await compute(predict_runs, request, tuning.parameters, tuning.lambdas.lam_motor, start)
        return told

    def is_evaluating(self, run_id: int) -> bool:
        """Whether the result of a run is being computed."""
        return run_id in self._evaluations

    async def close(self, cause: str = "service ended") -> None:
        """Give up what is running; its run is closed as ended by ``cause``."""
        self._closing = True
        if self._running is not None:
            self._running.cancel(cause)
            await asyncio.gather(self._running, return_exceptions=True)

    def _require_free(self) -> None:
        self._actuator.require_unoccupied()
        if (task := self._actuator.live_state.task) is not None:
            remedy = "wait for its end or stop it"
            raise RequestRejectedError(ErrorCode.NOT_NOW, f"run {task.run}, {task.kind}, is under way: {remedy}")
        if self._actuator.tuning_service.view_trial() is not None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "a tuning is on trial: keep it or revert it first")

    async def _start(self, bank: Bank | None, *orders: RunRequest) -> int:
        """Start orders in turn, all with the tuning of the first on the models of ``bank``."""
        await self._actuator.tuning_service.apply_temporary(orders[0].loop_settings.tuning, bank, orders[0].who)
        try:
            run = await asyncio.to_thread(create_run, self._rig, orders[0])
        except BaseException:
            await self._actuator.tuning_service.restore_operator_tuning()
            raise
        self._problem = ""
        self._evaluations.forget()
        self.pause.begin(len(orders) - 1)
        progress = await self._make_progress_callback(orders, 0, run)
        progress(RunPhase.STARTING, 0.0)
        self._running = asyncio.create_task(self._run_all(orders, run, progress))
        self._prepare_report()
        return run.id

    async def _run_all(self, orders: Sequence[RunRequest], run: Run, show: ProgressCallback) -> None:
        """Perform orders in turn; ``run`` and ``show`` are those of the first. One that does not complete ends it.

        While the result of one is computed the next one plays: together they take what was announced.
        """
        end_state: EndState | None = None
        playing = True
        try:
            for position, order in enumerate(orders):
                if position > 0:
                    playing = False
                    if (following := await self._create_next_run(orders[position:], run, show)) is None:
                        break
                    run, playing = following, True
                    show = await self._make_progress_callback(orders, position, run)
                    show(RunPhase.STARTING, 0.0)
                self._actuator.live_state.program_tunings = await self._list_program_tunings(order)
                over = (
                    self._actuator.tuning_service.restore_operator_tuning
                    if position == len(orders) - 1
                    else _keep_tuning
                )
                closed = await execute_run(self._rig, order, run, show, over)
                end_state = EndState(closed.end_state)
                work = asyncio.create_task(evaluate_closed_run(self._rig, order.plan, closed))
                self._evaluations.add(run.id, end_state, work)
                if end_state is not EndState.COMPLETED:
                    break
            playing = False
            self.pause.begin(0)
            show(RunPhase.EVALUATION, 0.0)
            if await self._evaluations.wait_for_results():
                end_state = None  # whoever waits for the result, the queue too, waits for a person
        except Exception as error:
            _log.exception("Run %s failed.", run.id)
            self._problem = f"Run {run.id} was given up ({type(error).__name__}: {error}): what it moved was stopped."
        finally:
            if playing and not self._closing:
                # Nobody watches over the program any more, and its run is closed: it must not play on.
                self._problem = self._problem or f"The watch over run {run.id} was ended: what it moved was stopped."
                self._safe_stop.begin(Fault.SERVICE_LOST)
            if not self._closing:  # the next start finds the operator's tuning: what was lent is not kept
                await self._actuator.tuning_service.restore_operator_tuning()
            await self._evaluations.end(giving_up=self._closing)
            self._actuator.live_state.task = None
            self._actuator.publish_change()
            self.queue.handle_run_end(run.id, end_state)

    async def _create_next_run(self, orders: Sequence[RunRequest], run: Run, show: ProgressCallback) -> Run | None:
        """Create the first run of what is left after ``run`` once no pause is wanted; None, and a problem, if it fails.

        Nothing plays then, and ``run`` is complete: neither it nor the joint is concerned.
        """
        try:
            await self.pause.wait_until_resumed(self._rig.loop, partial(show, RunPhase.PAUSED, 0.0))
            return await asyncio.to_thread(create_run, self._rig, orders[0])
        except Exception as error:
            _log.warning("No run follows run %s: %s", run.id, error, exc_info=not isinstance(error, NotReadyError))
            self._problem = describe_runs_not_started(run.id, error, len(orders))
            return None

    async def _list_program_tunings(self, order: RunRequest) -> list[ResolvedTuning]:
        """Return the tunings that an order puts into use while it plays, by their numbers from 1 on."""
        choices = list_plan_tunings(order.plan, order.loop_settings.tuning)
        numbers = {choice.bank for choice in choices}
        there = (
            {bank.id: bank for bank in await asyncio.to_thread(self._banks.find_existing, numbers)} if choices else {}
        )
        return [ResolvedTuning(choice, there.get(choice.bank)) for choice in choices]

    async def _make_progress_callback(self, orders: Sequence[RunRequest], position: int, run: Run) -> ProgressCallback:
        """Return what shows in the state how far a run is, of the time that it is expected to take from here."""
        plan, start = orders[position].plan, read_start(self._rig.loop.ring.newest())
        told = await asyncio.to_thread(forecast_duration, plan, self._rig.parameters, start)
        ordered = ScheduledRun(plan, run.id, told, position + 1, len(orders))
        return make_progress_callback(self._actuator.live_state, ordered, self.pause)

    def _require_seed(self, wanted: LoopSettings) -> None:
        if wanted.seed != self._seed:
            remedy = f"the simulator of this service runs with seed {self._seed}; sinew experiment takes any"
            raise SettingError("seed", wanted.seed, remedy)

    async def _load_bank(self, wanted: LoopSettings) -> Bank | None:
        return await asyncio.to_thread(self._banks.load_stored_bank, wanted.bank) if wanted.bank else None

    async def _parse_request(self, request: ExperimentRequest) -> tuple[str, Plan, LoopSettings]:
        """Return what is asked for, of an own one its version; the operator's tuning where nothing else is said."""
        asked = request.name, self._loop_settings(), request.settings
        if request.name in experiments_by_name():  # no text of a person's: as costly as Sinew's own
            return await asyncio.to_thread(self._experiments.build_plan, *asked)
        return await self._text_work.run_for_operator(self._experiments.build_plan, *asked)

    def _loop_settings(self) -> LoopSettings:
        return LoopSettings(**self._actuator.live_state.operator_tuning.choice.to_document(), seed=self._seed)


def _list_experiment_kinds(
    known: OwnExperiments, in_force: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    return list_experiment_kinds(known.list_definitions(), in_force, tuning, plant)


def _require_playable(database: Database, parameters: PlantParameters, plan: Plan, tuning: TuningSettings) -> None:
    compile_program(make_bank_loader(database), parameters, plan, tuning)


async def _keep_tuning() -> None:
    """Leave the tuning with a sequence of runs until the last one is over."""
