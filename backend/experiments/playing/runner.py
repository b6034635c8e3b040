"""Run an experiment from order to stored result: one path for the browser and the command line, live and headless.

What is handed over is plain data; reports are made from what is stored here.
"""

import asyncio
import logging
import platform
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from backend import __version__
from backend.banks.builder import tuning_command
from backend.errors import RefusedValueError
from backend.experiments.forecasts.forecast import forecast
from backend.experiments.forecasts.way import start_from
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.plan import IdentificationPlan, Plan
from backend.experiments.plans.stored_plan import declared, kept_values
from backend.experiments.playing.learning import learn_for
from backend.experiments.playing.play import SLICE_S, NotPlayedError, play, require_ready
from backend.experiments.playing.playable import banks_in, playable
from backend.experiments.playing.progress import Doing, Notify
from backend.experiments.results.evaluation import Evaluation, evaluate
from backend.models.run import SETTINGS, KeptGrant, KeptLoop, RunSettings
from backend.models.settings import declared_values
from backend.realtime.supervisor import LoopAccess, LoopDiedError
from backend.storage import runs
from backend.storage.database import Database
from backend.storage.orm import StorageError
from backend.storage.runs import EndState, NewRun, Run, RunKind
from plant.parameters import PlantParameters

STORING_TIMEOUT_S = 10.0
"""The recorder stores what is left of a run within a second; after this long [s] something is wrong with it."""

_LOG = logging.getLogger(__name__)
_PACKAGES = {"NumPy": "numpy", "SciPy": "scipy", "numba": "numba", "python-control": "control"}


@dataclass
class Station:
    """Where experiments run: a loop whose samples a recorder stores in the database, and what it controls.

    ``plant`` is its ``PlantChoice.name``. ``compute`` calls a function away from the event loop: in a thread, or in
    another process where a live loop waits for this one's heartbeat, as linear algebra keeps Python's lock.
    """

    loop: LoopAccess
    database: Database
    plant: str
    parameters: PlantParameters
    compute: Callable[..., Awaitable[Any]] = asyncio.to_thread


@dataclass(frozen=True)
class Order:
    """What to run, with the loop settings in force, for whom."""

    plan: Plan
    loop_settings: LoopSettings
    who: str
    note: str = ""


@dataclass(frozen=True)
class Outcome:
    """The run as it ended and what was computed from it."""

    run: Run
    evaluation: Evaluation


def create_run(station: Station, order: Order) -> Run:
    """Store the run before anything moves.

    Raises NotReadyError when the loop could not start it now, OutOfRangeError where an identification would take
    joint or springs out of their range, ExperimentError for what this plant cannot play.
    """
    require_ready(station.loop)
    if isinstance(order.plan, IdentificationPlan):
        start = start_from(station.loop.ring.newest())
        told = forecast([order.plan], station.parameters, start, order.loop_settings.lam_motor)
        told.require_within_range(station.parameters)
    playable(banks_in(station.database), station.parameters, order.plan, order.loop_settings.tuning)
    settings = RunSettings(
        plan=kept_values(order.plan),
        loop=KeptLoop(**asdict(order.loop_settings)),
        declared=(*declared(order.plan), *declared_values(order.loop_settings)),
        versions={"Python": platform.python_version()} | {name: version(of) for name, of in _PACKAGES.items()},
        granted=None if station.loop.granted is None else KeptGrant(**asdict(station.loop.granted)),
    )
    new = NewRun(
        kind=RunKind(order.plan.kind),
        plant=station.plant,
        parameters_name=station.parameters.name,
        parameters=station.parameters.document(),
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


async def perform(
    station: Station, order: Order, run: Run, notify: Notify, over: Callable[[], Awaitable[None]] = _nothing
) -> Outcome:
    """Play an order as ``run`` and evaluate it: ``played``, then ``evaluated``."""
    closed = await played(station, order, run, notify, over)
    notify(Doing.EVALUATION, 0.0)
    return Outcome(closed, await evaluated(station, order.plan, closed))


async def played(
    station: Station, order: Order, run: Run, notify: Notify, over: Callable[[], Awaitable[None]] = _nothing
) -> Run:
    """Play the order's program as ``run``, wait until it is stored, and return the run as it was closed.

    ``over`` is awaited then: who lent the run something takes it back. The recorder writes how it ended; what it cannot
    know of, a program that the loop never took and one that is given up here, is written by this.
    """
    try:
        tuning = order.loop_settings.tuning
        program = await asyncio.to_thread(playable, banks_in(station.database), station.parameters, order.plan, tuning)
        bank = banks_in(station.database)(tuning.bank) if tuning.bank else None
        await learn_for(station.loop, program, tuning_command(station.parameters, tuning, bank))
        await play(station.loop, program, run.id, notify)
        closed = await _recorded(station, run.id)
    except (NotPlayedError, RefusedValueError) as refused:
        closed = _close(station, run.id, EndState.STOPPED, str(refused))
    except LoopDiedError as died:
        closed = await _recorded(station, run.id, or_else=(EndState.LINK_LOST, str(died)))
    except BaseException as error:
        _close(station, run.id, EndState.SERVICE_DIED, f"given up: {error or type(error).__name__}")
        raise
    await over()
    return closed


async def run_experiment(station: Station, order: Order, notify: Notify = lambda _phase, _elapsed_s: None) -> Outcome:
    """Create the run and perform it. Raises NotReadyError."""
    return await perform(station, order, create_run(station, order), notify)


async def _recorded(
    station: Station,
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
        except LoopDiedError:
            await asyncio.sleep(SLICE_S)
        waited_s += SLICE_S
    return _close(station, run_id, *or_else)


async def evaluated(station: Station, plan: Plan, run: Run) -> Evaluation:
    """Compute and store the result of a closed run; what ended early is evaluated as incomplete.

    A run is over whatever becomes of that: where it fails, outcome and run say why, and it goes on.
    """
    try:
        evaluation: Evaluation = await station.compute(evaluate, station.database, station.parameters, plan, run)
        return evaluation
    except Exception as error:
        _LOG.exception("run %s could not be evaluated", run.id)
        problem = f"{type(error).__name__}: {error}"
    except BaseException:
        _keep_problem(station, run.id, "the service ended before the run was evaluated")
        raise
    _keep_problem(station, run.id, problem)
    return Evaluation(None, None, f"it could not be evaluated: {problem}")


def _keep_problem(station: Station, run_id: int, problem: str) -> None:
    try:
        with station.database.session() as session:
            runs.set_evaluation_problem(session, run_id, problem)
    except StorageError:
        _LOG.exception("why run %s has no result could not be kept: %s", run_id, problem)


def _close(station: Station, run_id: int, end_state: EndState, detail: str) -> Run:
    with station.database.session() as session:
        return runs.end(session, run_id, end_state, detail)
