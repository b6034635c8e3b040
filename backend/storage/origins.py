"""Where imported records came from; one that was made here has no origin."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.models import BankChanges, find_bank_changes
from backend.storage.orm import Document, OriginRow, to_record
from backend.storage.runs import Run

RUN, IDENTIFICATION = "run", "identification"
CALIBRATIONS = "calibrations"
"""In what is carried with a run: the steps of the bring-up that held when it began, at the rig that made it."""
BANKS = "banks"
"""In what is carried with a run: the banks that it names and that did not come with it, by their numbers there."""


@dataclass(frozen=True)
class Origin:
    """``was`` is the number of the record where it was made, ``sha256`` that of the file it came in.

    ``carried`` is what came with it that is no record here.
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
        """Say it."""
        return f"imported from {self.file}, there {self.kind} {self.was}"


def add(session: Session, origin: Origin) -> None:
    """Note where a record came from."""
    session.add(OriginRow(**asdict(origin), at=datetime.now(UTC)))
    session.flush()


def of_runs(session: Session, run_ids: Sequence[int]) -> dict[int, Origin]:
    """Return the origins of those of these runs that were imported."""
    query = select(OriginRow).where(OriginRow.kind == RUN, OriginRow.number.in_(run_ids))
    return {row.number: to_record(Origin, row) for row in session.scalars(query)}


def load_banks_during_run(session: Session, run: Run) -> BankChanges:
    """Return the banks here that a run changed to on its way; of an imported one those that came with it."""
    named, origin = find_bank_changes(run.settings), of_runs(session, [run.id]).get(run.id)
    return named if origin is None or BANKS not in origin.carried else BankChanges(frozenset(), named.computed)


def bring_banks(session: Session, run_id: int, *, where_there_are: bool) -> bool:
    """Note that the banks of an imported run are here now; return whether it was without them.

    An earlier Sinew did not note which these were: ``where_there_are`` says that there are any.
    """
    row = session.scalar(select(OriginRow).where(OriginRow.kind == RUN, OriginRow.number == run_id))
    if row is None or not (where_there_are or BANKS in row.carried):
        return False
    row.carried = {name: part for name, part in row.carried.items() if name != BANKS}
    return True


def load_imported_numbers(session: Session, kind: str) -> set[int]:
    """Return the numbers of all records of a kind that were imported."""
    return set(session.scalars(select(OriginRow.number).where(OriginRow.kind == kind)))
