"""Runs an experiment from its request to its stored result, on the live loop or headless."""

import asyncio
import logging
import platform
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from backend import __version__
from backend.analysis import Evaluation, evaluate_finished_run, require_measurable
from backend.banks import TuningSettings, build_tuning_command, list_point_models
from backend.control import STIFFNESS_RANGE
from backend.errors import InvalidValueError, Path
from backend.execution import messages
from backend.execution.progress import ProgressCallback, RunPhase
from backend.experiments import (
    ExperimentError,
    ExperimentPlan,
    IdentificationPlan,
    LoopSettings,
    Plan,
    describe_plan_values,
    find_line,
    forecast_identifications,
    list_stored_values,
    read_initial_state,
    require_reach,
)
from backend.faults import Fault
from backend.models import SETTINGS, RunSettings, StoredLoopSettings, StoredRealTimeStatus, describe_values
from backend.realtime import (
    LEGAL,
    MODES,
    Accepted,
    Command,
    ConfigureContactDetection,
    Event,
    LoopClient,
    LoopExited,
    LoopExitedError,
    Mode,
    Program,
    Refused,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    SetTuning,
    SimulatedLoop,
    Stop,
    Stopped,
    may_start_from,
    program_mode,
)
from backend.sample import INDEX
from backend.storage import (
    Bank,
    Database,
    EndState,
    NewRun,
    Run,
    RunKind,
    StorageError,
    UnknownRecordError,
    banks,
    runs,
)
from backend.tuning import TuningError, TuningPreviewer
from plant import ErrorCode, PlantParameters, SinewError, T_s

# Compilation ---------------------------------------------------------------------------------------
# The program of a plan for one plant, with the gains of every tuning that the plan applies.


LoadBank = Callable[[int], Bank]
"""Returns the bank with a number. Raises UnknownRecordError."""


def make_bank_loader(database: Database) -> LoadBank:
    """Return a function that loads banks from a database."""

    def load_bank(number: int) -> Bank:
        with database.reading() as session:
            return banks.own(session, number)

    return load_bank


def compile_program(load_bank: LoadBank, parameters: PlantParameters, plan: Plan, tuning: TuningSettings) -> Program:
    """Return the program of a plan that starts with ``tuning``; each change of tuning costs computing time.

    Raises ExperimentError with line and bound: for an unreachable reference, an unsafe λ, an unknown bank.
    """
    program = plan.program()
    if not isinstance(plan, ExperimentPlan):
        return program
    require_measurable(plan.experiment, plan.values, plan.lines)
    require_reach(plan.compiled, parameters, plan.lines)
    tunings = tuple(
        _build_change_command(load_bank, parameters, plan, choice, index)
        for index, choice in zip(plan.compiled.change_paths, list_plan_tunings(plan, tuning), strict=True)
    )
    return replace(program, tunings=tunings)


def list_plan_tunings(plan: Plan, tuning: TuningSettings) -> list[TuningSettings]:
    """Return the tunings that a plan changes to, in order; ``tuning`` is the one at its start."""
    changes = plan.compiled.changes if isinstance(plan, ExperimentPlan) else ()
    return [tuning.replace_values(change) for change in changes]


def list_plan_banks(plan: Plan) -> set[int]:
    """Return the numbers of the banks that a plan changes to."""
    changes = plan.compiled.changes if isinstance(plan, ExperimentPlan) else ()
    return {int(change["bank"]) for change in changes if "bank" in change}


def _build_change_command(
    load_bank: LoadBank, parameters: PlantParameters, plan: ExperimentPlan, choice: TuningSettings, path: Path
) -> SetTuning:
    line = find_line(path, plan.lines)
    try:
        bank = load_bank(choice.bank) if choice.bank else None
        previewer = TuningPreviewer(parameters, list_point_models(bank), lam_motor=choice.lam_motor, b=choice.b)
        previewer.require_safe(choice.lambdas, choice.budget)
        return build_tuning_command(parameters, choice, bank)
    except InvalidValueError as error:
        raise ExperimentError(error, path, line) from None
    except (UnknownRecordError, TuningError) as error:
        raise ExperimentError(error.message, path, line) from None


# Execution -----------------------------------------------------------------------------------------
# Applies pretension if necessary and executes a program to its end, on a live or a headless loop.


PRETENSION_TIMEOUT_S = 120.0
TRAVEL_ALLOWANCE_S = 60.0
"""Time [s] beyond the planned duration after which a program is stopped as hung. An identification program needs some
of it, because it first moves to its operating point."""

SLICE_S = 0.1
"""Interval of progress reports [s of loop time]."""


class ProgramRejectedError(SinewError):
    """The loop rejected the program; the message gives the reason."""


