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
    ExpectedDuration,
    ExperimentDefinition,
    ExperimentPlan,
    IdentificationPlan,
    InitialState,
    LoopSettings,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
    Stage,
    experiments_by_name,
    forecast_duration,
    forecast_identifications,
    list_setting_values,
    predict_excitation,
    predict_motor,
    predict_spring,
    read_initial_state,
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
from backend.services import messages
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

# Identifications -----------------------------------------------------------------------------------
# Builds the plans of a requested identification and predicts their effect on the rig.


def build_plans(request: IdentificationRequest) -> tuple[IdentificationPlan, ...]:
    """Return the plans of a request: one per tension, if it lists tensions.

    Raises SettingError, OutOfRangeError.
    """
    match request:
        case MotorRequest():
            return (_build_motor_plan(request),)
        case SpringRequest():
            return (_build_spring_plan(request),)
        case ActuatorRequest():
            return _build_actuator_plans(request)


def predict_runs(
    request: IdentificationRequest, parameters: PlantParameters, lam_motor: float, start: InitialState
) -> Prediction:
    """Predict the runs of a request from ``start``.

    For several runs, the whole path and the worst values.

    Args:
        request: The request.
        parameters: Parameters of the plant.
        lam_motor: Tuning parameter of the motor loops [s].
        start: Position and tensions before the first run.

    """
    plans = build_plans(request)
    forecast = forecast_identifications(plans, parameters, start, lam_motor)
    assessment = _assess(request, plans, parameters, lam_motor)
    try:
        forecast.require_within_range(parameters)
        problem = assessment.problem
        within_range = True
    except OutOfRangeError as error:
        problem, within_range = str(error), False
    return Prediction(
        duration_s=forecast.duration_s,
        q_start=forecast.q_start,
        q_low=forecast.q_low,
        q_high=forecast.q_high,
        F_low=forecast.F_low,
        F_high=forecast.F_high,
        path=[PathPoint(q=q, S=S) for q, S in zip(forecast.q_path.tolist(), forecast.S_path.tolist(), strict=True)],
        within_range=within_range,
        figures=assessment.figures,
        q_counts=assessment.q_counts,
        u_peak_V=assessment.u_peak_V,
        F_min_N=assessment.F_min_N,
        enough_motion=not problem,
        message=problem or messages.forecast_with_excitation(forecast=forecast.message, excitation=assessment.message),
    )


@dataclass(frozen=True)
class _Assessment:
    """Expected data quality of an identification."""

    figures: list[Expectation]
    message: str
    problem: str
    """Why the run would give no usable model; empty if it would."""

    q_counts: float | None = None
    u_peak_V: float | None = None
    F_min_N: float | None = None


def _assess(
    request: IdentificationRequest, plans: tuple[IdentificationPlan, ...], parameters: PlantParameters, lam_motor: float
) -> _Assessment:
    match request:
        case MotorRequest():
            run = predict_motor(_build_motor_plan(request), parameters)
            return _Assessment(
                list(run.figures), run.message, "" if run.is_feasible else run.message, u_peak_V=request.u_high
            )
        case SpringRequest():
            run = predict_spring(_build_spring_plan(request), parameters)
            return _Assessment(list(run.figures), run.message, "" if run.is_feasible else run.message)
        case ActuatorRequest():
            actuator_plans = [plan for plan in plans if isinstance(plan, ActuatorIdentificationPlan)]
            return _assess_actuator(actuator_plans, parameters, lam_motor)


def _build_motor_plan(request: MotorRequest) -> MotorIdentificationPlan:
    return build_plan(MotorIdentificationPlan, request.model_dump(exclude={"kind"}))


def _build_spring_plan(request: SpringRequest) -> SpringIdentificationPlan:
    return build_plan(SpringIdentificationPlan, request.model_dump(exclude={"kind"}))


def _build_actuator_plans(request: ActuatorRequest) -> tuple[ActuatorIdentificationPlan, ...]:
    values = request.model_dump(exclude={"kind", "tensions_N", "tension_N"})
    if request.tensions_N is None:
        return (build_plan(ActuatorIdentificationPlan, {**values, "tension_N": request.tension_N}),)
    return tuple(_build_plan_at_tension(values, index, tension) for index, tension in enumerate(request.tensions_N))


