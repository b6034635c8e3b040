"""Where a run came from, what happened in it, how far the set-up is: read from the database in threads."""

import asyncio
from collections.abc import Callable

from backend.archive import checklist
from backend.archive.lineage import READ_AT_ONCE_BYTES, LineageGraph, SampleDigests
from backend.schemas.run import Checklist, Lineage, LineageBank, LineageEntry, RunMark, RunMarks
from backend.storage import banks, events, identifications, recordings, runs
from backend.storage.banks import Bank, name_of_entry
from backend.storage.database import Database, Session
from backend.storage.events import Event, EventKind
from backend.storage.orm import UnknownRecordError
from plant.parameters import PlantParameters

_RUNS_SHOWN = 20


class History:
    """``bank_in_use`` tells the number of the active bank; longer recordings than ``largest_bytes`` have no digest."""

    def __init__(
        self,
        database: Database,
        parameters: PlantParameters,
        bank_in_use: Callable[[], int | None],
        largest_bytes: int = READ_AT_ONCE_BYTES,
    ) -> None:
        self._database = database
        self.use(parameters)
        self._bank_in_use = bank_in_use
        self._samples = SampleDigests(largest_bytes)

    def use(self, parameters: PlantParameters) -> None:
        """Compare runs with these parameters from now on."""
        self._parameters = parameters.document()

    async def lineage(self, run_id: int) -> Lineage:
        """Return what a run came from and what came of it. Raises UnknownRecordError."""
        return await asyncio.to_thread(self.lineage_of, run_id)

    async def marks(self, run_id: int) -> RunMarks:
        """Return what happened during a run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._marks, run_id)

    async def checklist(self) -> Checklist:
        """Return how far the set-up is."""
        return await asyncio.to_thread(self._checklist)

    def lineage_of(self, run_id: int) -> Lineage:
        """Return what a run came from and what came of it. Raises UnknownRecordError."""
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            bank = None if run.bank_id is None else banks.get(session, run.bank_id)
            mine = {estimate.id for estimate in identifications.find(session, run_id=run_id)}
            built = [one for one in banks.find(session) if mine & {entry.identification_id for entry in one.entries}]
            return Lineage(
                run=run.id,
                software=run.software,
                parameters=run.parameters_name,
                parameters_as_now=run.parameters == self._parameters,
                bank=None if bank is None else _named(bank),
                entries=[] if bank is None else _entries(session, bank),
                banks_built=[_named(one) for one in built],
                runs_with_them=runs.with_banks(session, [one.id for one in built], limit=_RUNS_SHOWN),
                nodes=LineageGraph(session, self._parameters, self._samples).of(run, built),
            )

    def _marks(self, run_id: int) -> RunMarks:
        with self._database.reading() as session:
            return marks_of(session, run_id)

    def _checklist(self) -> Checklist:
        with self._database.reading() as session:
            return Checklist(steps=checklist.steps(session, self._parameters, self._bank_in_use()))


def marks_of(session: Session, run_id: int) -> RunMarks:
    """Return what happened during a run, on its own time axis. Raises UnknownRecordError."""
    run = runs.get(session, run_id)
    try:
        period_s, span = recordings.get(session, run_id).period_s, recordings.span(session, run_id)
    except UnknownRecordError:
        return RunMarks(marks=[])
    happened = events.between(session, run.started_at, run.ended_at, station=run.station)
    faults = [event for event in happened if event.kind == EventKind.FAULT]

    def is_doubled(trip: Event) -> bool:
        """Tell whether an earlier version kept the trip as a fault too, such as "STOP" for "STOP was pressed."."""
        return any(fault.tick == trip.tick and trip.text.startswith(fault.text) for fault in faults)

    marks = [
        RunMark(t=(event.tick - span.first_tick) * period_s, kind=event.kind, text=event.text, who=event.who)
        for event in happened
        # ticks begin anew with each loop process: those of another one do not fit this recording
        if event.tick is not None and span.first_tick <= event.tick <= span.end_tick
        if event.kind != EventKind.TRIP or not is_doubled(event)
    ]
    return RunMarks(marks=marks)


def _named(bank: Bank) -> LineageBank:
    return LineageBank(id=bank.id, name=bank.name, version=bank.version)


def _entries(session: Session, bank: Bank) -> list[LineageEntry]:
    run_of = {estimate.id: estimate.run_id for estimate in identifications.find(session)}
    return [
        LineageEntry(name=name_of_entry(entry), S_nominal=entry.S_nominal, run=run_of.get(entry.identification_id or 0))
        for entry in bank.entries
    ]