class NotReadyError(SinewError):
    """The loop is in a mode from which no program can start; the message says what to do first."""

    category = ErrorCode.NOT_NOW

    def __init__(self, reason: str, mode: Mode) -> None:
        super().__init__(reason)
        self.mode = mode

    @property
    def fields(self) -> dict[str, Any]:
        """Error code, and the modes that the loop can change to."""
        return {"code": "not_ready", "legal": [str(mode) for mode in LEGAL[self.mode]]}


def current_mode(loop: LoopClient) -> Mode:
    """Return the mode of the newest sample; OFF before the first."""
    newest = loop.ring.newest()
    return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]


def require_ready(loop: LoopClient) -> None:
    """Raise NotReadyError unless a program can start from the current mode."""
    mode = current_mode(loop)
    if mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
        raise NotReadyError(messages.another_program_running(), mode)
    if mode in (Mode.STOPPING, Mode.TRIPPED):
        raise NotReadyError(messages.loop_stopped(), mode)


async def execute_program(loop: LoopClient, program: Program, run: int, notify: ProgressCallback) -> None:
    """Execute ``program`` as the run with number ``run``, after pretension if the mode requires it.

    A hung program is stopped. The recorder stores how the program ended, from an event of the loop. Raises
    ProgramRejectedError if the program did not start, LoopExitedError.
    """
    monitor = _ProgramMonitor(run)
    unsubscribe = loop.listen(monitor.on_event)
    try:
        await _start(loop, program, run, notify)
        await _wait_until_ended(loop, program, monitor, notify)
        if monitor.loop_exit is not None:
            raise LoopExitedError(monitor.loop_exit.reason)
    finally:
        unsubscribe()


async def _start(loop: LoopClient, program: Program, run: int, notify: ProgressCallback) -> None:
    """Start the program, after pretension if the mode requires it. Raises ProgramRejectedError."""
    mode = program_mode(program.law)
    if not may_start_from(program.law, current_mode(loop)):
        answer = await loop.send(SetMode(Mode.PRETENSION))
        if isinstance(answer, Refused):
            raise ProgramRejectedError(answer.reason)
    waited_s = 0.0
    while waited_s < PRETENSION_TIMEOUT_S:
        answer = await loop.send(RunProgram(program, run))
        if isinstance(answer, Accepted):
            return
        if mode not in answer.legal:  # a permanent rejection, not a wait for taut tendons
            raise ProgramRejectedError(answer.reason)
        notify(RunPhase.PRETENSION, waited_s)
        await loop.advance(SLICE_S)
        waited_s += SLICE_S
    raise ProgramRejectedError(messages.pretension_not_reached(timeout_s=PRETENSION_TIMEOUT_S))


async def _wait_until_ended(
    loop: LoopClient, program: Program, monitor: "_ProgramMonitor", notify: ProgressCallback
) -> None:
    start_tick = loop.ring.count
    longest_s = program.duration_s + TRAVEL_ALLOWANCE_S
    while not monitor.is_over:
        elapsed_s = (loop.ring.count - start_tick) * T_s
        notify(RunPhase.PROGRAM, elapsed_s)
        if elapsed_s > longest_s and not monitor.is_stop_sent:
            monitor.is_stop_sent = True
            await loop.send(Stop(hard=False, detail=messages.program_did_not_end()))
        await loop.advance(SLICE_S)


class _ProgramMonitor:
    """Determines from the loop's events whether a program has ended."""

    def __init__(self, run: int) -> None:
        self.is_stop_sent = False
        self._run = run
        self._ended: RunEnded | None = None
        self._is_stop_complete = False
        self.loop_exit: LoopExited | None = None

    def on_event(self, event: Event | LoopExited) -> None:
        match event:
            case LoopExited():
                self.loop_exit = event
            case Stopped():
                self._is_stop_complete = True
            case RunEnded() if event.run == self._run:
                self._ended = event

    @property
    def is_over(self) -> bool:
        """Whether the program has ended and, if a fault ended it, the stop is complete."""
        ended = self._ended is not None and (not isinstance(self._ended.why, Fault) or self._is_stop_complete)
        return ended or self.loop_exit is not None


# Bias of the external force ------------------------------------------------------------------------
# Before a simulated run with disturbance rejection, the bias of the estimated external force is
# calibrated automatically: nothing touches a simulated joint. On a rig a person starts the
# calibration after letting go of the joint.


BIAS_POINTS = 5
"""Number of stiffnesses at which the bias is measured, from the lowest to the highest reference."""

BIAS_AVERAGING_S = 1.0
"""Averaging time at each stiffness [s]."""

_SETTLING_TIME_CONSTANTS = 6.0  # settling time in units of the slower λ, after _MOVE_TIME_S
_MOVE_TIME_S = 3.0  # longest motion between two stiffnesses


