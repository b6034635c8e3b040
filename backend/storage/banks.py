"""Controller banks in versions, each entry with the identification it came from."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from backend.documents.bank_entry import ENTRY, EntryModel
from backend.plain_text import as_line
from backend.storage.records import UnknownRecordError, require, require_distinct, to_record
from backend.storage.schema import BankEntryRow, BankRow, Document
from backend.storage.stations import station_of


@dataclass(frozen=True)
class BankEntry:
    """One nominal point [N·m/rad] with its models of G_q and G_S; gains follow from these and λ."""

    S_nominal: float
    model: Document
    identification_id: int | None = None

    @cached_property
    def known(self) -> EntryModel:
        """What the models say. Raises UnreadableDocumentError."""
        return ENTRY.read(self.model, f"the entry at {self.S_nominal:.2f} N·m/rad of a bank")


@dataclass(frozen=True)
class Bank:
    """One version of a bank, entries in order of stiffness."""

    id: int
    name: str
    version: int
    note: str
    who: str
    created_at: datetime
    entries: tuple[BankEntry, ...]
    station: str = ""


def add(
    session: Session, name: str, entries: Sequence[BankEntry], who: str, note: str = "", number: int | None = None
) -> Bank:
    """Store the next version of the bank of this name; earlier versions stay. ``number`` is given where it is known.

    Raises RefusalError for a new name that reads like one there is.
    """
    if not entries:
        raise ValueError(f"bank {name!r} has no entries: choose at least one identification")
    station = station_of(session)
    of_name = (BankRow.name == name, BankRow.station == station)
    newest = session.scalar(select(func.max(BankRow.version)).where(*of_name)) or 0
    if newest == 0 and number is None:
        names = session.scalars(select(BankRow.name).distinct().where(BankRow.station == station))
        require_distinct("a bank", name, names)
    row = BankRow(
        id=number,
        name=name,
        version=newest + 1,
        note=note,
        who=who,
        created_at=datetime.now(UTC),
        station=station,
    )
    session.add(row)
    session.flush()
    ordered = sorted(entries, key=lambda entry: entry.S_nominal)
    session.add_all(BankEntryRow(bank_id=row.id, position=i, **asdict(entry)) for i, entry in enumerate(ordered))
    session.flush()
    return _with_entries(session, row)


def get(session: Session, bank_id: int) -> Bank:
    """Return one version of a bank, whichever station's. Raises UnknownRecordError."""
    return _with_entries(session, require(session, BankRow, bank_id, "bank"))


def own(session: Session, bank_id: int) -> Bank:
    """Return one version of a bank of the station, to drive by it. Raises UnknownRecordError."""
    bank = get(session, bank_id)
    if bank.station != station_of(session):
        whose = f"is one of station {bank.station}" if bank.station else "is of no station"
        raise UnknownRecordError(f"bank {bank_id} {whose}: export it there and import it here to use it")
    return bank


def newest_version(session: Session, bank: Bank) -> int:
    """Return the newest version of the bank of this name at the station that has it."""
    name = select(BankRow.name).where(BankRow.id == bank.id).scalar_subquery()  # its own may be shown with escapes
    of_name = (BankRow.name == name, BankRow.station == bank.station)
    return session.scalar(select(func.max(BankRow.version)).where(*of_name)) or bank.version


def find(session: Session, *, name: str | None = None) -> list[Bank]:
    """Return all versions of all banks of the station or of one name, newest first."""
    query = select(BankRow).where(BankRow.station == station_of(session)).order_by(BankRow.id.desc())
    if name is not None:
        query = query.where(BankRow.name == name)
    return [_with_entries(session, row) for row in session.scalars(query)]


def _with_entries(session: Session, row: BankRow) -> Bank:
    query = select(BankEntryRow).where(BankEntryRow.bank_id == row.id).order_by(BankEntryRow.position)
    return Bank(
        id=row.id,
        name=as_line(row.name),
        version=row.version,
        note=row.note,
        who=row.who,
        created_at=row.created_at,
        station=row.station,
        entries=tuple(to_record(BankEntry, entry) for entry in session.scalars(query)),
    )
