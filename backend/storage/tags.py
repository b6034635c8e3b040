"""Tags of runs: single words, case-insensitive, added and removed by people."""

import re
from collections.abc import Sequence

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from backend.errors import RequestRejectedError
from backend.storage import messages, runs
from backend.storage.orm import TAG_MAX, RunRow, RunTagRow, UnknownRecordError, mark_for_reindex
from backend.storage.search import NONE, normalize_tag
from backend.storage.search_index import insert_new
from backend.storage.stations import session_station
from plant import ErrorCode

_TAG = re.compile(r"[\w.:+-]+")


class TagError(RequestRejectedError):
    """A word that is no valid tag."""

    def __init__(self, given: str) -> None:
        super().__init__(
            ErrorCode.BAD_VALUE,
            messages.invalid_tag(tag=given, maximum=TAG_MAX, reserved=NONE),
            code="bad_tag",
        )


def add(session: Session, run_id: int, tag: str) -> None:
    """Add a tag to a run of the station, unless it has it.

    Raises TagError, UnknownRecordError.
    """
    runs.own(session, run_id)
    insert_new(session, RunTagRow, [{"run_id": run_id, "tag": read_tag(tag)}])
    mark_for_reindex(session, run_id)


def take(session: Session, run_id: int, tag: str) -> None:
    """Remove a tag from a run of the station, if it has it.

    Raises TagError, UnknownRecordError.
    """
    runs.own(session, run_id)
    session.execute(delete(RunTagRow).where(RunTagRow.run_id == run_id, RunTagRow.tag == read_tag(tag)))
    mark_for_reindex(session, run_id)


def rename(session: Session, before: str, after: str) -> int:
    """Rename a tag on all runs of the station; return their number.

    Raises TagError, UnknownRecordError.
    """
    old, new = read_tag(before), read_tag(after)
    mine = select(RunTagRow.run_id).join(RunRow, RunRow.id == RunTagRow.run_id)
    of_station = mine.where(RunTagRow.tag == old, RunRow.station == session_station(session)).order_by(RunTagRow.run_id)
    tagged = list(session.scalars(of_station))
    if not tagged:
        raise UnknownRecordError(messages.tag_not_used(tag=old))
    if new != old:
        insert_new(session, RunTagRow, [{"run_id": run_id, "tag": new} for run_id in tagged])
        session.execute(delete(RunTagRow).where(RunTagRow.run_id.in_(tagged), RunTagRow.tag == old))
        mark_for_reindex(session, *tagged)
    return len(tagged)


def of_runs(session: Session, run_ids: Sequence[int]) -> dict[int, list[str]]:
    """Return the sorted tags of these runs, for those with tags."""
    query = select(RunTagRow.run_id, RunTagRow.tag).where(RunTagRow.run_id.in_(run_ids)).order_by(RunTagRow.tag)
    found: dict[int, list[str]] = {}
    for run_id, tag in session.execute(query):
        found.setdefault(run_id, []).append(tag)
    return found


def read_tag(tag: str) -> str:
    """Return a tag as stored. Raises TagError."""
    normalized = normalize_tag(tag)
    if not _TAG.fullmatch(normalized) or len(normalized) > TAG_MAX or normalized == NONE:
        raise TagError(tag)
    return normalized