def _build_plan_at_tension(values: dict[str, Any], index: int, tension_N: float) -> ActuatorIdentificationPlan:
    """Return the plan of a listed tension.

    Errors of the tension name its place in the list.
    """
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
            label=f"tension {index + 1}",
            path=("tensions_N", index),
        ) from None


def _assess_actuator(
    plans: list[ActuatorIdentificationPlan], parameters: PlantParameters, lam_motor: float
) -> _Assessment:
    predicted = [predict_excitation(plan, parameters, lam_motor) for plan in plans]
    # The worst run is one that fails because of voltage or slack; among feasible ones, that with the least motion.
    worst = min(predicted, key=lambda item: (item.is_feasible, item.q_counts))
    u_peak, F_min = max(item.u_peak_V for item in predicted), min(item.F_min_N for item in predicted)
    label = messages.joint_motion_of_excitation()
    return _Assessment(
        figures=[
            Expectation(name="q_counts", label=label, value=worst.q_counts, unit="encoder counts"),
            Expectation(
                name="u_peak_V",
                label=messages.peak_voltage_with_limit(u_max=parameters.motor.u_max),
                value=u_peak,
                unit="V",
            ),
        ],
        message=worst.message,
        problem=worst.problem,
        q_counts=worst.q_counts,
        u_peak_V=u_peak,
        F_min_N=F_min,
    )


# Kinds of runs -------------------------------------------------------------------------------------
# Experiments and identifications that can be run, with their settings as the forms show them.


_WITHOUT_SIMULATED_INPUTS = (PlantKind.RIG, PlantKind.REPLAY)


def list_experiment_kinds(
    definitions: Iterable[ExperimentDefinition], loop_settings: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    """Return experiments with their settings and those of the loop.

    ``loop_settings`` are the defaults of the latter. The ranges of λ are those that are safe with ``tuning``; the seed
    is fixed to that of the service.
    """
    ranges = {
        "lam_q": (tuning.lam_q_min, tuning.lam_q_max),
        "lam_S": (tuning.lam_S_min, tuning.lam_S_max),
        "lam_motor": (tuning.lam_motor_min, tuning.lam_motor_max),
        "seed": (loop_settings.seed, loop_settings.seed),
    }
    defaults = asdict(loop_settings)
    described = [
        replace(_limit_setting(setting, ranges), default=defaults[setting.name])
        for setting in describe_settings(LoopSettings)
    ]
    has_no_inputs = plant in _WITHOUT_SIMULATED_INPUTS
    return [
        ExperimentKind(
            name=definition.name,
            title=definition.title,
            description=definition.description,
            run_kind=definition.run_kind,
            duration_s=definition.default_plan.program().duration_s,
            settings=[*definition.settings, *described],
            why_not=_explain_missing_ability(definition) if has_no_inputs else "",
        )
        for definition in definitions
    ]


def describe_identification_kinds() -> list[IdentificationKind]:
    """Return the kinds of identification with their settings."""
    return [
        IdentificationKind(
            kind=kind, title=entry.title, description=entry.description, settings=list(describe_settings(entry.plan))
        )
        for kind, entry in IDENTIFICATIONS.items()
    ]


def _explain_missing_ability(definition: ExperimentDefinition) -> str:
    """Return why an experiment needs simulated inputs, as obstacle, push or load.

    Empty if it needs none.
    """
    try:
        program = definition.default_plan.program()
        if program.walls:
            return NO_WALL
        for segment in program.segments:
            require_plant_ability(segment, pushes=False, loads_shafts=False)
    except CommandRejectedError as error:
        return str(error)
    return ""


def _limit_setting(setting: Setting, ranges: Mapping[str, tuple[float, float]]) -> Setting:
    minimum, maximum = ranges.get(setting.name, (setting.minimum, setting.maximum))
    return replace(setting, minimum=minimum, maximum=maximum)


# Pause ---------------------------------------------------------------------------------------------
# A pause between two runs of one request, in mode pretension. Within a run there is no pause: the
# control loop executes a program as a whole, and its recording is contiguous.


_REASONS_MOTORS_OFF = {
    Mode.OFF: messages.motors_switched_off_in_pause(),
    Mode.STOPPING: messages.stopped_softly_in_pause(),
    Mode.TRIPPED: messages.tripped_in_pause(),
}


class Pause:
    """The pause of the current request."""

    def __init__(self, live_state: LiveState, on_change: Callable[[], None]) -> None:
        self.is_requested = False
        """Whether the next run must wait."""

        self.remaining_runs = 0
        """Runs of the request that have not started."""

        self._live_state = live_state
        self._on_change = on_change

    def begin(self, remaining_runs: int) -> None:
        """Clear the pause, with a number of runs that have not started."""
        self.is_requested, self.remaining_runs = False, remaining_runs

    def request(self, is_requested: bool) -> None:
        """Let the next run wait, or start. Raises RequestRejectedError if no run remains."""
        task = self._live_state.task
        if task is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_run_to_pause())
        if self.remaining_runs == 0:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_further_run_to_pause())
        self.is_requested = is_requested
        self._live_state.task = task.model_copy(update={"pause_wanted": is_requested})
        self._on_change()

    async def wait_until_resumed(self, loop: LoopClient, show: Callable[[], None]) -> None:
        """Wait while a pause is requested, then count the next run as started.

        Calls ``show`` meanwhile. Raises NotReadyError if the motors are switched off, LoopExitedError.
        """
        while self.is_requested:
            show()
            await loop.advance(SLICE_S)
            await asyncio.sleep(0)  # a simulated loop advances without waiting: let other tasks run
            if (why := _REASONS_MOTORS_OFF.get(mode := current_mode(loop))) is not None:
                raise NotReadyError(why, mode)
        # Before the next run is prepared: a pause after the last run cannot be requested.
        self.remaining_runs -= 1


