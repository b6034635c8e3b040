"""How the machine, the loop's timing, the disk and the database do; backups."""

from datetime import datetime
from typing import Annotated

from pydantic import FailFast, Field

from backend.messages.base import RowNumber, Schema, quantity


class GrantedView(Schema):
    """What the machine granted to the loop process."""

    priority: int = Field(description="of SCHED_FIFO, 0 under ordinary scheduling")
    memory_locked: bool
    timer_slack_ns: int
    refusals: list[str] = Field(description="what was not granted, why, and the remedy")


class LatenessClass(Schema):
    """Ticks that began later than one bound and not later than the next."""

    from_us: float = quantity("µs", "lower bound of the lateness")
    to_us: float | None = quantity("µs", "upper bound; null for none")
    ticks: int


class DatabaseView(Schema):
    """The database and the disk it lies on."""

    kind: str
    schema_revision: str | None
    size_bytes: int | None = Field(description="null where another server keeps it")
    disk_free_bytes: int


class BackupView(Schema):
    """A copy of the database in the data folder."""

    name: str
    at: datetime
    size_bytes: int


class SystemView(Schema):
    """What the System page shows beside the state."""

    granted: GrantedView | None = Field(description="null while no loop runs")
    lateness: list[LatenessClass] = Field(description="of the last minute's ticks")
    versions: dict[str, str]
    database: DatabaseView
    backups: list[BackupView]


class DatabaseCheck(Schema):
    """All that is wrong with the database; empty when it is sound."""

    problems: list[str]


class HeldView(Schema):
    """A run whose samples may go."""

    run: int
    kind: str
    who: str
    note: str
    started: datetime
    size_bytes: int


class RecordingsView(Schema):
    """What recordings take, and which may go, oldest first; empty while they take less than the limit."""

    total_bytes: int
    limit_bytes: int
    in_use_bytes: int = Field(description="of runs that models, results or reports came from: these never go")
    keep_days: int = Field(description="nothing younger may go")
    may_go: list[HeldView]
    says: str = Field(description="empty while there is nothing to decide")


class RemovalRequest(Schema):
    """The runs whose samples are to be deleted, each of them on the list as it is now."""

    runs: Annotated[list[RowNumber], FailFast()] = Field(min_length=1, max_length=10_000)
