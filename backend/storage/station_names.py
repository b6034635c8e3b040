"""Give what a database without stations holds to one: for the day on which a second rig joins it."""

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from backend.errors import Because, RefusalError
from backend.storage.formula_schema import FormulaRow
from backend.storage.index_schema import RunIndexRow
from backend.storage.queue_schema import QueuedRow
from backend.storage.schema import BankRow, BringUpRow, EventRow, ExperimentRow, IdentificationRow, RunRow, SettingRow
from backend.storage.study_schema import StudyPointRow, StudyRow

_TABLES = (
    RunRow,
    IdentificationRow,
    BankRow,
    ExperimentRow,
    EventRow,
    SettingRow,
    BringUpRow,
    StudyRow,
    StudyPointRow,
    QueuedRow,
    FormulaRow,
)


def give_all(session: Session, station: str) -> int:
    """Give all rows that are of no station to this one; return how many runs. Raises RefusalError where it has any.

    What runs are searched by is renewed at the next opening.
    """
    for table in _TABLES:
        taken = session.scalar(select(func.count()).select_from(table).where(table.station == station))
        if taken:
            raise RefusalError(
                Because.NOT_NOW,
                f"station {station} has {taken} rows of table {table.__tablename__} already: choose a name that is new",
            )
    runs = session.scalar(select(func.count()).select_from(RunRow).where(RunRow.station == "")) or 0
    for table in _TABLES:
        session.execute(update(table).where(table.station == "").values(station=station))
    session.execute(update(RunIndexRow).where(RunIndexRow.station == "").values(station=station, version=0))
    return runs