# Pending evaluations -------------------------------------------------------------------------------
# Results of the runs of one request, which are computed while the next run is executed.


class PendingEvaluations:
    """Evaluations in progress. Used in the event loop of the service."""

    def __init__(self) -> None:
        self._in_progress: dict[int, tuple[EndState, asyncio.Task[Evaluation]]] = {}
        self.run_without_result: int | None = None
        """A completed run whose evaluation gave no result."""

        self.problem = ""
        """Why that run has no result."""

    def __contains__(self, run_id: int) -> bool:
        return run_id in self._in_progress

    def add(self, run_id: int, end_state: EndState, task: asyncio.Task[Evaluation]) -> None:
        """Add the evaluation of a run that has ended with ``end_state``."""
        self._in_progress[run_id] = end_state, task

    def clear_problem(self) -> None:
        """Clear the run without result: another run has started, or it has a result now."""
        self.run_without_result, self.problem = None, ""

    async def wait_for_results(self) -> bool:
        """Wait for all evaluations; return whether a completed run has no result."""
        is_missing = False
        for run_id, (end_state, task) in tuple(self._in_progress.items()):
            evaluation = await task
            del self._in_progress[run_id]
            if evaluation.result is None and end_state is EndState.COMPLETED:
                self.run_without_result, is_missing = run_id, True
                self.problem = messages.run_without_result(run=run_id, reason=evaluation.problem)
        return is_missing

    async def end(self, *, cancel: bool) -> None:
        """Wait for all evaluations after a failure, or cancel them.

        Errors are stored with the runs.
        """
        tasks = [task for _, task in self._in_progress.values()]
        for task in tasks if cancel else ():
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._in_progress.clear()


# Progress ------------------------------------------------------------------------------------------
# Progress of a run in the live state, in relation to its forecast duration.


@dataclass(frozen=True)
class RunPart:
    """Part of a program."""

    title: str
    number: int
    total: int
    """Number of parts."""

    end_s: float
    """End after the start of the program [s]."""

    stage: Stage | None = None
    """What the identification does at an operating point."""


