"""Experiments played on a simulator beside the service: one after the other, in a process of their own.

Who asks for many of them waits for oneself only: reports, exports and evaluations have other processes.
"""

import asyncio
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import mkdtemp

from backend.archive.views import dry_run_view
from backend.auth.authentication import Person
from backend.departure import HasLeft, unless_left
from backend.errors import require_within
from backend.execution.runner import Doing, Order
from backend.execution.simulation import dry_run, get_ready, progress_in
from backend.experiments.library import values_of
from backend.experiments.plans import LoopSettings
from backend.operating.kept_figures import KeptFigures
from backend.operating.work_places import WorkPlaces
from backend.schemas.experiment import DryRunProgress, DryRunView
from backend.storage.banks import Bank
from backend.workers import Offload
from plant.parameters import PlantParameters

SIGNALS = ("q", "q_ref", "S", "S_ref", "F_A", "F_B", "u_A", "u_B")
POINTS = 1200

LONGEST_S = 600.0
"""Longest program that is played dry [s]. What is longer is played with ``sinew experiment``."""

PLACES = 4
"""Dry runs under way or waiting."""

VIEWERS_PLACES = 2
"""So many of them for viewers, so that an operator always finds one."""


class DryRuns:
    """One dry run per person, PLACES in all. Belongs to the service's event loop."""

    def __init__(self, offload: Offload) -> None:
        self._offload = offload
        self.places = WorkPlaces("a dry run", "dry runs", PLACES, VIEWERS_PLACES, each=1)
        self._under_way: dict[Person, tuple[Path, float]] = {}

    def get_ready(self, parameters: PlantParameters, settings: LoopSettings) -> None:
        """Let the process load what a dry run takes, once, so that the first one is as soon there as those after it."""
        self._offload.begin(_get_ready, parameters, settings)

    async def progress(self, person: Person) -> DryRunProgress:
        """Return how far the dry run of a person is."""
        if person not in self._under_way:
            return DryRunProgress(under_way=False, doing=Doing.STARTING, played_s=0.0, duration_s=0.0)
        folder, duration_s = self._under_way[person]
        doing, elapsed_s = await asyncio.to_thread(progress_in, folder)
        played_s = {Doing.PROGRAM: min(elapsed_s, duration_s), Doing.EVALUATION: duration_s}.get(doing, 0.0)
        return DryRunProgress(under_way=True, doing=doing, played_s=played_s, duration_s=duration_s)

    async def play(
        self,
        parameters: PlantParameters,
        order: Order,
        used: Sequence[Bank],
        person: Person,
        has_left: HasLeft,
    ) -> DryRunView:
        """Play an order with the banks that it uses, until whoever asked has left.

        Raises OutOfRangeError when it takes too long, RefusalError where there is no place, WorkerDiedError.
        """
        duration_s = order.plan.program().duration_s
        remedy = "play it with `sinew experiment` on the command line"
        require_within("duration_s", duration_s, None, LONGEST_S, "s", remedy, words="length of a dry run", path=())
        with self.places.held(person):
            folder = await asyncio.to_thread(mkdtemp, prefix="sinew-dry-run-")
            self._under_way[person] = Path(folder), duration_s
            try:
                played = await unless_left(
                    self._offload.run(dry_run, parameters, order, used, SIGNALS, POINTS, Path(folder)), has_left
                )
            finally:
                self._under_way.pop(person, None)
                # Here, not in the process: one that is killed clears up nothing.
                shutil.rmtree(folder, ignore_errors=True)
        settings = {**values_of(order.plan), **asdict(order.loop_settings)}
        return dry_run_view(played.run, played.result, played.curves, duration_s, settings)


def _get_ready(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Take over what was computed for a tuning before, which loads half of SciPy, and load the rest."""
    KeptFigures().restore()
    get_ready(parameters, settings)
