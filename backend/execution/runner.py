"""Runs an experiment from its order to its stored result, on the live loop or headless."""

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
from backend.banks import TuningSettings, build_tuning_command, entry_points
from backend.control import STIFFNESS_RANGE
from backend.errors import InvalidValueError, Path
from backend.execution.progress import ProgressCallback, RunPhase
from backend.experiments import (
    ExperimentError,
    ExperimentPlan,
    IdentificationPlan,
    LoopSettings,
    Plan,
    declare_choice,
    find_line,
    forecast_identifications,
    plan_values,
    read_start,
    require_reach,
)
from backend.faults import Fault
from backend.models import SETTINGS, KeptGrant, RunSettings, StoredLoopSettings, describe_values
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

# Playable ------------------------------------------------------------------------------------------
#
# The program of a plan on one plant, with the gains of every tuning that it puts into use, or why
# it cannot be.


LoadBank = Callable[[int], Bank]
"""Returns the bank of a number. Raises UnknownRecordError."""


def make_bank_loader(database: Database) -> LoadBank:
    """Return what looks banks up in a database."""

    def load_bank(number: int) -> Bank:
        with database.reading() as session:
            return banks.own(session, number)

    return load_bank


def compile_program(load_bank: LoadBank, parameters: PlantParameters, plan: Plan, tuning: TuningSettings) -> Program:
    """Return what the loop plays, begun with ``tuning``; takes a while for each change of it.

    Raises ExperimentError naming line and bound: a reference that the plant does not reach, λ that is not safe on the
    models of its bank, a bank that is not there.
    """
    program = plan.program()
    if not isinstance(plan, ExperimentPlan):
        return program
    require_measurable(plan.experiment, plan.values, plan.lines)
    require_reach(plan.laid, parameters, plan.lines)
    tunings = tuple(
        _command(load_bank, parameters, plan, choice, place)
        for place, choice in zip(plan.laid.change_places, list_plan_tunings(plan, tuning), strict=True)
    )
    return replace(program, tunings=tunings)


def list_plan_tunings(plan: Plan, tuning: TuningSettings) -> list[TuningSettings]:
    """Return the tunings that a plan which begins with ``tuning`` puts into use, in their order."""
    changes = plan.laid.changes if isinstance(plan, ExperimentPlan) else ()
    return [tuning.with_parts(change) for change in changes]


def list_plan_banks(plan: Plan) -> set[int]:
    """Return the numbers of the banks that a plan puts into use on its way."""
    changes = plan.laid.changes if isinstance(plan, ExperimentPlan) else ()
    return {int(change["bank"]) for change in changes if "bank" in change}


def _command(
    load_bank: LoadBank, parameters: PlantParameters, plan: ExperimentPlan, choice: TuningSettings, path: Path
) -> SetTuning:
    line = find_line(path, plan.lines)
    try:
        bank = load_bank(choice.bank) if choice.bank else None
        previewer = TuningPreviewer(parameters, entry_points(bank), lam_motor=choice.lam_motor, b=choice.b)
        previewer.require_safe(choice.lambdas, choice.budget)
        return build_tuning_command(parameters, choice, bank)
    except InvalidValueError as error:
        raise ExperimentError(error, path, line) from None
    except (UnknownRecordError, TuningError) as error:
        raise ExperimentError(str(error), path, line) from None


# Play ----------------------------------------------------------------------------------------------
#
# Bring the loop up and play a program to its end. The same for a live loop and a headless one.


PRETENSION_TIMEOUT_S = 120.0
TRAVEL_ALLOWANCE_S = 60.0
"""A program of identification first travels to its point; a program longer than planned by this much hangs."""

SLICE_S = 0.1
"""How often progress is told [s of loop time]."""


class NotPlayedError(SinewError):
    """The loop did not take the program, for the reason that the message says."""


class NotReadyError(SinewError):
    """The loop is in a mode that no program can start from; the message says what to do first."""

    category = ErrorCode.NOT_NOW

    def __init__(self, reason: str, mode: Mode) -> None:
        super().__init__(reason)
        self.mode = mode

    @property
    def fields(self) -> dict[str, Any]:
        """Code, and the modes that could be asked for instead."""
        return {"code": "not_ready", "legal": [str(mode) for mode in LEGAL[self.mode]]}