@dataclass(frozen=True)
class ScheduledRun:
    """A run with its forecast."""

    plan: Plan
    run: int
    expected: ExpectedDuration
    number: int = 1
    total: int = 1
    """Number of runs of the request."""

    @property
    def parts(self) -> tuple[RunPart, ...]:
        """The parts of the program in order.

        Operating points are counted over all runs of the request.
        """
        timetable = self.expected.timetable
        if timetable is None:
            phases = self.plan.phases()
            return tuple(
                RunPart(phase.title, number, len(phases), phase.end_s) for number, phase in enumerate(phases, start=1)
            )
        return tuple(
            RunPart(
                title=timetable.title(interval),
                number=(self.number - 1) * interval.of + interval.number,
                total=self.total * interval.of,
                end_s=interval.end * T_s,
                stage=interval.stage,
            )
            for interval in timetable.intervals
        )


def make_progress_callback(live_state: LiveState, scheduled: ScheduledRun, pause: Pause) -> ProgressCallback:
    """Return a callback that sets the progress of a run in ``live_state``.

    The callback gets the time since the start of a phase. The shown time counts from the start of the run, and the
    expected duration is corrected when the program starts.
    """
    before_s, expected_s, parts = 0.0, scheduled.expected.duration_s, scheduled.parts
    plan = scheduled.plan
    title = escape_line(plan.experiment.title) if isinstance(plan, ExperimentPlan) and plan.kind == KIND else ""

    def show(phase: RunPhase, elapsed_s: float) -> None:
        nonlocal before_s, expected_s
        if phase is RunPhase.PRETENSION:
            before_s = elapsed_s
        if phase is RunPhase.PROGRAM:
            expected_s = before_s + scheduled.expected.program_s
        since_start_s = {
            RunPhase.STARTING: 0.0,
            RunPhase.PRETENSION: elapsed_s,
            RunPhase.PROGRAM: before_s + elapsed_s,
            RunPhase.PAUSED: expected_s,
            RunPhase.EVALUATION: expected_s,
        }[phase]
        live_state.task = TaskView(
            kind=plan.kind,
            title=title,
            run=scheduled.run,
            elapsed_s=since_start_s,
            duration_s=expected_s,
            phase=phase,
            part=find_part(parts, elapsed_s) if phase is RunPhase.PROGRAM else None,
            number=scheduled.number,
            following=pause.remaining_runs,
            pause_wanted=pause.is_requested,
        )

    return show


def find_part(parts: tuple[RunPart, ...], t: float) -> PartView | None:
    """Return the part at ``t`` [s] after the start of the program.

    The last part after its end.
    """
    if not parts:
        return None
    part = next((one for one in parts if t < one.end_s), parts[-1])
    left_s = max(0.0, part.end_s - t)
    return PartView(title=part.title, number=part.number, of=part.total, doing=part.stage, left_s=left_s, t=t)


# Job manager ---------------------------------------------------------------------------------------
# Runs identifications and experiments on the rig, one at a time.


_log = logging.getLogger(__name__)


