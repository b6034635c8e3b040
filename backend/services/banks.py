"""Stored banks: build, compare, export and import."""

import asyncio
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Protocol

from backend.banks import MODEL_NAMES, builder, compare_entries, compute_entry_figures, merge_entries
from backend.models import UnreadableDocumentError
from backend.schemas import BankDetail, BankDifference, BankEntryDetail, BankFile, BankView, EntryLineage
from backend.services.runs import build_bank_view
from backend.storage import (
    Bank,
    BankEntry,
    Database,
    Session,
    banks,
    identifications,
    read_fits,
    read_method_name,
    runs,
)
from backend.tuning import TuningParameters, TuningPreviewer
from backend.workers import NUMERIC_LIBRARIES, WorkerProcess
from plant import PlantParameters


class TuningContext(Protocol):
    """The active tuning, with which banks are compared and evaluated."""

    @property
    def parameters(self) -> PlantParameters:
        """Parameters of the plant."""
        ...

    @property
    def lambdas(self) -> TuningParameters:
        """Tuning parameters λ and b."""
        ...

    @property
    def previewer(self) -> TuningPreviewer:
        """Predicts the loops with the models in use."""
        ...

    @property
    def bank(self) -> Bank | None:
        """The active bank, None for geometric gains."""
        ...


class StoredBanks:
    """Reads and writes banks; long computations run in the worker process.

    Methods that are not coroutines wait for the database: the event loop calls them in a thread.
    """

    def __init__(self, database: Database, worker: WorkerProcess, tuning: Callable[[], TuningContext]) -> None:
        self._database = database
        self._worker = worker
        self._tuning = tuning

    def preload(self) -> None:
        """Import the evaluation of banks in the worker process; called in the event loop."""
        self._worker.preload(compute_entry_figures, *NUMERIC_LIBRARIES)

    def list_banks(self) -> list[BankView]:
        """Return all versions of all banks, newest first."""
        with self._database.reading() as session:
            runs_of = identifications.find_estimate_runs(session)
            found = banks.find(session)
            positions = identifications.joint_positions(session, _list_identification_ids(*found))
            return [self._build_view(bank, runs_of, positions) for bank in found]

    def load_bank(self, bank_id: int) -> BankView:
        """Return one version of a bank. Raises UnknownRecordError."""
        with self._database.reading() as session:
            bank = banks.get(session, bank_id)
            positions = identifications.joint_positions(session, _list_identification_ids(bank))
            return build_bank_view(bank, identifications.find_estimate_runs(session), positions, self._get_active_id())

    def load_stored_bank(self, bank_id: int) -> Bank:
        """Return one version of a bank as stored. Raises UnknownRecordError."""
        with self._database.reading() as session:
            return banks.get(session, bank_id)

    def find_existing(self, numbers: Collection[int]) -> list[Bank]:
        """Return the banks with these numbers that exist."""
        with self._database.reading() as session:
            return [bank for bank in banks.find(session) if bank.id in numbers]

    def build_bank(self, name: str, run_ids: Sequence[int], who: str) -> BankView:
        """Build the next version of a bank from identification runs.

        Raises BankError, UnknownRecordError.
        """
        parameters = self._tuning().parameters
        return self.load_bank(builder.build_bank(self._database, parameters, name, run_ids, who).id)

    async def compute_detail(self, bank_id: int) -> BankDetail:
        """Return gains, M_s at the active λ, and lineage of every entry.

        Raises UnknownRecordError, TuningError.
        """
        tuning = self._tuning()
        bank, lineage = await asyncio.to_thread(self._load_with_lineage, bank_id)
        figures = await self._worker.run(compute_entry_figures, tuning.parameters, tuning.lambdas, bank.entries)
        return BankDetail(
            lam_q=tuning.lambdas.lam_q,
            lam_S=tuning.lambdas.lam_S,
            entries=[
                BankEntryDetail(figures=figure, lineage=line) for figure, line in zip(figures, lineage, strict=True)
            ],
        )

    async def compute_difference(
        self, bank_id: int | None, other: int | None, run_ids: Sequence[int]
    ) -> BankDifference:
        """Compare a bank with another one, or with itself after new identifications.

        ``bank_id`` None stands for geometric gains. Raises UnknownRecordError, BankError, TuningError.
        """
        tuning = self._tuning()
        before, after = await asyncio.to_thread(self._load_compared_entries, bank_id, other, run_ids)
        changes = await self._worker.run(compare_entries, tuning.parameters, tuning.lambdas, before, after)
        return BankDifference(lam_q=tuning.lambdas.lam_q, lam_S=tuning.lambdas.lam_S, entries=list(changes))

    def export_bank(self, bank_id: int) -> BankFile:
        """Return a bank in its file format. Raises UnknownRecordError."""
        return BankFile.model_validate(builder.build_bank_document(self.load_stored_bank(bank_id)))

    def import_bank(self, file: BankFile, who: str) -> BankView:
        """Store a bank from its file as the next version of its name. Raises BankError."""
        document = file.model_dump(exclude_none=True)
        return self.load_bank(builder.import_bank(self._database, self._tuning().parameters, document, who).id)

    def _build_view(self, bank: Bank, runs_of: dict[int, int | None], positions: dict[int, float]) -> BankView:
        """Return a bank for the list; an unreadable one has the reason as its note."""
        try:
            return build_bank_view(bank, runs_of, positions, self._get_active_id())
        except UnreadableDocumentError as error:
            return build_bank_view(
                replace(bank, entries=(), note=str(error)), runs_of, positions, self._get_active_id()
            )

    def _load_with_lineage(self, bank_id: int) -> tuple[Bank, list[EntryLineage | None]]:
        with self._database.reading() as session:
            bank = banks.get(session, bank_id)
            return bank, [_build_entry_lineage(session, entry) for entry in bank.entries]

    def _load_compared_entries(
        self, bank_id: int | None, other: int | None, run_ids: Sequence[int]
    ) -> tuple[tuple[BankEntry, ...], tuple[BankEntry, ...]]:
        with self._database.reading() as session:
            before = self._build_geometric_entries() if bank_id is None else banks.get(session, bank_id).entries
            if other is not None:
                return before, banks.get(session, other).entries
            again = [builder.build_entry(identifications.of_run(session, run_id)) for run_id in run_ids]
            return before, merge_entries(before, again)

    def _build_geometric_entries(self) -> tuple[BankEntry, ...]:
        """Return the models in use without a bank as entries, for the comparison."""
        return tuple(
            BankEntry(point.S_nominal, {name: getattr(point, name) for name in MODEL_NAMES})
            for point in self._tuning().previewer.points
        )

    def _get_active_id(self) -> int | None:
        bank = self._tuning().bank
        return None if bank is None else bank.id


def _build_entry_lineage(session: Session, entry: BankEntry) -> EntryLineage | None:
    if entry.identification_id is None:
        return None
    found = identifications.get(session, entry.identification_id)
    run = None if found.run_id is None else runs.get(session, found.run_id)
    fits = read_fits(found)
    return EntryLineage(
        position=fits["G_q"],
        stiffness=fits["G_S"],
        identification=found.run_id,
        estimate=found.id,
        method=read_method_name(found),
        verdict=found.verdict,
        run=found.run_id,
        created=found.created_at,
        who=found.who,
        plant=None if run is None else run.plant,
        parameters=None if run is None else run.parameters_name,
    )


def _list_identification_ids(*found: Bank) -> set[int]:
    return {entry.identification_id for bank in found for entry in bank.entries if entry.identification_id is not None}
