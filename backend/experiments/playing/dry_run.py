"""An order played on a simulator of its own, faster than real time, before it moves anything real.

The same program, loop and evaluation as the real run; its database lives in a folder that is thrown away.
"""

import asyncio
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from backend.experiments.banks.bank_building import tuning_command
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.headless_station import headless_station
from backend.experiments.playing.play import play
from backend.experiments.playing.runner import Order, run_experiment
from backend.loop.headless import Headless
from backend.recording.reader import Envelope, read_envelope
from backend.storage import banks, open_database
from backend.storage.banks import Bank
from backend.storage.results import Result
from backend.storage.runs import Run
from plant.catalog import make_plant
from plant.choice import SIMULATOR
from plant.parameters import PlantParameters


@dataclass(frozen=True)
class DryRun:
    """How it went; ``curves`` is None when nothing was played."""

    run: Run
    result: Result | None
    curves: Envelope | None


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
            outcome = asyncio.run(run_experiment(station, order))
        with database.reading() as session:
            stored = outcome.evaluation.result
            curves = None if stored is None else read_envelope(session, outcome.run.id, points, signals)
        return DryRun(outcome.run, stored, curves)
