"""Identifications and experiments that run in this service, one at a time."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from backend.api.bench import Bench
from backend.api.errors import ApiError
from backend.api.identification_orders import plans_of, prediction_of
from backend.api.offload import Offload
from backend.api.queue import Queue
from backend.api.schemas.experiment import DryRunView, ExperimentKind, ExperimentRequest, SettingView
from backend.api.schemas.identification import IdentificationKind, IdentificationRequest, Prediction
from backend.api.schemas.state import TaskView
from backend.api.shelf import Shelf
from backend.api.stored import dry_run_view
from backend.experiments.catalogue import EXPERIMENTS, IDENTIFICATIONS, experiment
from backend.experiments.dry_run import dry_run
from backend.experiments.loop_settings import LoopSettings, split_values
from backend.experiments.plans import Plan
from backend.experiments.playing import BenchNotReadyError, require_ready
from backend.experiments.runner import Order, Station, create_run, perform
from backend.experiments.settings import Setting, SettingError, describe
from backend.storage.runs import EndState, Run

_log = logging.getLogger(__name__)

DRY_RUN_SIGNALS = ("q", "q_ref", "S", "S_ref", "F_A", "F_B", "u_A", "u_B")
DRY_RUN_POINTS = 1200


class Tasks:
    """Starts what takes its time and keeps the state informed of how far it is."""

    def __init__(
        self,
        station: Station,
        bench: Bench,
        shelf: Shelf,
        prepare_report: Callable[[], None],
        seed: int,
        offload: Offload,
    ) -> None:
        self._station = station
        self._bench = bench
        self._shelf = shelf
        self._prepare_report = prepare_report
        self._seed = seed
        self._offload = offload
        self.queue = Queue(self.start_experiment, self._order)
        self._running: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()

    def experiment_kinds(self) -> list[ExperimentKind]:
        """Return the experiments there are, with their settings and those of the loop as in force."""
        in_force = _values(self._loop_settings())
        return [
            ExperimentKind(
                name=name,
                title=entry.title,
                description=entry.description,
                duration_s=entry.plan().program().duration_s,
                settings=[
                    _setting_view(setting, in_force.get(setting.name, setting.default))
                    for setting in (*describe(entry.plan), *describe(LoopSettings))
                ],
            )
            for name, entry in EXPERIMENTS.items()
        ]

    def identification_kinds(self) -> list[IdentificationKind]:
        """Return what can be identified, with the settings of each."""
        return [
            IdentificationKind(
                kind=kind,
                title=entry.title,
                description=entry.description,
                settings=[_setting_view(setting, setting.default) for setting in describe(entry.plan)],
            )
            for kind, entry in IDENTIFICATIONS.items()
        ]

    async def start_experiment(self, request: ExperimentRequest, who: str) -> int:
        """Start an experiment and return its run. Raises ApiError, SettingError, OutOfRangeError."""
        plan, wanted = self._order(request)
        async with self._starting:
            self._require_free()
            require_ready(self._station.loop)
            if wanted != self._loop_settings():
                await self._use(wanted, who)
            return await self._start(Order(plan, wanted, who))

    async def dry_run(self, request: ExperimentRequest, who: str) -> DryRunView:
        """Play an experiment on a simulator beside this service. Raises SettingError, OutOfRangeError."""
        plan, wanted = self._order(request)
        bank = await self._shelf.stored_bank(wanted.bank) if wanted.bank else None
        order = Order(plan, wanted, who)
        played = await self._offload.run(
            dry_run, self._bench.picture.tuning.parameters, order, bank, DRY_RUN_SIGNALS, DRY_RUN_POINTS
        )
        return dry_run_view(played.run, played.result, played.curves, plan.program().duration_s)

    async def start_identification(self, request: IdentificationRequest, who: str) -> int:
        """Start an identification, or several in turn, and return the first run.

        Raises ApiError, SettingError, OutOfRangeError.
        """
        plans = plans_of(request)
        for plan in plans:
            plan.program()
        async with self._starting:
            self._require_free()
            return await self._start(*(Order(plan, self._loop_settings(), who) for plan in plans))

    async def predict_identification(self, request: IdentificationRequest) -> Prediction:
        """Tell what an identification would do to the rig. Raises SettingError, OutOfRangeError."""
        tuning = self._bench.picture.tuning
        return await asyncio.to_thread(prediction_of, request, tuning.parameters, tuning.lambdas.lam_motor)

    async def close(self, cause: str = "service ended") -> None:
        """Give up what is running; its run is closed as ended by ``cause``."""
        if self._running is not None:
            self._running.cancel(cause)
            await asyncio.gather(self._running, return_exceptions=True)

    def _require_free(self) -> None:
        task = self._bench.picture.task
        if task is not None:
            raise ApiError(409, f"run {task.run}, {task.kind}, is under way: wait for its end or stop it")
        if self._bench.picture.trial() is not None:
            raise ApiError(409, "a tuning is on trial: keep it or revert it first")

    async def _start(self, *orders: Order) -> int:
        run = await asyncio.to_thread(create_run, self._station, orders[0])
        self._show(orders[0], run, len(orders) - 1, "starting", 0.0)
        self._prepare_report()
        self._running = asyncio.create_task(self._perform(orders, run))
        return run.id

    async def _perform(self, orders: Sequence[Order], run: Run) -> None:
        """Perform orders in turn; ``run`` is that of the first. One that does not complete ends the sequence."""
        end_state: EndState | None = None
        try:
            for position, order in enumerate(orders):
                if position > 0:
                    run = await asyncio.to_thread(create_run, self._station, order)
                show = partial(self._show, order, run, len(orders) - 1 - position)
                outcome = await perform(self._station, order, run, show)
                end_state = EndState(outcome.run.end_state)
                if end_state is not EndState.COMPLETED:
                    break
        except BenchNotReadyError as error:
            _log.warning("no run follows run %s: %s", run.id, error)
        except Exception:
            _log.exception("run %s failed", run.id)
        finally:
            self._bench.picture.task = None
            self._bench.changed()
            self.queue.ended(run.id, end_state)

    def _show(self, order: Order, run: Run, following: int, phase: str, elapsed_s: float) -> None:
        self._bench.picture.task = TaskView(
            kind=order.plan.kind,
            run=run.id,
            elapsed_s=elapsed_s,
            duration_s=order.plan.program().duration_s,
            phase=phase,
            following=following,
        )

    async def _use(self, wanted: LoopSettings, who: str) -> None:
        if wanted.seed != self._seed:
            remedy = f"the simulator of this service runs with seed {self._seed}; sinew experiment takes any"
            raise SettingError("seed", wanted.seed, remedy)
        bank = await self._shelf.stored_bank(wanted.bank) if wanted.bank else None
        await self._bench.use_settings(wanted, bank, who)

    def _order(self, request: ExperimentRequest) -> tuple[Plan, LoopSettings]:
        """Return what is asked for, with the tuning in force where nothing else is said."""
        entry = experiment(request.name)
        return split_values(entry.plan, {**_values(self._loop_settings()), **request.settings})

    def _loop_settings(self) -> LoopSettings:
        return self._bench.picture.tuning.loop_settings(self._seed)


def _values(settings: LoopSettings) -> dict[str, Any]:
    return {setting.name: getattr(settings, setting.name) for setting in describe(LoopSettings)}


def _setting_view(setting: Setting, default: float | int | str) -> SettingView:
    return SettingView(
        name=setting.name,
        meaning=setting.meaning,
        unit=setting.unit,
        default=default,
        minimum=setting.minimum,
        maximum=setting.maximum,
        choices=list(setting.choices) or None,
    )
