"""What is stored, as the interface shows it: runs with their samples, identifications, banks, experiments, reports."""

import asyncio
from collections.abc import Callable, Sequence

from backend.api import stored
from backend.api.errors import ApiError
from backend.api.schemas.experiment import ExperimentView
from backend.api.schemas.flight import FlightList
from backend.api.schemas.identification import BankView, IdentificationView
from backend.api.schemas.run import RunList, RunView, SamplesView
from backend.api.schemas.state import TaskView
from backend.experiments import bank_building
from backend.recording.reader import read_envelope
from backend.storage import Database, Session, banks, flights, identifications, recordings, results, runs
from backend.storage.banks import Bank
from backend.storage.identifications import Identification
from backend.storage.records import UnknownRecordError
from backend.storage.runs import Run, RunKind
from plant.interface import T_s

IDENTIFICATION = RunKind.ACTUATOR_IDENTIFICATION


class Library:
    """Reads and writes the database in threads, so that the event loop never waits for the disk.

    ``task`` and ``bank_in_use`` tell what the service is doing at present.
    """

    def __init__(
        self, database: Database, task: Callable[[], TaskView | None], bank_in_use: Callable[[], int | None]
    ) -> None:
        self._database = database
        self._task = task
        self._bank_in_use = bank_in_use

    # Runs ---------------------------------------------------------------------------------------------------

    async def runs(self, kind: str | None, search: str, limit: int, offset: int) -> RunList:
        """Return a page of runs, newest first. Raises ApiError for an unknown kind."""
        wanted = kind.split(",") if kind else []
        for unknown in (one for one in wanted if one not in set(RunKind)):
            raise ApiError(422, f"there is no kind {unknown!r} of runs", legal=[str(known) for known in RunKind])
        kinds = [RunKind(one) for one in wanted]
        return await asyncio.to_thread(self._runs, kinds, search, limit, offset)

    async def run(self, run_id: int) -> RunView:
        """Return one run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._run, run_id)

    async def set_note(self, run_id: int, note: str) -> RunView:
        """Write the note of a run. Raises UnknownRecordError."""
        await asyncio.to_thread(self._set_note, run_id, note)
        return await self.run(run_id)

    async def flights(self) -> FlightList:
        """Return the newest flight records."""
        return await asyncio.to_thread(self._flights)

    async def samples(
        self, run_id: int, from_s: float, to_s: float | None, points: int, signals: Sequence[str]
    ) -> SamplesView:
        """Return samples or their envelope. Raises UnknownRecordError, UnknownSignalError."""
        return await asyncio.to_thread(self._samples, run_id, from_s, to_s, points, signals)

    # Identifications and banks ------------------------------------------------------------------------------

    async def identifications(self) -> list[IdentificationView]:
        """Return all identification runs, newest first."""
        return await asyncio.to_thread(self._identifications)

    async def identification(self, run_id: int) -> IdentificationView:
        """Return one identification run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._identification, run_id)

    async def banks(self) -> list[BankView]:
        """Return all versions of all banks, newest first."""
        return await asyncio.to_thread(self._banks)

    async def bank(self, bank_id: int) -> BankView:
        """Return one version of a bank. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._bank_view, bank_id)

    async def stored_bank(self, bank_id: int) -> Bank:
        """Return one version of a bank as it is stored. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._bank, bank_id)

    async def build_bank(self, name: str, run_ids: Sequence[int], who: str) -> BankView:
        """Build the next version of a bank from identification runs. Raises BankError, UnknownRecordError."""
        return await asyncio.to_thread(self._build_bank, name, run_ids, who)

    # Experiments --------------------------------------------------------------------------------------------

    async def experiment(self, run_id: int) -> ExperimentView:
        """Return one experiment run with its result. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._experiment, run_id)

    # In a thread --------------------------------------------------------------------------------------------

    def _runs(self, kinds: Sequence[RunKind], search: str, limit: int, offset: int) -> RunList:
        with self._database.reading() as session:
            found = runs.find(session, kinds=kinds, search=search, limit=limit, offset=offset)
            views = [stored.run_view(run, *_recorded(session, run.id)) for run in found]
            return RunList(runs=views, total=runs.count(session, kinds=kinds, search=search))

    def _run(self, run_id: int) -> RunView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            return stored.run_view(run, *_recorded(session, run.id))

    def _flights(self) -> FlightList:
        with self._database.reading() as session:
            return FlightList(flights=[stored.flight_view(flight) for flight in flights.find(session)])

    def _set_note(self, run_id: int, note: str) -> None:
        with self._database.session() as session:
            runs.set_note(session, run_id, note)

    def _samples(
        self, run_id: int, from_s: float, to_s: float | None, points: int, signals: Sequence[str]
    ) -> SamplesView:
        with self._database.reading() as session:
            period_s = recordings.get(session, run_id).period_s
            until_s = float("inf") if to_s is None else to_s
            envelope = read_envelope(session, run_id, points, signals, from_s, until_s)
            return stored.samples_view(run_id, envelope, raw=envelope.width_s <= 1.5 * period_s)

    def _identifications(self) -> list[IdentificationView]:
        with self._database.reading() as session:
            estimates = {estimate.run_id: estimate for estimate in reversed(identifications.find(session))}
            found = runs.find(session, kinds=[IDENTIFICATION], limit=500)
            return [stored.identification_view(run, estimates.get(run.id), self._progress(run)) for run in found]

    def _identification(self, run_id: int) -> IdentificationView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            if run.kind != IDENTIFICATION:
                raise UnknownRecordError(f"run {run_id} is no identification but {run.kind}")
            estimates = identifications.find(session, run_id=run_id)
            result = results.newest(session, run_id)
        view = stored.identification_view(run, estimates[0] if estimates else None, self._progress(run))
        return view if result is None else view.model_copy(update={"message": str(result.metrics.get("problem", ""))})

    def _banks(self) -> list[BankView]:
        with self._database.reading() as session:
            runs_of = _runs_of_estimates(session)
            return [stored.bank_view(bank, runs_of, self._bank_in_use()) for bank in banks.find(session)]

    def _bank(self, bank_id: int) -> Bank:
        with self._database.reading() as session:
            return banks.get(session, bank_id)

    def _bank_view(self, bank_id: int) -> BankView:
        with self._database.reading() as session:
            return stored.bank_view(banks.get(session, bank_id), _runs_of_estimates(session), self._bank_in_use())

    def _build_bank(self, name: str, run_ids: Sequence[int], who: str) -> BankView:
        with self._database.reading() as session:
            chosen = [_newest_estimate(session, run_id).id for run_id in run_ids]
        return self._bank_view(bank_building.build_bank(self._database, name, chosen, who).id)

    def _experiment(self, run_id: int) -> ExperimentView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            return stored.experiment_view(run, results.newest(session, run_id), self._progress(run))

    def _progress(self, run: Run) -> float:
        task = self._task()
        if task is None or task.run != run.id:
            return 1.0
        return min(0.99, task.elapsed_s / task.duration_s) if task.phase == "program" else 0.0


def _recorded(session: Session, run_id: int) -> tuple[int, float, int]:
    """Return samples, period [s] and missing samples of a run; none of a run that was not recorded."""
    try:
        recording, extent = recordings.get(session, run_id), recordings.extent(session, run_id)
    except UnknownRecordError:
        return 0, T_s, 0
    return extent.count, recording.period_s, recording.missed


def _runs_of_estimates(session: Session) -> dict[int, int | None]:
    return {estimate.id: estimate.run_id for estimate in identifications.find(session)}


def _newest_estimate(session: Session, run_id: int) -> Identification:
    found = identifications.find(session, run_id=run_id)
    if not found:
        raise UnknownRecordError(f"there is no identification {run_id} with a model")
    return found[0]