def current_mode(loop: LoopClient) -> Mode:
    """Return the mode of the newest sample; OFF before the first."""
    newest = loop.ring.newest()
    return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]


def require_ready(loop: LoopClient) -> None:
    """Raise NotReadyError unless a program could be started from the present mode."""
    mode = current_mode(loop)
    if mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
        raise NotReadyError("another program is being played: wait for its end or stop it", mode)
    if mode in (Mode.STOPPING, Mode.TRIPPED):
        raise NotReadyError("the loop is stopped: reset it first", mode)


async def execute_program(loop: LoopClient, program: Program, run: int, notify: ProgressCallback) -> None:
    """Play ``program`` as ``run``; where it cannot start at once, wind up to pretension first.

    How it ended, the loop has told its recorder. A program that hangs is stopped. Raises NotPlayedError where the loop
    never took it, LoopExitedError.
    """
    watch = _Watch(run)
    end_listening = loop.listen(watch.hear)
    try:
        await _start(loop, program, run, notify)
        await _until_ended(loop, program, watch, notify)
        if watch.died is not None:
            raise LoopExitedError(watch.died.reason)
    finally:
        end_listening()


async def _start(loop: LoopClient, program: Program, run: int, notify: ProgressCallback) -> None:
    """Bring the loop to where the program can start, and start it. Raises NotPlayedError."""
    mode = program_mode(program.law)
    if not may_start_from(program.law, current_mode(loop)):
        answer = await loop.send(SetMode(Mode.PRETENSION))
        if isinstance(answer, Refused):
            raise NotPlayedError(answer.reason)
    waited_s = 0.0
    while waited_s < PRETENSION_TIMEOUT_S:
        answer = await loop.send(RunProgram(program, run))
        if isinstance(answer, Accepted):
            return
        if mode not in answer.legal:  # refused for good, not only until both tendons are taut
            raise NotPlayedError(answer.reason)
        notify(RunPhase.PRETENSION, waited_s)
        await loop.advance(SLICE_S)
        waited_s += SLICE_S
    raise NotPlayedError(f"pretension was not reached within {PRETENSION_TIMEOUT_S:g} s")


async def _until_ended(loop: LoopClient, program: Program, watch: "_Watch", notify: ProgressCallback) -> None:
    start_tick = loop.ring.count
    longest_s = program.duration_s + TRAVEL_ALLOWANCE_S
    while not watch.over:
        elapsed_s = (loop.ring.count - start_tick) * T_s
        notify(RunPhase.PROGRAM, elapsed_s)
        if elapsed_s > longest_s and not watch.hung:
            watch.hung = True
            await loop.send(Stop(hard=False, detail="the program hung and was stopped"))
        await loop.advance(SLICE_S)


class _Watch:
    """Hears from the loop whether a program is over."""

    def __init__(self, run: int) -> None:
        self.hung = False
        self._run = run
        self._ended: RunEnded | None = None
        self._at_rest = False
        self.died: LoopExited | None = None

    def hear(self, event: Event | LoopExited) -> None:
        match event:
            case LoopExited():
                self.died = event
            case Stopped():
                self._at_rest = True
            case RunEnded() if event.run == self._run:
                self._ended = event

    @property
    def over(self) -> bool:
        """Whether the program has ended and, where a fault ended it, the stop is complete."""
        ended = self._ended is not None and (not isinstance(self._ended.why, Fault) or self._at_rest)
        return ended or self.died is not None


# Learning ------------------------------------------------------------------------------------------
#
# What the outside force reads with nothing outside, learned before a computed run that is to reject
# pushes.
#
# At a rig and at the dashboard a person lets go of the joint and learns; at a computed joint nobody
# leans.


POINTS = 5
"""Stiffnesses at which the bias is learned, from the lowest reference to the highest."""

LEARNED_S = 1.0
"""So long a point is learned [s]."""

_SETTLING = 6.0
"""Of the slower λ: so long the joint is left to come to rest, after the time that any way takes."""
_WAY_S = 3.0


