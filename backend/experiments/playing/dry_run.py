"""An order played on a simulator of its own, faster than real time, before it moves anything real.

The same program, loop and evaluation as the real run; its database lives in a folder that is thrown away.
"""

import asyncio
import os
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from backend.banks.builder import tuning_command
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.headless_station import headless_station
from backend.experiments.playing.play import play
from backend.experiments.playing.progress import Doing
from backend.experiments.playing.runner import Order, run_experiment
from backend.realtime.headless import Headless
from backend.recording.reader import SampleEnvelope, read_envelope
from backend.storage import banks
from backend.storage.banks import Bank
from backend.storage.database import open_database
from backend.storage.results import Result
from backend.storage.runs import Run
from plant.factory import make_plant
from plant.interface import SIMULATOR
from plant.parameters import PlantParameters

_PROGRESS = "progress"
_TOLD_EVERY_S = 0.5
"""How often progress is written [s of loop time], which passes many times faster."""


@dataclass(frozen=True)
class DryRun:
    """How it went; ``curves`` is None when nothing was played."""

    run: Run
    result: Result | None
    curves: SampleEnvelope | None


def get_ready(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Play the shortest tracking there is and keep nothing of it: what a dry run takes is loaded then."""
    shortest = ready_plan("tracking", q_duration_s=0.5, S_duration_s=0.5)
    tuning = tuning_command(parameters, replace(settings, bank=0), None)
    with closing(Headless(make_plant(SIMULATOR, parameters, 0), parameters, tuning)) as loop:
        asyncio.run(play(loop, shortest.program(), 1, lambda _phase, _elapsed_s: None))


def dry_run(
    parameters: PlantParameters, order: Order, used: Sequence[Bank], signals: Sequence[str], points: int, folder: Path
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
        with headless_station(database, parameters, order.loop_settings) as station:
            outcome = asyncio.run(run_experiment(station, order, _Progress(folder)))
        with database.reading() as session:
            stored = outcome.evaluation.result
            curves = None if stored is None else read_envelope(session, outcome.run.id, points, signals)
        return DryRun(outcome.run, stored, curves)


class _Progress:
    """Writes how far a dry run is into its folder, where the service reads it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._told: tuple[Doing, int] | None = None

    def __call__(self, doing: Doing, elapsed_s: float) -> None:
        now = doing, int(elapsed_s / _TOLD_EVERY_S)
        if now == self._told:
            return
        self._told = now
        being_written = self._folder / f"{_PROGRESS}.new"
        being_written.write_text(f"{doing} {elapsed_s:.3f}", encoding="utf-8")
        os.replace(being_written, self._folder / _PROGRESS)


def progress_in(folder: Path) -> tuple[Doing, float]:
    """Return what a dry run does in this folder, and for how long [s of loop time]."""
    try:
        doing, elapsed_s = (folder / _PROGRESS).read_text(encoding="utf-8").split()
    except OSError:  # nothing is told yet, or it is over and the folder is gone
        return Doing.STARTING, 0.0
    return Doing(doing), float(elapsed_s)
