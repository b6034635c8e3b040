"""How the machine, the loop's timing, the disk and the database do; backups."""

from datetime import datetime

from pydantic import Field

from backend.api.schemas.base import Schema, quantity


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
