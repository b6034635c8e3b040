"""Source data of a report: the stored run, its result, its samples and its bank."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from backend.recording import Columns, read_drawn_columns, read_recorded_columns
from backend.storage import (
    Bank,
    Database,
    Identification,
    Result,
    Run,
    RunKind,
    StoredFit,
    banks,
    identifications,
    load_bank_fits,
    results,
    runs,
)
from backend.units import AngleUnit


@dataclass(frozen=True)
class RunData:
    """A run with all data of its report, in SI units.

    ``columns`` are its samples, t [s] from the first one; for a session, which may last hours, only as many as can be
    drawn. ``runs_of`` maps the number of a stored estimate to the run that the identification is named after. ``fits``
    maps it to the quality of the models of the bank's entries. ``angles`` is the display unit of angles in the report.
    """

    run: Run
    result: Result | None
    columns: Columns
    bank: Bank | None
    identification: Identification | None = None
    runs_of: Mapping[int, int | None] = field(default_factory=dict)
    angles: AngleUnit = AngleUnit.DEGREES
    fits: Mapping[int, Mapping[str, StoredFit]] = field(default_factory=dict)


def load_source(database: Database, run_id: int, angles: AngleUnit = AngleUnit.DEGREES) -> RunData:
    """Load a run, its newest result and identification, its bank and its samples.

    Raises UnknownRecordError.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        result = results.newest(session, run_id)
        bank = None if run.bank_id is None else banks.get(session, run.bank_id)
        estimates = identifications.find(session, run_id=run_id)
        runs_of = identifications.find_estimate_runs(session)
        fits = {} if bank is None else load_bank_fits(session, bank)
    by_hand = run.kind == RunKind.SESSION
    columns = read_drawn_columns(database, run_id) if by_hand else read_recorded_columns(database, run_id)[0]
    return RunData(
        run=run,
        result=result,
        columns=columns,
        bank=bank,
        identification=estimates[0] if estimates else None,
        runs_of=runs_of,
        angles=angles,
        fits=fits,
    )
