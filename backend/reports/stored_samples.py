"""The stored run that a report was made of, found by what it holds: another installation may number it otherwise."""

from backend.recording.reader import Columns, recorded_columns
from backend.reports.digests import of_samples
from backend.reports.evidence import Evidence
from backend.storage import runs
from backend.storage.database import Database


def stored_samples(database: Database, evidence: Evidence) -> tuple[Columns | None, int | None]:
    """Return the samples of the stored run that an account speaks of and its number here, None where there is none.

    Of runs that began at the same moment it is the one whose samples have the hash; else the first, so that it can be
    told what differs.
    """
    with database.reading() as session:
        began = runs.began_at(session, evidence.run.started_at)
    found: list[tuple[Columns, int]] = []
    for run in began:
        columns, _ = recorded_columns(database, run.id)
        if of_samples(columns) == evidence.hashes.get("samples"):
            return columns, run.id
        found.append((columns, run.id))
    return found[0] if found else (None, None)
