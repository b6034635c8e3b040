"""Experiments on a simulator faster than real time: headless stations, dry runs, points of studies."""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backend.analysis import EvaluationContext, NoSamplesError, evaluate_experiment
from backend.banks import build_tuning_command, entry_points
from backend.execution.progress import RunPhase
from backend.execution.runner import (
    ExperimentRig,
    LoadBank,
    RunRequest,
    compile_program,
    execute_program,
    learn_for,
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

# Headless station ----------------------------------------------------------------------------------
#
# A station stepped as fast as it goes, on what waits for its writes: for the command line, for dry
# runs, for tests.


@contextmanager
def open_headless_station(
    database: Database, parameters: PlantParameters, settings: LoopSettings, plant: PlantChoice = SIMULATOR
) -> Iterator[ExperimentRig]:
    """Give an actuator that is computed, with a recorder, set to ``settings``; let go of it at the end of the block.

    Raises PlantError for a ``plant`` that moves by itself, UnknownRecordError for a bank that is not there,
    OutOfRangeError for λ that is not safe on its models.
    """
    bank = make_bank_loader(database)(settings.bank) if settings.bank else None
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain_what_is_worth_it()

    loop = headless_loop(parameters, settings, bank, record, plant)
    recorder = Recorder(database, loop.ring)
    recorders.append(recorder)
    loop.listen(recorder.on_event)
    try:
        yield ExperimentRig(loop, database, plant.name, parameters)
    finally:
        loop.close()
        recorder.close()


def headless_loop(
    parameters: PlantParameters,
    settings: LoopSettings,
    bank: Bank | None,
    each_batch: Callable[[Ring], None],
    plant: PlantChoice = SIMULATOR,
) -> SimulatedLoop:
    """Return a loop on a computed actuator, set to ``settings``; ``each_batch`` sees its samples as they come.

    Raises PlantError for a ``plant`` that moves by itself, OutOfRangeError for λ that is not safe.
    """
    previewer = TuningPreviewer(parameters, entry_points(bank), lam_motor=settings.lam_motor, b=settings.b)
    previewer.require_safe(settings.lambdas, settings.budget)
    made = make_plant(plant, parameters, settings.seed)
    if not made.stepped:
        raise PlantError(f"{plant.name}: it runs in real time, start experiments from the dashboard of sinew serve")
    return SimulatedLoop(made, parameters, build_tuning_command(parameters, settings, bank), each_batch)


# Dry run -------------------------------------------------------------------------------------------
#
# An order played on a simulator of its own, faster than real time, before it moves anything real.
#
# The same program, loop and evaluation as the real run; its database lives in a folder that is
# thrown away.


_PROGRESS = "progress"
_TOLD_EVERY_S = 0.5
"""How often progress is written [s of loop time], which passes many times faster."""


@dataclass(frozen=True)
class DryRun:
    """How it went; ``curves`` is None when nothing was played."""

    run: Run
    result: Result | None
    curves: SampleEnvelope | None


def warm_up_dry_run(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Play the shortest tracking there is and keep nothing of it: what a dry run takes is loaded then."""
    shortest = build_ready_plan("tracking", q_duration_s=0.5, S_duration_s=0.5)
    tuning = build_tuning_command(parameters, replace(settings, bank=0), None)
    with closing(SimulatedLoop(make_plant(SIMULATOR, parameters, 0), parameters, tuning)) as loop:
        asyncio.run(execute_program(loop, shortest.program(), 1, lambda _phase, _elapsed_s: None))


def dry_run(
    parameters: PlantParameters,
    order: RunRequest,
    used: Sequence[Bank],
    signals: Sequence[str],
    points: int,
    folder: Path,
) -> DryRun:
    """Play ``order`` with the models of the banks that it uses; its result with ``points`` buckets of ``signals``.

    ``folder`` takes the database, where the banks have the numbers that they have; whoever gives it throws it away.

    Raises OutOfRangeError for λ that is not safe on these models.
    """
    with closing(open_database(folder)) as database:
        with database.session() as session:
            for bank in used:
                entries = [replace(entry, identification_id=None) for entry in bank.entries]
                banks.add(session, bank.name, entries, bank.who, number=bank.id)
        with open_headless_station(database, parameters, order.loop_settings) as station:
            outcome = asyncio.run(run_experiment(station, order, _Progress(folder)))
        with database.reading() as session:
            stored = outcome.evaluation.result
            curves = None if stored is None else read_envelope(session, outcome.run.id, points, signals)
        return DryRun(outcome.run, stored, curves)


class _Progress:
    """Writes how far a dry run is into its folder, where the service reads it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._told: tuple[RunPhase, int] | None = None

    def __call__(self, doing: RunPhase, elapsed_s: float) -> None:
        now = doing, int(elapsed_s / _TOLD_EVERY_S)
        if now == self._told:
            return
        self._told = now
        being_written = self._folder / f"{_PROGRESS}.new"
        being_written.write_text(f"{doing} {elapsed_s:.3f}", encoding="utf-8")
        os.replace(being_written, self._folder / _PROGRESS)


def read_progress(folder: Path) -> tuple[RunPhase, float]:
    """Return what a dry run does in this folder, and for how long [s of loop time]."""
    try:
        doing, elapsed_s = (folder / _PROGRESS).read_text(encoding="utf-8").split()
    except OSError:  # nothing is told yet, or it is over and the folder is gone
        return RunPhase.STARTING, 0.0
    return RunPhase(doing), float(elapsed_s)


# In memory -----------------------------------------------------------------------------------------
#
# An experiment played on a simulator of its own and measured, with nothing stored: the row of a
# study.
#
# The same loop, program and evaluation as a run that is stored, of samples as a recording keeps
# them, so that the figures are the same to the last digit.


_RUN = 1
_AT_ONCE = 100_000


@dataclass(frozen=True)
class SimulatedRun:
    """How it ended, ``end_state`` an ``EndState`` value, what was recorded, measured and judged."""

    end_state: str
    end_detail: str
    metrics: Metrics
    criteria: tuple[RunCriterion, ...]
    columns: Columns


def play_in_memory(
    parameters: PlantParameters, plan: ExperimentPlan, settings: LoopSettings, load_bank: LoadBank
) -> SimulatedRun:
    """Play a plan as ``sinew experiment`` would, and measure it; ``end_detail`` also says why nothing was measured.

    Raises OutOfRangeError for λ that is not safe, ExperimentError for what this plant cannot play, NotPlayedError,
    UnknownRecordError for a bank that ``load_bank`` does not know.
    """
    bank = load_bank(settings.bank) if settings.bank else None
    kept = _Kept()
    with closing(headless_loop(parameters, settings, bank, kept.drain)) as loop:
        program = compile_program(load_bank, parameters, plan, settings.tuning)
        loop.listen(kept.hear)
        asyncio.run(_played(loop, program, build_tuning_command(parameters, settings, bank)))
        kept.drain(loop.ring)
    assert kept.ended is not None  # else it would still be played
    state, detail = describe_end(kept.ended)
    columns = _columns(kept.rows)
    outline = Metrics(
        complete=state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )
    in_force = EvaluationContext(parameters, plan, settings.tuning, entry_points(bank))
    try:
        metrics, criteria = evaluate_experiment(columns, in_force, outline, 0)
    except NoSamplesError as error:
        return SimulatedRun(state.value, f"{detail}: {error}" if detail else str(error), outline, (), columns)
    return SimulatedRun(state.value, detail, metrics, criteria, columns)


async def _played(loop: SimulatedLoop, program: Program, tuning: SetTuning) -> None:
    await learn_for(loop, program, tuning)
    await execute_program(loop, program, _RUN, lambda _doing, _elapsed_s: None)


class _Kept:
    """The samples of the run [n, fields of a recording], and how the loop said that it ended."""

    def __init__(self) -> None:
        self.rows: list[NDArray[np.float32]] = []
        self.ended: RunEnded | None = None
        self._position = 0

    def drain(self, ring: Ring) -> None:
        first, rows, _ = ring.read(self._position, _AT_ONCE)
        self._position = first + len(rows)
        self.rows.append(rows[rows[:, INDEX["run"]] == _RUN][:, STORED_COLUMNS].astype(np.float32))

    def hear(self, event: Event | LoopExited) -> None:
        if isinstance(event, RunEnded) and event.run == _RUN:
            self.ended = event


def _columns(rows: Sequence[NDArray[np.float32]]) -> Columns:
    table = np.concatenate(rows)
    t = np.arange(len(table), dtype=np.float64) * T_s
    return {"t": t} | {name: table[:, place].astype(np.float64) for place, name in enumerate(STORED_NAMES)}