async def calibrate_force_bias(loop: object, program: Program, tuning: SetTuning) -> None:
    """Calibrate the bias of the external force if a simulated loop needs it for ``program``.

    It is needed if the initial ``tuning`` or one of the program uses disturbance rejection. A live loop is not changed.
    Raises ProgramRejectedError if the joint did not come to rest.
    """
    rejects = any(item.k_ext > 0.0 for item in (tuning, *program.tunings))
    if not rejects or not isinstance(loop, SimulatedLoop) or loop.has_bias:
        return
    await _enter_run_mode(loop)
    points = []
    for S_ref in np.linspace(*STIFFNESS_RANGE, BIAS_POINTS):
        await _require_accepted(loop, SetReferences(0.0, float(S_ref)))
        await loop.advance(_MOVE_TIME_S + _SETTLING_TIME_CONSTANTS * max(tuning.lam_q, tuning.lam_S))
        await loop.advance(BIAS_AVERAGING_S)
        count = round(BIAS_AVERAGING_S / T_s)
        _, rows, _ = loop.ring.read(loop.ring.count - count, count)
        points.append((float(rows[:, INDEX["S"]].mean()), float(rows[:, INDEX["F_ext_hat"]].mean())))
    await _require_accepted(loop, ConfigureContactDetection(tuple(points)))
    await _require_accepted(loop, tuning)
    await _require_accepted(loop, SetMode(Mode.PRETENSION))


async def _enter_run_mode(loop: SimulatedLoop) -> None:
    await _require_accepted(loop, SetMode(Mode.PRETENSION))
    waited_s = 0.0
    while isinstance(answer := await loop.send(SetMode(Mode.RUN)), Refused):
        if waited_s > PRETENSION_TIMEOUT_S:
            raise ProgramRejectedError(messages.force_bias_not_calibrated(reason=answer.reason))
        await loop.advance(SLICE_S)
        waited_s += SLICE_S


async def _require_accepted(loop: SimulatedLoop, command: Command) -> None:
    answer = await loop.send(command)
    if not isinstance(answer, Accepted):
        raise ProgramRejectedError(messages.force_bias_not_calibrated(reason=answer.reason))


# Runner --------------------------------------------------------------------------------------------
# From request to stored result, for page and command line, live and headless. Reports are made from
# what is stored here.


STORING_TIMEOUT_S = 10.0
"""Time [s] within which the recorder must store the end of a run; it normally takes less than 1 s."""

_LOG = logging.getLogger(__name__)
_PACKAGES = {"NumPy": "numpy", "SciPy": "scipy", "numba": "numba", "python-control": "control"}


@dataclass
class ExperimentRig:
    """A control loop, the database in which a recorder stores its samples, and the plant.

    ``plant`` is its ``PlantChoice.name``. ``compute`` calls a function outside the event loop: in a thread, or, with a
    live loop, in another process, because linear algebra holds the interpreter lock and would delay the heartbeat.
    """

    loop: LoopClient
    database: Database
    plant: str
    parameters: PlantParameters
    compute: Callable[..., Awaitable[Any]] = asyncio.to_thread


@dataclass(frozen=True)
class RunRequest:
    """Plan to execute, the settings of the loop, and the author."""

    plan: Plan
    loop_settings: LoopSettings
    who: str
    note: str = ""


@dataclass(frozen=True)
class RunResult:
    """The closed run and its evaluation."""

    run: Run
    evaluation: Evaluation


def create_run(rig: ExperimentRig, request: RunRequest) -> Run:
    """Check the request and store its run, before any motion.

    Raises NotReadyError if the loop cannot start it now, OutOfRangeError if an identification would move joint or
    springs out of their range, ExperimentError if this plant cannot execute the experiment.
    """
    require_ready(rig.loop)
    if isinstance(request.plan, IdentificationPlan):
        start = read_initial_state(rig.loop.ring.newest())
        forecast = forecast_identifications([request.plan], rig.parameters, start, request.loop_settings.lam_motor)
        forecast.require_within_range(rig.parameters)
    compile_program(make_bank_loader(rig.database), rig.parameters, request.plan, request.loop_settings.tuning)
    settings = RunSettings(
        plan=list_stored_values(request.plan),
        loop=StoredLoopSettings(**asdict(request.loop_settings)),
        declared=(*describe_plan_values(request.plan), *describe_values(request.loop_settings)),
        versions={"Python": platform.python_version()}
        | {name: version(package) for name, package in _PACKAGES.items()},
        granted=None if rig.loop.granted is None else StoredRealTimeStatus(**asdict(rig.loop.granted)),
    )
    new = NewRun(
        kind=RunKind(request.plan.kind),
        plant=rig.plant,
        parameters_name=rig.parameters.name,
        parameters=rig.parameters.to_document(),
        who=request.who,
        software=__version__,
        settings=SETTINGS.write(settings),
        bank_id=request.loop_settings.bank or None,
        note=request.note,
    )
    with rig.database.session() as session:
        return runs.create(session, new)