async def learn_for(loop: object, program: Program, tuning: SetTuning) -> None:
    """Learn where a computed loop begins ``program`` with a rejection, or comes to one; a live one is left alone.

    Raises NotPlayedError where the joint could not be brought to rest for it.
    """
    rejects = any(one.k_ext > 0.0 for one in (tuning, *program.tunings))
    if not rejects or not isinstance(loop, SimulatedLoop) or loop.learned:
        return
    await _at_rest(loop)
    points = []
    for S_ref in np.linspace(*STIFFNESS_RANGE, POINTS):
        await _taken(loop, SetReferences(0.0, float(S_ref)))
        await loop.advance(_WAY_S + _SETTLING * max(tuning.lam_q, tuning.lam_S))
        await loop.advance(LEARNED_S)
        count = round(LEARNED_S / T_s)
        _, rows, _ = loop.ring.read(loop.ring.count - count, count)
        points.append((float(rows[:, INDEX["S"]].mean()), float(rows[:, INDEX["F_ext_hat"]].mean())))
    await _taken(loop, ConfigureContactDetection(tuple(points)))
    await _taken(loop, tuning)
    await _taken(loop, SetMode(Mode.PRETENSION))


async def _at_rest(loop: SimulatedLoop) -> None:
    await _taken(loop, SetMode(Mode.PRETENSION))
    waited_s = 0.0
    while isinstance(answer := await loop.send(SetMode(Mode.RUN)), Refused):
        if waited_s > PRETENSION_TIMEOUT_S:
            raise NotPlayedError(f"nothing was learned of the outside force: {answer.reason}")
        await loop.advance(SLICE_S)
        waited_s += SLICE_S


async def _taken(loop: SimulatedLoop, command: Command) -> None:
    answer = await loop.send(command)
    if not isinstance(answer, Accepted):
        raise NotPlayedError(f"nothing was learned of the outside force: {answer.reason}")


# Runner --------------------------------------------------------------------------------------------
#
# Run an experiment from order to stored result: one path for the browser and the command line, live
# and headless.
#
# What is handed over is plain data; reports are made from what is stored here.


STORING_TIMEOUT_S = 10.0
"""The recorder stores what is left of a run within a second; after this long [s] something is wrong with it."""

_LOG = logging.getLogger(__name__)
_PACKAGES = {"NumPy": "numpy", "SciPy": "scipy", "numba": "numba", "python-control": "control"}


@dataclass
class ExperimentRig:
    """Where experiments run: a loop whose samples a recorder stores in the database, and what it controls.

    ``plant`` is its ``PlantChoice.name``. ``compute`` calls a function away from the event loop: in a thread, or in
    another process where a live loop waits for this one's heartbeat, as linear algebra keeps Python's lock.
    """

    loop: LoopClient
    database: Database
    plant: str
    parameters: PlantParameters
    compute: Callable[..., Awaitable[Any]] = asyncio.to_thread


@dataclass(frozen=True)
class RunRequest:
    """What to run, with the loop settings in force, for whom."""

    plan: Plan
    loop_settings: LoopSettings
    who: str
    note: str = ""


@dataclass(frozen=True)
class RunResult:
    """The run as it ended and what was computed from it."""

    run: Run
    evaluation: Evaluation


def create_run(station: ExperimentRig, order: RunRequest) -> Run:
    """Store the run before anything moves.

    Raises NotReadyError when the loop could not start it now, OutOfRangeError where an identification would take
    joint or springs out of their range, ExperimentError for what this plant cannot play.
    """
    require_ready(station.loop)
    if isinstance(order.plan, IdentificationPlan):
        start = read_start(station.loop.ring.newest())
        told = forecast_identifications([order.plan], station.parameters, start, order.loop_settings.lam_motor)
        told.require_within_range(station.parameters)
    compile_program(make_bank_loader(station.database), station.parameters, order.plan, order.loop_settings.tuning)
    settings = RunSettings(
        plan=plan_values(order.plan),
        loop=StoredLoopSettings(**asdict(order.loop_settings)),
        declared=(*declare_choice(order.plan), *describe_values(order.loop_settings)),
        versions={"Python": platform.python_version()} | {name: version(of) for name, of in _PACKAGES.items()},
        granted=None if station.loop.granted is None else KeptGrant(**asdict(station.loop.granted)),
    )
    new = NewRun(
        kind=RunKind(order.plan.kind),
        plant=station.plant,
        parameters_name=station.parameters.name,
        parameters=station.parameters.to_document(),
        who=order.who,
        software=__version__,
        settings=SETTINGS.write(settings),
        bank_id=order.loop_settings.bank or None,
        note=order.note,
    )
    with station.database.session() as session:
        return runs.create(session, new)


