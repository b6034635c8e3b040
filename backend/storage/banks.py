"""Controller banks in versions, with the identification behind each entry."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cached_property

from sqlalchemy import func, select
from sqlalchemy.orm import Session as OrmSession

from backend.identification import Grade, joint_method_name
from backend.models import CHANNELS, ENTRY, EntryModel, IdentifiedChannel, UnreadableDocumentError
from backend.plain_text import escape_line
from backend.response_docs import describe_field
from backend.storage import identifications, messages
from backend.storage.database import Session
from backend.storage.identifications import Identification
from backend.storage.orm import (
    BankEntryRow,
    BankRow,
    Document,
    UnknownRecordError,
    require,
    require_distinct_name,
    to_record,
)
from backend.storage.stations import session_station

# Banks ---------------------------------------------------------------------------------------------
# Controller banks in versions, each entry with the identification it was made from.


@dataclass(frozen=True)
class BankEntry:
    """One operating point [N·m/rad] with its models of G_q and G_S.

    Gains follow from the models and λ.
    """

    S_nominal: float
    model: Document
    identification_id: int | None = None

    @cached_property
    def known(self) -> EntryModel:
        """Models of the entry. Raises UnreadableDocumentError."""
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
    session: OrmSession, name: str, entries: Sequence[BankEntry], who: str, note: str = "", number: int | None = None
) -> Bank:
    """Store the next version of the bank of this name; earlier versions remain.

    ``number`` is its number, if given. Raises RequestRejectedError for a new name that resembles an existing one.
    """
    if not entries:
        raise ValueError(f"bank {name!r} has no entries: choose at least one identification")
    station = session_station(session)
    of_name = (BankRow.name == name, BankRow.station == station)
    newest = session.scalar(select(func.max(BankRow.version)).where(*of_name)) or 0
    if newest == 0 and number is None:
        names = session.scalars(select(BankRow.name).distinct().where(BankRow.station == station))
        require_distinct_name("a bank", name, names)
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


def get(session: OrmSession, bank_id: int) -> Bank:
    """Return one version of a bank of any station. Raises UnknownRecordError."""
    return _with_entries(session, require(session, BankRow, bank_id, "bank"))


def own(session: OrmSession, bank_id: int) -> Bank:
    """Return one version of a bank of this station. Raises UnknownRecordError."""
    bank = get(session, bank_id)
    if bank.station != session_station(session):
        raise UnknownRecordError(messages.bank_of_another_station(bank_id=bank_id, station=bank.station))
    return bank


def newest_version(session: OrmSession, bank: Bank) -> int:
    """Return the newest version of the bank of this name at its station."""
    # bank.name may contain escapes for display
    name = select(BankRow.name).where(BankRow.id == bank.id).scalar_subquery()
    of_name = (BankRow.name == name, BankRow.station == bank.station)
    return session.scalar(select(func.max(BankRow.version)).where(*of_name)) or bank.version


def find(session: OrmSession, *, name: str | None = None) -> list[Bank]:
    """Return all versions of all banks of the station, or of one name, newest first."""
    query = select(BankRow).where(BankRow.station == session_station(session)).order_by(BankRow.id.desc())
    if name is not None:
        query = query.where(BankRow.name == name)
    return [_with_entries(session, row) for row in session.scalars(query)]


def _with_entries(session: OrmSession, row: BankRow) -> Bank:
    query = select(BankEntryRow).where(BankEntryRow.bank_id == row.id).order_by(BankEntryRow.position)
    return Bank(
        id=row.id,
        name=escape_line(row.name),
        version=row.version,
        note=row.note,
        who=row.who,
        created_at=row.created_at,
        station=row.station,
        entries=tuple(to_record(BankEntry, entry) for entry in session.scalars(query)),
    )


# Bank entry ----------------------------------------------------------------------------------------
# Names of a bank's entries for people, and the quality of the identifications behind them.


def entry_name(S_nominal: float, tension_N: float | None) -> str:
    """Return the tension of an entry, "10 N", or its stiffness, "8.24 N·m/rad".

    The stiffness if the tension is unknown.
    """
    return f"{S_nominal:.2f} N·m/rad" if tension_N is None else f"{tension_N:g} N"


def stored_entry_name(entry: BankEntry) -> str:
    """Return the name of a stored entry."""
    return entry_name(entry.S_nominal, entry.known.tension_N)


def active_entry_name(entries: Sequence[BankEntry], active: float) -> str:
    """Return the name of the ``active`` entry: "10 N", or the interpolated two."""
    if not entries:
        return ""
    last = len(entries) - 1
    below = min(max(int(active), 0), last)
    share = active - below
    if below == last or share < 0.005:
        return stored_entry_name(entries[below])
    low, high = stored_entry_name(entries[below]), stored_entry_name(entries[below + 1])
    return messages.between_entries(low=low, high=high, share=share)


@dataclass(frozen=True)
class StoredFit:
    """Quality of the model of G_q or G_S.

    Fit on validation data [%], standard errors of its K and T [%]; None if not available, as for an unreadable
    identification.
    """

    grade: Grade | None = field(metadata=describe_field("null where the identification cannot be read"))
    fit_percent: float | None = field(metadata=describe_field("fit of the simulated output on validation data"))
    K_error_percent: float | None = field(metadata=describe_field("standard error of the gain"))
    T_error_percent: float | None = field(metadata=describe_field("standard error of the time constant"))

    def in_words(self) -> str:
        """Return all values in one line: "usable, fit 98.2 %, standard errors: …".

        Only standard errors: the verdict's uncertainty may be larger, as it includes unmodelled dynamics.
        """
        return messages.quality_of_fit(
            grade=self.grade,
            fit_percent=self.fit_percent,
            K_error_percent=self.K_error_percent,
            T_error_percent=self.T_error_percent,
        )


def read_fits(found: Identification) -> dict[str, StoredFit]:
    """Return the quality of both models of an identification, by "G_q" and "G_S"."""
    try:
        return {name: _fit(found.actuator.channel(name)) for name in CHANNELS}
    except UnreadableDocumentError:  # a bank is shown without the values of an unreadable identification
        return dict.fromkeys(CHANNELS, StoredFit(None, None, None, None))


def read_method_name(found: Identification) -> str:
    """Return the name of the estimators of an actuator's identification.

    Identifications of earlier versions name only that of G_q.
    """
    try:
        named = {name: found.actuator.channel(name).model.method for name in CHANNELS}
    except UnreadableDocumentError:
        return found.method
    return joint_method_name({name: found.method if method is None else method for name, method in named.items()})


def load_bank_fits(session: Session, bank: Bank) -> dict[int, dict[str, StoredFit]]:
    """Return the quality of a bank's models by identification number.

    Raises UnknownRecordError.
    """
    named = [entry.identification_id for entry in bank.entries]
    return {number: read_fits(identifications.get(session, number)) for number in named if number is not None}


def _fit(channel: IdentifiedChannel) -> StoredFit:
    first_order = channel.model.first_order
    return StoredFit(
        grade=channel.quality.grade,
        fit_percent=channel.quality.fit_percent,
        K_error_percent=_relative(first_order.K, first_order.K_std),
        T_error_percent=_relative(first_order.T, first_order.T_std),
    )


def _relative(value: float, error: float | None) -> float | None:
    return None if not value or error is None else 100.0 * error / abs(value)
