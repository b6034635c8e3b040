"""Origins of imported records; local records have none."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.models import BankChanges, find_bank_changes
from backend.storage import messages
from backend.storage.orm import Document, OriginRow, to_record
from backend.storage.runs import Run

RUN, IDENTIFICATION = "run", "identification"
CALIBRATIONS = "calibrations"
"""Key in ``carried``: commissioning steps that were valid at the start of the run, at its rig."""
BANKS = "banks"
"""Key in ``carried``: banks that the run refers to and that were not imported, by their numbers at the origin."""


@dataclass(frozen=True)
class Origin:
    """Origin of a record: ``was`` is its number there, ``sha256`` that of its file.

    ``carried`` are accompanying data that are no records here.
    """

    kind: str
    number: int
    was: int
    file: str
    sha256: str
    who: str
    carried: Document = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """Description of the origin."""
        return messages.imported_from(file=self.file, kind=self.kind, number=self.was)


def add(session: Session, origin: Origin) -> None:
    """Store the origin of a record."""
    session.add(OriginRow(**asdict(origin), at=datetime.now(UTC)))
    session.flush()


def of_runs(session: Session, run_ids: Sequence[int]) -> dict[int, Origin]:
    """Return the origins of the imported ones of these runs."""
    query = select(OriginRow).where(OriginRow.kind == RUN, OriginRow.number.in_(run_ids))
    return {row.number: to_record(Origin, row) for row in session.scalars(query)}


def load_banks_during_run(session: Session, run: Run) -> BankChanges:
    """Return the banks here that a run activated; of an imported one those imported."""
    named, origin = find_bank_changes(run.settings), of_runs(session, [run.id]).get(run.id)
    return named if origin is None or BANKS not in origin.carried else BankChanges(frozenset(), named.computed)


def bring_banks(session: Session, run_id: int, *, where_there_are: bool) -> bool:
    """Record that the banks of an imported run are here.

    Return whether it lacked them. Earlier versions did not record which these were: ``where_there_are`` says that there
    are any.
    """
    row = session.scalar(select(OriginRow).where(OriginRow.kind == RUN, OriginRow.number == run_id))
    if row is None or not (where_there_are or BANKS in row.carried):
        return False
    row.carried = {name: part for name, part in row.carried.items() if name != BANKS}
    return True


def load_imported_numbers(session: Session, kind: str) -> set[int]:
    """Return the numbers of all imported records of a kind."""
    return set(session.scalars(select(OriginRow.number).where(OriginRow.kind == kind)))
