"""Retention of recordings: which may be deleted, and their deletion on request.

Nothing is deleted automatically. Only samples are deleted; the run keeps its settings and its note, and shows the
deletion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from backend.recording import messages
from backend.storage import Database, EventKind, RetentionEntry, events, recordings
from plant import ErrorCode, SinewError

_CHUNKS_AT_ONCE = 200
"""Chunks deleted in one transaction, so that the recorder never waits long for the database."""


class NotRemovableError(SinewError, ValueError):
    """Request to delete samples that may not be deleted; nothing was deleted."""

    category = ErrorCode.NOT_NOW


@dataclass(frozen=True)
class RetentionRule:
    """Limit ``max_bytes`` of recordings.

    Beyond it, those older than ``keep_days`` may go.
    """

    max_bytes: int
    keep_days: int


@dataclass(frozen=True)
class Overview:
    """Sizes of recordings and of those in use, and the deletable runs, oldest first."""

    rule: RetentionRule
    total_bytes: int
    in_use_bytes: int
    may_go: tuple[RetentionEntry, ...]

    @property
    def describe(self) -> str:
        """One sentence if the limit is exceeded, else an empty string."""
        if self.total_bytes <= self.rule.max_bytes:
            return ""
        max_bytes, keep_days = self.rule.max_bytes, self.rule.keep_days
        if not self.may_go:
            return messages.no_recording_deletable(
                total_bytes=self.total_bytes, max_bytes=max_bytes, keep_days=keep_days
            )
        return messages.recordings_deletable(
            total_bytes=self.total_bytes,
            max_bytes=max_bytes,
            keep_days=keep_days,
            runs=len(self.may_go),
            freed_bytes=sum(run.size_bytes for run in self.may_go),
        )


def summarize_retention(database: Database, rule: RetentionRule) -> Overview:
    """Return the sizes of recordings and the deletable runs.

    These are the oldest without dependent results, until the rest is within the limit.
    """
    with database.reading() as session:
        runs = recordings.load_held(session)
    total = sum(run.size_bytes for run in runs)
    before = datetime.now(UTC) - timedelta(days=rule.keep_days)
    may_go, left = [], total
    for run in runs:
        if left > rule.max_bytes and not run.in_use and run.started_at < before:
            may_go.append(run)
            left -= run.size_bytes
    return Overview(rule, total, sum(run.size_bytes for run in runs if run.in_use), tuple(may_go))


def delete_recordings(database: Database, rule: RetentionRule, run_ids: Sequence[int], who: str) -> Overview:
    """Delete the samples of exactly these runs.

    Raises NotRemovableError unless every one of them is deletable.
    """
    may_go = {run.run_id: run for run in summarize_retention(database, rule).may_go}
    others = sorted(set(run_ids) - set(may_go))
    if others or not run_ids:
        raise NotRemovableError(messages.runs_not_removable(refused=others, removable=list(may_go)))
    for run_id in sorted(set(run_ids)):
        _remove(database, may_go[run_id], who)
    return summarize_retention(database, rule)


def _remove(database: Database, run: RetentionEntry, who: str) -> None:
    day = datetime.now(UTC).date()
    with database.session() as session:
        if next((held.in_use for held in recordings.load_held(session) if held.run_id == run.run_id), True):
            raise NotRemovableError(messages.run_came_into_use(run_id=run.run_id))
        recordings.mark_removed(session, run.run_id, messages.samples_deleted_by(who=who, day=day))
        text = messages.samples_deleted(run_id=run.run_id, size_bytes=run.size_bytes)
        events.add(session, EventKind.RETENTION, text, who=who, run_id=run.run_id)
    more = True
    while more:
        with database.session() as session:
            more = recordings.remove_chunks(session, run.run_id, _CHUNKS_AT_ONCE)
