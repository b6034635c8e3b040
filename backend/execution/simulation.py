"""Executes experiments on a simulator, faster than real time: headless, as dry runs, for studies."""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backend.analysis import EvaluationContext, NoSamplesError, evaluate_experiment
from backend.banks import build_tuning_command, list_point_models
from backend.execution import messages
from backend.execution.progress import RunPhase
from backend.execution.runner import (
    ExperimentRig,
    LoadBank,
    RunRequest,
    calibrate_force_bias,
    compile_program,
    execute_program,
    make_bank_loader,
    run_experiment,
)
from backend.experiments import ExperimentPlan, LoopSettings, build_ready_plan
from backend.models import Metrics, RunCriterion
from backend.realtime import Event, LoopExited, Program, Ring, RunEnded, SetTuning, SimulatedLoop
from backend.recording import Columns, Recorder, SampleEnvelope, describe_end, read_envelope
from backend.sample import INDEX, STORED_COLUMNS, STORED_NAMES
from backend.storage import Bank, Database, EndState, Result, Run, banks, open_database
from backend.tuning import TuningPreviewer
from plant import SIMULATOR, PlantChoice, PlantError, PlantParameters, T_s, make_plant

# Headless rig --------------------------------------------------------------------------------------
# A simulated plant that is stepped as fast as possible, for the command line, dry runs and tests.


@contextmanager
def open_headless_rig(
    database: Database, parameters: PlantParameters, settings: LoopSettings, plant: PlantChoice = SIMULATOR
) -> Iterator[ExperimentRig]:
    """Open a simulated actuator with control loop and recorder; close it at the end of the block.

    Raises PlantError for a ``plant`` that runs in real time, UnknownRecordError for an unknown bank, OutOfRangeError
    for an unsafe λ.
    """
    bank = make_bank_loader(database)(settings.bank) if settings.bank else None
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain_if_due()

    loop = make_headless_loop(parameters, settings, bank, record, plant)
    recorder = Recorder(database, loop.ring)
    recorders.append(recorder)
    loop.listen(recorder.on_event)
    try:
        yield ExperimentRig(loop, database, plant.name, parameters)
    finally:
        loop.close()
        recorder.close()


def make_headless_loop(
    parameters: PlantParameters,
    settings: LoopSettings,
    bank: Bank | None,
    on_batch: Callable[[Ring], None],
    plant: PlantChoice = SIMULATOR,
) -> SimulatedLoop:
    """Return a control loop on a simulated actuator; ``on_batch`` is called after each batch of samples.

    Raises PlantError for a ``plant`` that runs in real time, OutOfRangeError for an unsafe λ.
    """
    previewer = TuningPreviewer(parameters, list_point_models(bank), lam_motor=settings.lam_motor, b=settings.b)
    previewer.require_safe(settings.lambdas, settings.budget)
    actuator = make_plant(plant, parameters, settings.seed)
    if not actuator.stepped:
        raise PlantError(messages.plant_runs_in_real_time(plant=plant.name))
    return SimulatedLoop(actuator, parameters, build_tuning_command(parameters, settings, bank), on_batch)


# Dry run -------------------------------------------------------------------------------------------
# A request executed on a simulator of its own before the real run, with the same program, loop and
# evaluation. Its database is in a temporary folder.


_PROGRESS = "progress"
_PROGRESS_INTERVAL_S = 0.5
"""Interval at which progress is written [s of loop time]."""


@dataclass(frozen=True)
class DryRun:
    """Run, result and curves of a dry run; result and curves are None if the evaluation failed."""

    run: Run
    result: Result | None
    curves: SampleEnvelope | None