class JobManager:
    """Starts identifications and experiments, and shows their progress."""

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
        self.pause = Pause(actuator.live_state, actuator.publish_change)
        self._problem = ""
        self._evaluations = PendingEvaluations()
        self._running: asyncio.Task[None] | None = None
        self._is_closing = False

    @property
    def problems(self) -> list[str]:
        """Problems of the last run; cleared by the next run or by its evaluation."""
        return [problem for problem in (self._problem, self._evaluations.problem) if problem]

    def clear_missing_result(self, run_id: int) -> None:
        """Clear the problem of a run without result, because it was evaluated again."""
        if run_id == self._evaluations.run_without_result:
            self._evaluations.clear_problem()
            self._actuator.publish_change()

    def is_evaluating(self, run_id: int) -> bool:
        """Return whether the result of a run is being computed."""
        return run_id in self._evaluations

    async def close(self, cause: str = messages.service_ended()) -> None:
        """Cancel the current run, which is stored as ended by ``cause``."""
        self._is_closing = True
        if self._running is not None:
            self._running.cancel(cause)
            await asyncio.gather(self._running, return_exceptions=True)

    async def list_experiment_kinds(self, user: User, is_disconnected: IsDisconnected) -> list[ExperimentKind]:
        """Return all experiments with their settings and those of the loop."""
        live_state = self._actuator.live_state
        settings = self._get_loop_settings()
        self._dry_runs.prepare(live_state.tuning.parameters, settings)  # the user may start a dry run next
        tuning, plant = live_state.operator_tuning.view(0.0), live_state.plant.kind
        arguments = self._experiments, settings, tuning, plant
        if await asyncio.to_thread(self._experiments.has_own):
            return await self._text_work.run(user, is_disconnected, _list_experiment_kinds, *arguments)
        return await asyncio.to_thread(_list_experiment_kinds, *arguments)

    async def start_experiment(self, request: ExperimentRequest, who: str) -> int:
        """Start an experiment and return its run.

        Raises RequestRejectedError, SettingError, OutOfRangeError.
        """
        _, plan, settings = await self._build_plan(request)
        self._require_seed(settings)
        async with self._actuator.start_lock:
            self._require_idle()
            require_ready(self._rig.loop)
            return await self._start(await self._load_bank(settings), RunRequest(plan, settings, who))

    async def complete_request(self, request: ExperimentRequest) -> ExperimentRequest:
        """Return a request with all its settings, for the queue.

        A waiting experiment then does not depend on the active tuning. Raises the errors of a start: SettingError,
        OutOfRangeError, UnknownRecordError, TuningError.
        """
        name, plan, settings = await self._build_plan(request)
        self._require_seed(settings)
        tuning, bank = self._actuator.live_state.tuning, await self._load_bank(settings)
        await asyncio.to_thread(tuning.with_settings, settings.tuning, bank)
        await self._text_work.run_for_operator(
            _require_compilable, self._rig.database, tuning.parameters, plan, settings.tuning
        )
        return ExperimentRequest(
            name=name, settings={**request.settings, **list_setting_values(plan), **asdict(settings)}
        )

    async def check_experiment(
        self, request: ExperimentCheckRequest, user: User, is_disconnected: IsDisconnected
    ) -> CheckedExperiment:
        """Check the text of an experiment, and predict its peaks by a dry run.

        Uses the active parameters and the operator's tuning. Raises ExperimentError.
        """
        checked = await self._check_text(request.text, user, is_disconnected)
        if not request.play:
            return checked.build_view({}, messages.checked_without_dry_run())
        try:
            played = await self._run_dry(
                RunRequest(checked.plan, self._get_loop_settings(), user.name), user, is_disconnected
            )
        except (RequestRejectedError, InvalidValueError) as error:
            busy = isinstance(error, RequestRejectedError) and error.category is ErrorCode.TOO_MANY
            return checked.build_view({}, str(error), busy=busy)
        return checked.build_view({item.name: item.value for item in played.metrics}, dry_run=played)

    async def store_experiment(self, text: str, user: User, is_disconnected: IsDisconnected) -> OwnExperiment:
        """Store an experiment as the next version of its name. Raises ExperimentError."""
        checked = await self._check_text(text, user, is_disconnected)
        stored = await asyncio.to_thread(self._experiments.store, checked, text, user.name)
        return build_own_experiment(stored, checked.title)

    async def _check_text(self, text: str, user: User, is_disconnected: IsDisconnected) -> ExperimentCheck:
        parameters, tuning = self._actuator.live_state.tuning.parameters, self._get_loop_settings().tuning
        return await self._text_work.run(user, is_disconnected, self._experiments.check, text, parameters, tuning)

    async def dry_run(self, request: ExperimentRequest, user: User, is_disconnected: IsDisconnected) -> DryRunView:
        """Run an experiment on a simulator.

        Raises SettingError and the errors of ``DryRuns.play``.
        """
        arguments = request.name, self._get_loop_settings(), request.settings
        build_plan = self._experiments.build_plan
        if request.name in experiments_by_name():
            _, plan, settings = await asyncio.to_thread(build_plan, *arguments)
        else:
            _, plan, settings = await self._text_work.run(user, is_disconnected, build_plan, *arguments)
        return await self._run_dry(RunRequest(plan, settings, user.name), user, is_disconnected)

    async def _run_dry(self, request: RunRequest, user: User, is_disconnected: IsDisconnected) -> DryRunView:
        bank = await self._load_bank(request.loop_settings)
        others = list_plan_banks(request.plan) - {0 if bank is None else bank.id}
        used = [
            *([] if bank is None else [bank]),
            *(await asyncio.to_thread(self._banks.find_existing, others) if others else ()),
        ]
        parameters = self._actuator.live_state.tuning.parameters
        return await self._dry_runs.play(parameters, request, used, user, is_disconnected)

    async def start_identification(self, request: IdentificationRequest, who: str) -> int:
        """Start the runs of an identification, one after the other, and return the first.

        Raises RequestRejectedError, SettingError, OutOfRangeError.
        """
        plans = build_plans(request)
        async with self._actuator.start_lock:
            self._require_idle()
            parameters = self._rig.parameters
            settings, bank = self._get_loop_settings(), self._actuator.live_state.tuning.bank
            start = read_initial_state(self._rig.loop.ring.newest())
            forecast = await self._text_work.run_for_operator(
                forecast_identifications, plans, parameters, start, settings.lam_motor
            )
            forecast.require_within_range(parameters)
            return await self._start(bank, *(RunRequest(plan, settings, who) for plan in plans))

    async def predict_identification(self, request: IdentificationRequest, compute: Compute) -> Prediction:
        """Predict the effect of an identification on the rig.

        Raises SettingError, OutOfRangeError.
        """
        tuning, start = self._actuator.live_state.tuning, read_initial_state(self._rig.loop.ring.newest())
        lam_motor = tuning.lambdas.lam_motor
        prediction: Prediction = await compute(predict_runs, request, tuning.parameters, lam_motor, start)
        return prediction

    def _require_idle(self) -> None:
        """Raise RequestRejectedError during a commissioning step, a run or a trial."""
        self._actuator.require_unoccupied()
        if (task := self._actuator.live_state.task) is not None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.run_prevents_start(run=task.run, kind=task.kind))
        if self._actuator.tuning_service.view_trial() is not None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.trial_in_progress())

    async def _start(self, bank: Bank | None, *requests: RunRequest) -> int:
        """Start runs one after the other and return the first.

        All use the tuning of the first and the models of ``bank``.
        """
        settings = requests[0].loop_settings
        await self._actuator.tuning_service.apply_temporary(settings.tuning, bank, requests[0].who)
        try:
            run = await asyncio.to_thread(create_run, self._rig, requests[0])
        except BaseException:
            await self._actuator.tuning_service.restore_operator_tuning()
            raise
        self._problem = ""
        self._evaluations.clear_problem()
        self.pause.begin(len(requests) - 1)
        show = await self._make_progress_callback(requests, 0, run)
        show(RunPhase.STARTING, 0.0)
        self._running = asyncio.create_task(self._run_all(requests, run, show))
        self._prepare_report()
        return run.id

    async def _run_all(self, requests: Sequence[RunRequest], run: Run, show: ProgressCallback) -> None:
        """Execute requests one after the other until one does not complete.

        ``run`` and ``show`` belong to the first request. A run is evaluated while the next one is executed.
        """
        end_state: EndState | None = None
        is_executing = True
        try:
            for position, request in enumerate(requests):
                if position > 0:
                    is_executing = False
                    if (next_run := await self._create_next_run(requests[position:], run, show)) is None:
                        break
                    run, is_executing = next_run, True
                    show = await self._make_progress_callback(requests, position, run)
                    show(RunPhase.STARTING, 0.0)
                self._actuator.live_state.program_tunings = await self._list_program_tunings(request)
                is_last = position == len(requests) - 1
                restore = self._actuator.tuning_service.restore_operator_tuning if is_last else _keep_tuning
                closed = await execute_run(self._rig, request, run, show, restore)
                end_state = EndState(closed.end_state)
                task = asyncio.create_task(evaluate_closed_run(self._rig, request.plan, closed))
                self._evaluations.add(run.id, end_state, task)
                if end_state is not EndState.COMPLETED:
                    break
            is_executing = False
            self.pause.begin(0)
            show(RunPhase.EVALUATION, 0.0)
            if await self._evaluations.wait_for_results():
                end_state = None  # a missing result pauses the queue until an operator has seen it
        except Exception as error:
            _log.exception("Run %s failed.", run.id)
            self._problem = messages.run_failed(run=run.id, error=f"{type(error).__name__}: {error}")
        finally:
            if is_executing and not self._is_closing:
                # The run is closed and its execution is no longer monitored, so the program must not continue.
                self._problem = self._problem or messages.run_without_monitoring(run=run.id)
                self._safe_stop.begin(Fault.SERVICE_LOST)
            if not self._is_closing:  # a temporary tuning is not stored: the next service starts with the operator's
                await self._actuator.tuning_service.restore_operator_tuning()
            await self._evaluations.end(cancel=self._is_closing)
            self._actuator.live_state.task = None
            self._actuator.publish_change()
            self.queue.handle_run_end(run.id, end_state)

    async def _create_next_run(self, requests: Sequence[RunRequest], run: Run, show: ProgressCallback) -> Run | None:
        """Create the next run, as soon as no pause is requested.

        Returns None and sets the problem if that fails. No program is executed then, and ``run`` stays complete.
        """
        try:
            await self.pause.wait_until_resumed(self._rig.loop, partial(show, RunPhase.PAUSED, 0.0))
            return await asyncio.to_thread(create_run, self._rig, requests[0])
        except Exception as error:
            _log.warning(
                "The next run after run %s was not started: %s",
                run.id,
                error,
                exc_info=not isinstance(error, NotReadyError),
            )
            self._problem = messages.runs_not_started(run=run.id, reason=str(error), count=len(requests))
            return None

    async def _list_program_tunings(self, request: RunRequest) -> list[ResolvedTuning]:
        """Return the tunings that the program activates, ordered by number from 1."""
        choices = list_plan_tunings(request.plan, request.loop_settings.tuning)
        if not choices:
            return []
        numbers = {choice.bank for choice in choices}
        banks = {bank.id: bank for bank in await asyncio.to_thread(self._banks.find_existing, numbers)}
        return [ResolvedTuning(choice, banks.get(choice.bank)) for choice in choices]

    async def _make_progress_callback(
        self, requests: Sequence[RunRequest], position: int, run: Run
    ) -> ProgressCallback:
        """Return the progress callback for the run at ``position``."""
        plan, start = requests[position].plan, read_initial_state(self._rig.loop.ring.newest())
        expected = await asyncio.to_thread(forecast_duration, plan, self._rig.parameters, start)
        scheduled = ScheduledRun(plan, run.id, expected, position + 1, len(requests))
        return make_progress_callback(self._actuator.live_state, scheduled, self.pause)

    def _require_seed(self, settings: LoopSettings) -> None:
        if settings.seed != self._seed:
            raise SettingError("seed", settings.seed, messages.seed_of_another_simulator(seed=self._seed))

    async def _load_bank(self, settings: LoopSettings) -> Bank | None:
        return await asyncio.to_thread(self._banks.load_stored_bank, settings.bank) if settings.bank else None

    async def _build_plan(self, request: ExperimentRequest) -> tuple[str, Plan, LoopSettings]:
        """Return name with version, plan and settings of a request.

        Unspecified settings are the operator's tuning.
        """
        arguments = request.name, self._get_loop_settings(), request.settings
        if request.name in experiments_by_name():  # ready-made, not a text of a user
            return await asyncio.to_thread(self._experiments.build_plan, *arguments)
        return await self._text_work.run_for_operator(self._experiments.build_plan, *arguments)

    def _get_loop_settings(self) -> LoopSettings:
        return LoopSettings(**self._actuator.live_state.operator_tuning.settings.to_document(), seed=self._seed)


def _list_experiment_kinds(
    experiments: OwnExperiments, loop_settings: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    return list_experiment_kinds(experiments.list_definitions(), loop_settings, tuning, plant)


def _require_compilable(database: Database, parameters: PlantParameters, plan: Plan, tuning: TuningSettings) -> None:
    compile_program(make_bank_loader(database), parameters, plan, tuning)


async def _keep_tuning() -> None:
    """Keep the temporary tuning for the next run of the request."""