async def _nothing() -> None:
    """Do nothing more when a program is over."""


async def play_and_evaluate(
    station: ExperimentRig,
    order: RunRequest,
    run: Run,
    notify: ProgressCallback,
    over: Callable[[], Awaitable[None]] = _nothing,
) -> RunResult:
    """Play an order as ``run`` and evaluate it: ``played``, then ``evaluate_closed_run``."""
    closed = await play_run(station, order, run, notify, over)
    notify(RunPhase.EVALUATION, 0.0)
    return RunResult(closed, await evaluate_closed_run(station, order.plan, closed))


async def play_run(
    station: ExperimentRig,
    order: RunRequest,
    run: Run,
    notify: ProgressCallback,
    over: Callable[[], Awaitable[None]] = _nothing,
) -> Run:
    """Play the order's program as ``run``, wait until it is stored, and return the run as it was closed.

    ``over`` is awaited then: who lent the run something takes it back. The recorder writes how it ended; what it cannot
    know of, a program that the loop never took and one that is given up here, is written by this.
    """
    try:
        tuning = order.loop_settings.tuning
        program = await asyncio.to_thread(
            compile_program, make_bank_loader(station.database), station.parameters, order.plan, tuning
        )
        bank = make_bank_loader(station.database)(tuning.bank) if tuning.bank else None
        await learn_for(station.loop, program, build_tuning_command(station.parameters, tuning, bank))
        await execute_program(station.loop, program, run.id, notify)
        closed = await _recorded(station, run.id)
    except (NotPlayedError, InvalidValueError) as refused:
        closed = _close(station, run.id, EndState.STOPPED, str(refused))
    except LoopExitedError as died:
        closed = await _recorded(station, run.id, or_else=(EndState.LINK_LOST, str(died)))
    except BaseException as error:
        _close(station, run.id, EndState.SERVICE_DIED, f"given up: {error or type(error).__name__}")
        raise
    await over()
    return closed


async def run_experiment(
    station: ExperimentRig, order: RunRequest, notify: ProgressCallback = lambda _phase, _elapsed_s: None
) -> RunResult:
    """Create the run and perform it. Raises NotReadyError."""
    return await play_and_evaluate(station, order, create_run(station, order), notify)


async def _recorded(
    station: ExperimentRig,
    run_id: int,
    or_else: tuple[EndState, str] = (EndState.SERVICE_DIED, f"its end was not recorded within {STORING_TIMEOUT_S:g} s"),
) -> Run:
    """Return the run once the recorder has stored its last samples and how it ended."""
    waited_s = 0.0
    while waited_s < STORING_TIMEOUT_S:
        with station.database.reading() as session:
            run = runs.get(session, run_id)
        if run.end_state != EndState.RUNNING:
            return run
        try:
            await station.loop.advance(SLICE_S)
        except LoopExitedError:
            await asyncio.sleep(SLICE_S)
        waited_s += SLICE_S
    return _close(station, run_id, *or_else)


async def evaluate_closed_run(station: ExperimentRig, plan: Plan, run: Run) -> Evaluation:
    """Compute and store the result of a closed run; what ended early is evaluated as incomplete.

    A run is over whatever becomes of that: where it fails, outcome and run say why, and it goes on.
    """
    try:
        evaluation: Evaluation = await station.compute(
            evaluate_finished_run, station.database, station.parameters, plan, run
        )
        return evaluation
    except Exception as error:
        _LOG.exception("The evaluation of run %s failed.", run.id)
        problem = f"{type(error).__name__}: {error}"
    except BaseException:
        _keep_problem(station, run.id, "the service ended before the run was evaluated")
        raise
    _keep_problem(station, run.id, problem)
    return Evaluation(None, None, f"it could not be evaluated: {problem}")


def _keep_problem(station: ExperimentRig, run_id: int, problem: str) -> None:
    try:
        with station.database.session() as session:
            runs.set_evaluation_problem(session, run_id, problem)
    except StorageError:
        _LOG.exception("The service could not store why run %s has no result: %s", run_id, problem)


def _close(station: ExperimentRig, run_id: int, end_state: EndState, detail: str) -> Run:
    with station.database.session() as session:
        return runs.end(session, run_id, end_state, detail)