def warm_up_dry_run(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Execute a short experiment and discard it, so that everything that a dry run needs is loaded."""
    shortest = build_ready_plan("tracking", q_duration_s=0.5, S_duration_s=0.5)
    tuning = build_tuning_command(parameters, replace(settings, bank=0), None)
    with closing(SimulatedLoop(make_plant(SIMULATOR, parameters, 0), parameters, tuning)) as loop:
        asyncio.run(execute_program(loop, shortest.program(), 1, lambda _phase, _elapsed_s: None))


def dry_run(
    parameters: PlantParameters,
    request: RunRequest,
    used_banks: Sequence[Bank],
    signals: Sequence[str],
    points: int,
    folder: Path,
) -> DryRun:
    """Execute a request on a simulator and return its result and curves.

    The curves have ``points`` buckets of ``signals``. ``used_banks`` are all banks of the request; they keep their
    numbers. The database is created in ``folder``, which the caller deletes. Raises OutOfRangeError for an unsafe λ.
    """
    with closing(open_database(folder)) as database:
        with database.session() as session:
            for bank in used_banks:
                entries = [replace(entry, identification_id=None) for entry in bank.entries]
                banks.add(session, bank.name, entries, bank.who, number=bank.id)
        with open_headless_rig(database, parameters, request.loop_settings) as rig:
            result = asyncio.run(run_experiment(rig, request, _ProgressFile(folder)))
        with database.reading() as session:
            stored = result.evaluation.result
            curves = None if stored is None else read_envelope(session, result.run.id, points, signals)
        return DryRun(result.run, stored, curves)


class _ProgressFile:
    """Progress callback that writes a file for ``read_progress``, as a dry run is in another process."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._last_written: tuple[RunPhase, int] | None = None

    def __call__(self, phase: RunPhase, elapsed_s: float) -> None:
        now = phase, int(elapsed_s / _PROGRESS_INTERVAL_S)
        if now == self._last_written:
            return
        self._last_written = now
        temporary = self._folder / f"{_PROGRESS}.new"
        temporary.write_text(f"{phase} {elapsed_s:.3f}", encoding="utf-8")
        os.replace(temporary, self._folder / _PROGRESS)


def read_progress(folder: Path) -> tuple[RunPhase, float]:
    """Return the phase of the dry run in a folder, and its duration so far [s of loop time]."""
    try:
        phase, elapsed_s = (folder / _PROGRESS).read_text(encoding="utf-8").split()
    except OSError:  # not written yet, or the run has ended and the folder is deleted
        return RunPhase.STARTING, 0.0
    return RunPhase(phase), float(elapsed_s)


# In memory -----------------------------------------------------------------------------------------
# An experiment that is simulated and evaluated without a database, for studies. Samples have the
# precision of a recording, so the metrics are identical to those of a stored run.


_RUN = 1
_MAX_ROWS = 100_000


@dataclass(frozen=True)
class SimulatedRun:
    """End, metrics, criteria and samples of a simulated run; ``end_state`` is an ``EndState`` value."""

    end_state: str
    end_detail: str
    metrics: Metrics
    criteria: tuple[RunCriterion, ...]
    columns: Columns


def simulate_in_memory(
    parameters: PlantParameters, plan: ExperimentPlan, settings: LoopSettings, load_bank: LoadBank
) -> SimulatedRun:
    """Execute and evaluate a plan as ``sinew experiment`` does, without storing it.

    ``end_detail`` also gives the reason of a failed evaluation. Raises OutOfRangeError for an unsafe λ, ExperimentError
    if this plant cannot execute the plan, ProgramRejectedError, UnknownRecordError for an unknown bank.
    """
    bank = load_bank(settings.bank) if settings.bank else None
    recorder = _MemoryRecorder()
    with closing(make_headless_loop(parameters, settings, bank, recorder.drain)) as loop:
        program = compile_program(load_bank, parameters, plan, settings.tuning)
        loop.listen(recorder.on_event)
        asyncio.run(_execute(loop, program, build_tuning_command(parameters, settings, bank)))
        recorder.drain(loop.ring)
    assert recorder.ended is not None  # execute_program returns only after this event
    state, detail = describe_end(recorder.ended)
    columns = _build_columns(recorder.rows)
    outline = Metrics(
        complete=state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )
    context = EvaluationContext(parameters, plan, settings.tuning, list_point_models(bank))
    try:
        metrics, criteria = evaluate_experiment(columns, context, outline, 0)
    except NoSamplesError as error:
        return SimulatedRun(
            state.value, messages.end_with_reason(detail=detail, reason=error.message), outline, (), columns
        )
    return SimulatedRun(state.value, detail, metrics, criteria, columns)


async def _execute(loop: SimulatedLoop, program: Program, tuning: SetTuning) -> None:
    await calibrate_force_bias(loop, program, tuning)
    await execute_program(loop, program, _RUN, lambda _phase, _elapsed_s: None)


class _MemoryRecorder:
    """Collects the samples of the run [n, stored columns] and the event of its end."""

    def __init__(self) -> None:
        self.rows: list[NDArray[np.float32]] = []
        self.ended: RunEnded | None = None
        self._position = 0

    def drain(self, ring: Ring) -> None:
        first, rows, _ = ring.read(self._position, _MAX_ROWS)
        self._position = first + len(rows)
        self.rows.append(rows[rows[:, INDEX["run"]] == _RUN][:, STORED_COLUMNS].astype(np.float32))

    def on_event(self, event: Event | LoopExited) -> None:
        if isinstance(event, RunEnded) and event.run == _RUN:
            self.ended = event


def _build_columns(rows: Sequence[NDArray[np.float32]]) -> Columns:
    table = np.concatenate(rows)
    t = np.arange(len(table), dtype=np.float64) * T_s
    return {"t": t} | {name: table[:, index].astype(np.float64) for index, name in enumerate(STORED_NAMES)}