async def _do_nothing() -> None:
    """Do nothing."""


async def execute_and_evaluate(
    rig: ExperimentRig,
    request: RunRequest,
    run: Run,
    notify: ProgressCallback,
    release: Callable[[], Awaitable[None]] = _do_nothing,
) -> RunResult:
    """Execute a request as ``run`` and evaluate it; the arguments are those of ``execute_run``."""
    closed = await execute_run(rig, request, run, notify, release)
    notify(RunPhase.EVALUATION, 0.0)
    return RunResult(closed, await evaluate_closed_run(rig, request.plan, closed))


async def execute_run(
    rig: ExperimentRig,
    request: RunRequest,
    run: Run,
    notify: ProgressCallback,
    release: Callable[[], Awaitable[None]] = _do_nothing,
) -> Run:
    """Execute a request as ``run``, wait until all samples are stored, and return the closed run.

    The recorder stores how the program ended. This function stores what the recorder cannot know: a rejected program,
    and a run that is cancelled here. ``release`` is awaited after the end, to restore what was changed for the run.
    """
    try:
        tuning = request.loop_settings.tuning
        program = await asyncio.to_thread(
            compile_program, make_bank_loader(rig.database), rig.parameters, request.plan, tuning
        )
        bank = make_bank_loader(rig.database)(tuning.bank) if tuning.bank else None
        await calibrate_force_bias(rig.loop, program, build_tuning_command(rig.parameters, tuning, bank))
        await execute_program(rig.loop, program, run.id, notify)
        closed = await _wait_until_recorded(rig, run.id)
    except (ProgramRejectedError, InvalidValueError) as error:
        closed = _close_run(rig, run.id, EndState.STOPPED, str(error))
    except LoopExitedError as loop_exit:
        closed = await _wait_until_recorded(rig, run.id, fallback=(EndState.LINK_LOST, str(loop_exit)))
    except BaseException as error:
        _close_run(rig, run.id, EndState.SERVICE_DIED, messages.run_aborted(error=str(error) or type(error).__name__))
        raise
    await release()
    return closed


async def run_experiment(
    rig: ExperimentRig, request: RunRequest, notify: ProgressCallback = lambda _phase, _elapsed_s: None
) -> RunResult:
    """Create, execute and evaluate a run. Raises NotReadyError, OutOfRangeError, ExperimentError."""
    return await execute_and_evaluate(rig, request, create_run(rig, request), notify)


async def _wait_until_recorded(
    rig: ExperimentRig,
    run_id: int,
    fallback: tuple[EndState, str] = (
        EndState.SERVICE_DIED,
        messages.end_not_recorded(timeout_s=STORING_TIMEOUT_S),
    ),
) -> Run:
    """Return the run after the recorder has closed it; close it as ``fallback`` after STORING_TIMEOUT_S."""
    waited_s = 0.0
    while waited_s < STORING_TIMEOUT_S:
        with rig.database.reading() as session:
            run = runs.get(session, run_id)
        if run.end_state != EndState.RUNNING:
            return run
        try:
            await rig.loop.advance(SLICE_S)
        except LoopExitedError:
            await asyncio.sleep(SLICE_S)
        waited_s += SLICE_S
    return _close_run(rig, run_id, *fallback)


async def evaluate_closed_run(rig: ExperimentRig, plan: Plan, run: Run) -> Evaluation:
    """Compute and store the result of a closed run; a run that ended early is marked as incomplete.

    An evaluation that fails does not raise: the returned evaluation and the stored run contain the reason.
    """
    try:
        evaluation: Evaluation = await rig.compute(evaluate_finished_run, rig.database, rig.parameters, plan, run)
        return evaluation
    except Exception as error:
        _LOG.exception("The evaluation of run %s failed.", run.id)
        problem = f"{type(error).__name__}: {error}"
    except BaseException:
        _store_problem(rig, run.id, messages.service_ended_before_evaluation())
        raise
    _store_problem(rig, run.id, problem)
    return Evaluation(None, None, messages.run_not_evaluated(reason=problem))


def _store_problem(rig: ExperimentRig, run_id: int, problem: str) -> None:
    try:
        with rig.database.session() as session:
            runs.set_evaluation_problem(session, run_id, problem)
    except StorageError:
        _LOG.exception("The service could not store why run %s has no result: %s", run_id, problem)


def _close_run(rig: ExperimentRig, run_id: int, end_state: EndState, detail: str) -> Run:
    with rig.database.session() as session:
        return runs.end(session, run_id, end_state, detail)
