"""Identifications and experiments that run in this service, one at a time."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial

from backend.archive.own_experiments import Checked, OwnExperiments, view_of
from backend.archive.stored_banks import StoredBanks
from backend.auth.authentication import Person
from backend.banks.tuning_settings import TuningChoice
from backend.departure import HasLeft
from backend.errors import Because, RefusalError, RefusedValueError
from backend.execution.runner import (
    Doing,
    Notify,
    NotReadyError,
    Order,
    Station,
    banks_in,
    banks_of,
    choices_of,
    create_run,
    evaluated,
    playable,
    played,
    require_ready,
)
from backend.experiments.forecast import expected, forecast, start_from
from backend.experiments.library import experiments, values_of
from backend.experiments.plans import LoopSettings, Plan
from backend.faults import Fault
from backend.models.settings import SettingError
from backend.operating import run_kinds
from backend.operating.actuator import Actuator
from backend.operating.dry_runs import DryRuns
from backend.operating.experiment_queue import Queue
from backend.operating.identification_orders import plans_of, prediction_of
from backend.operating.pause import Pause, not_begun
from backend.operating.results_under_way import ResultsUnderWay
from backend.operating.run_progress import Ordered, run_progress
from backend.operating.safe_stop import SafeStop
from backend.operating.text_work import Compute, TextWork
from backend.operating.tuning_in_use import Chosen
from backend.schemas.experiment import (
    CheckedExperiment,
    DryRunView,
    ExperimentKind,
    ExperimentRequest,
    ExperimentToCheck,
    OwnExperiment,
)
from backend.schemas.identification import IdentificationRequest, Prediction
from backend.schemas.tuning import TuningView
from backend.storage.banks import Bank
from backend.storage.database import Database
from backend.storage.runs import EndState, Run
from backend.supervision import Supervision
from plant.interface import PlantKind
from plant.parameters import PlantParameters

_log = logging.getLogger(__name__)


class OrderedRuns:
    """Starts what takes its time and keeps the state informed of how far it is."""

    def __init__(
        self,
        station: Station,
        actuator: Actuator,
        banks: StoredBanks,
        experiments: OwnExperiments,
        prepare_report: Callable[[], None],
        seed: int,
        dry_runs: DryRuns,
        texts: TextWork,
        supervision: Supervision,
        safe_stop: SafeStop,
    ) -> None:
        self._station = station
        self._actuator = actuator
        self._banks = banks
        self._experiments = experiments
        self._prepare_report = prepare_report
        self._seed = seed
        self._dry_runs = dry_runs
        self._texts = texts
        self._safe_stop = safe_stop
        self.queue = Queue(self.start_experiment, self.checked, supervision, station.database)
        self._problem = ""
        self._results = ResultsUnderWay()
        self.pause = Pause(actuator.present, actuator.changed)
        self._running: asyncio.Task[None] | None = None
        self._closing = False

    @property
    def problems(self) -> list[str]:
        """What became of the last run that failed, until another one is started or it has its result after all."""
        return [problem for problem in (self._problem, self._results.problem) if problem]

    def evaluated(self, run_id: int) -> None:
        """Take note that a run has been evaluated again: that its result is missing is not so any more."""
        if run_id == self._results.without:
            self._results.forget()
            self._actuator.changed()

    async def experiment_kinds(self, person: Person, has_left: HasLeft) -> list[ExperimentKind]:
        """Return the experiments there are, with their settings and those of the loop as in force."""
        present = self._actuator.present
        settings = self._loop_settings()
        self._dry_runs.get_ready(present.tuning.parameters, settings)  # who looks at experiments may well try one
        tuning, plant = present.operators_tuning.view(0.0), present.plant.kind
        asked = self._experiments, settings, tuning, plant
        if await asyncio.to_thread(self._experiments.has_own):
            return await self._texts.run(person, has_left, _experiment_kinds, *asked)
        return await asyncio.to_thread(_experiment_kinds, *asked)

    async def start_experiment(self, request: ExperimentRequest, who: str) -> int:
        """Start an experiment and return its run. Raises RefusalError, SettingError, OutOfRangeError."""
        _, plan, wanted = await self._ordered(request)
        self._require_seed(wanted)
        async with self._actuator.starting:
            self._require_free()
            require_ready(self._station.loop)
            return await self._start(await self._bank_of(wanted), Order(plan, wanted, who))

    async def checked(self, request: ExperimentRequest) -> ExperimentRequest:
        """Return an order with all that it leaves to what is in force now, for one that waits for its turn.

        Raises what a start would raise: SettingError, OutOfRangeError, UnknownRecordError, TuningError.
        """
        name, plan, wanted = await self._ordered(request)
        self._require_seed(wanted)
        tuning, bank = self._actuator.present.tuning, await self._bank_of(wanted)
        await asyncio.to_thread(tuning.with_choice, wanted.tuning, bank)
        await self._texts.order(_require_playable, self._station.database, tuning.parameters, plan, wanted.tuning)
        return ExperimentRequest(name=name, settings={**values_of(plan), **asdict(wanted)})

    async def check_experiment(self, asked: ExperimentToCheck, person: Person, has_left: HasLeft) -> CheckedExperiment:
        """Look an own experiment over on this plant and the tuning in force, and predict its peaks on the simulator.

        Raises ExperimentError.
        """
        checked = await self._looked_over(asked.text, person, has_left)
        if not asked.play:
            return checked.view({}, "it was looked over only")
        try:
            played = await self._play_dry(Order(checked.plan, self._loop_settings(), person.name), person, has_left)
        except (RefusalError, RefusedValueError) as error:
            busy = isinstance(error, RefusalError) and error.because is Because.TOO_MANY
            return checked.view({}, str(error), busy=busy)
        return checked.view({item.name: item.value for item in played.metrics}, dry_run=played)

    async def keep_experiment(self, written: str, person: Person, has_left: HasLeft) -> OwnExperiment:
        """Keep an own experiment as the next version of its name. Raises ExperimentError."""
        checked = await self._looked_over(written, person, has_left)
        kept = await asyncio.to_thread(self._experiments.store, checked, written, person.name)
        return view_of(kept, checked.title)

    async def _looked_over(self, written: str, person: Person, has_left: HasLeft) -> Checked:
        here = self._actuator.present.tuning.parameters, self._loop_settings().tuning
        return await self._texts.run(person, has_left, self._experiments.checked, written, *here)

    async def dry_run(self, request: ExperimentRequest, person: Person, has_left: HasLeft) -> DryRunView:
        """Play an experiment on a simulator beside this service. Raises SettingError and what ``DryRuns.play`` does."""
        asked = request.name, self._loop_settings(), request.settings
        if request.name in experiments():
            _, plan, wanted = await asyncio.to_thread(self._experiments.plan, *asked)
        else:
            _, plan, wanted = await self._texts.run(person, has_left, self._experiments.plan, *asked)
        return await self._play_dry(Order(plan, wanted, person.name), person, has_left)

    async def _play_dry(self, order: Order, person: Person, has_left: HasLeft) -> DryRunView:
        bank = await self._bank_of(order.loop_settings)
        others = banks_of(order.plan) - {0 if bank is None else bank.id}
        used = [*([] if bank is None else [bank]), *(await self._banks.existing(others) if others else ())]
        return await self._dry_runs.play(self._actuator.present.tuning.parameters, order, used, person, has_left)

    async def start_identification(self, request: IdentificationRequest, who: str) -> int:
        """Start an identification, or several in turn, and return the first run.

        Raises RefusalError, SettingError, OutOfRangeError.
        """
        plans = plans_of(request)
        async with self._actuator.starting:
            self._require_free()
            parameters = self._station.parameters
            loop, bank = self._loop_settings(), self._actuator.present.tuning.bank
            start = start_from(self._station.loop.ring.newest())
            told = await self._texts.order(forecast, plans, parameters, start, loop.lam_motor)
            told.require_within_range(parameters)
            return await self._start(bank, *(Order(plan, loop, who) for plan in plans))

    async def predict_identification(
        self, request: IdentificationRequest, compute: Compute = asyncio.to_thread
    ) -> Prediction:
        """Tell what an identification would do to the rig. Raises SettingError, OutOfRangeError."""
        tuning, start = self._actuator.present.tuning, start_from(self._station.loop.ring.newest())
        told: Prediction = await compute(prediction_of, request, tuning.parameters, tuning.lambdas.lam_motor, start)
        return told

    def is_evaluating(self, run_id: int) -> bool:
        """Whether the result of a run is being computed."""
        return run_id in self._results

    async def close(self, cause: str = "service ended") -> None:
        """Give up what is running; its run is closed as ended by ``cause``."""
        self._closing = True
        if self._running is not None:
            self._running.cancel(cause)
            await asyncio.gather(self._running, return_exceptions=True)

    def _require_free(self) -> None:
        self._actuator.require_unoccupied()
        if (task := self._actuator.present.task) is not None:
            remedy = "wait for its end or stop it"
            raise RefusalError(Because.NOT_NOW, f"run {task.run}, {task.kind}, is under way: {remedy}")
        if self._actuator.present.trial() is not None:
            raise RefusalError(Because.NOT_NOW, "a tuning is on trial: keep it or revert it first")

    async def _start(self, bank: Bank | None, *orders: Order) -> int:
        """Start orders in turn, all with the tuning of the first on the models of ``bank``."""
        await self._actuator.retuning.lend(orders[0].loop_settings.tuning, bank, orders[0].who)
        try:
            run = await asyncio.to_thread(create_run, self._station, orders[0])
        except BaseException:
            await self._actuator.retuning.give_back()
            raise
        self._problem = ""
        self._results.forget()
        self.pause.begin(len(orders) - 1)
        progress = await self._progress(orders, 0, run)
        progress(Doing.STARTING, 0.0)
        self._running = asyncio.create_task(self._perform(orders, run, progress))
        self._prepare_report()
        return run.id

    async def _perform(self, orders: Sequence[Order], run: Run, show: Notify) -> None:
        """Perform orders in turn; ``run`` and ``show`` are those of the first. One that does not complete ends it.

        While the result of one is computed the next one plays: together they take what was announced.
        """
        end_state: EndState | None = None
        playing = True
        try:
            for position, order in enumerate(orders):
                if position > 0:
                    playing = False
                    if (following := await self._following(orders[position:], run, show)) is None:
                        break
                    run, playing = following, True
                    show = await self._progress(orders, position, run)
                    show(Doing.STARTING, 0.0)
                self._actuator.present.on_the_way = await self._on_the_way(order)
                over = self._actuator.retuning.give_back if position == len(orders) - 1 else _nothing
                closed = await played(self._station, order, run, show, over)
                end_state = EndState(closed.end_state)
                work = asyncio.create_task(evaluated(self._station, order.plan, closed))
                self._results.add(run.id, end_state, work)
                if end_state is not EndState.COMPLETED:
                    break
            playing = False
            self.pause.begin(0)
            show(Doing.EVALUATION, 0.0)
            if await self._results.any_missing():
                end_state = None  # whoever waits for the result, the queue too, waits for a person
        except Exception as error:
            _log.exception("run %s failed", run.id)
            self._problem = f"Run {run.id} was given up ({type(error).__name__}: {error}): what it moved was stopped."
        finally:
            if playing and not self._closing:
                # Nobody watches over the program any more, and its run is closed: it must not play on.
                self._problem = self._problem or f"The watch over run {run.id} was ended: what it moved was stopped."
                self._safe_stop.begin(Fault.SERVICE_LOST)
            if not self._closing:  # the next start finds the operator's tuning: what was lent is not kept
                await self._actuator.retuning.give_back()
            await self._results.end(giving_up=self._closing)
            self._actuator.present.task = None
            self._actuator.changed()
            self.queue.ended(run.id, end_state)

    async def _following(self, orders: Sequence[Order], run: Run, show: Notify) -> Run | None:
        """Create the first run of what is left after ``run`` once no pause is wanted; None, and a problem, if it fails.

        Nothing plays then, and ``run`` is complete: neither it nor the joint is concerned.
        """
        try:
            await self.pause.over(self._station.loop, partial(show, Doing.PAUSED, 0.0))
            return await asyncio.to_thread(create_run, self._station, orders[0])
        except Exception as error:
            _log.warning("no run follows run %s: %s", run.id, error, exc_info=not isinstance(error, NotReadyError))
            self._problem = not_begun(run.id, error, len(orders))
            return None

    async def _on_the_way(self, order: Order) -> list[Chosen]:
        """Return the tunings that an order puts into use while it plays, by their numbers from 1 on."""
        choices = choices_of(order.plan, order.loop_settings.tuning)
        numbers = {choice.bank for choice in choices}
        there = {bank.id: bank for bank in await self._banks.existing(numbers)} if choices else {}
        return [Chosen(choice, there.get(choice.bank)) for choice in choices]

    async def _progress(self, orders: Sequence[Order], position: int, run: Run) -> Notify:
        """Return what shows in the state how far a run is, of the time that it is expected to take from here."""
        plan, start = orders[position].plan, start_from(self._station.loop.ring.newest())
        told = await asyncio.to_thread(expected, plan, self._station.parameters, start)
        ordered = Ordered(plan, run.id, told, position + 1, len(orders))
        return run_progress(self._actuator.present, ordered, self.pause)

    def _require_seed(self, wanted: LoopSettings) -> None:
        if wanted.seed != self._seed:
            remedy = f"the simulator of this service runs with seed {self._seed}; sinew experiment takes any"
            raise SettingError("seed", wanted.seed, remedy)

    async def _bank_of(self, wanted: LoopSettings) -> Bank | None:
        return await self._banks.stored_bank(wanted.bank) if wanted.bank else None

    async def _ordered(self, request: ExperimentRequest) -> tuple[str, Plan, LoopSettings]:
        """Return what is asked for, of an own one its version; the operator's tuning where nothing else is said."""
        asked = request.name, self._loop_settings(), request.settings
        if request.name in experiments():  # no text of a person's: as costly as Sinew's own
            return await asyncio.to_thread(self._experiments.plan, *asked)
        return await self._texts.order(self._experiments.plan, *asked)

    def _loop_settings(self) -> LoopSettings:
        return LoopSettings(**self._actuator.present.operators_tuning.choice.document(), seed=self._seed)


def _experiment_kinds(
    known: OwnExperiments, in_force: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    return run_kinds.experiment_kinds(known.all(), in_force, tuning, plant)


def _require_playable(database: Database, parameters: PlantParameters, plan: Plan, tuning: TuningChoice) -> None:
    playable(banks_in(database), parameters, plan, tuning)


async def _nothing() -> None:
    """Leave the tuning with a sequence of runs until the last one is over."""
