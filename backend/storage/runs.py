"""Stored runs: author, settings, plant, and end."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from functools import cached_property

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from backend.faults import Fault
from backend.models import SETTINGS, RunSettings, StoredWall, UnreadableDocumentError, merge_wall_changes
from backend.plain_text import escape_line
from backend.storage import messages
from backend.storage.orm import Document, RunRow, UnknownRecordError, mark_for_reindex, require, to_record
from backend.storage.stations import session_station

# Runs ----------------------------------------------------------------------------------------------
# Runs: author, settings, plant and parameters, and end.


class RunKind(StrEnum):
    """Purpose of a run."""

    SESSION = "session"
    MOTOR_IDENTIFICATION = "motor_identification"
    SPRING_IDENTIFICATION = "spring_identification"
    ACTUATOR_IDENTIFICATION = "actuator_identification"
    TRACKING = "tracking"
    COMPLIANCE = "compliance"
    ROBUSTNESS = "robustness"
    SEQUENCE = "sequence"
    EXPERIMENT = "experiment"


class EndState(StrEnum):
    """How a run ended; RUNNING if it has not."""

    RUNNING = "running"
    COMPLETED = "completed"
    STOPPED = "stopped"
    TRIPPED = "tripped"
    LINK_LOST = "link_lost"
    SERVICE_DIED = "service_died"


_OF_A_FAULT = {
    Fault.STOP_PRESSED: EndState.STOPPED,
    Fault.SERVICE_ENDED: EndState.STOPPED,
    Fault.OPERATOR_LOST: EndState.LINK_LOST,
    Fault.SERVICE_LOST: EndState.SERVICE_DIED,
}


def derive_end_state(fault: Fault) -> EndState:
    """Return the end state of a run that this fault has stopped."""
    return _OF_A_FAULT.get(fault, EndState.TRIPPED)


@dataclass(frozen=True)
class NewRun:
    """Data of a run at its start.

    ``parameters`` is the complete active parameter document, so that the run can be interpreted after the file has
    changed; ``settings`` are those of the experiment and the loop (tuning, seed, program); ``bank_id`` is the active
    bank.
    """

    kind: RunKind
    plant: str
    parameters_name: str
    parameters: Document
    who: str
    software: str
    settings: Document = field(default_factory=dict)
    bank_id: int | None = None
    note: str = ""


@dataclass(frozen=True)
class Run:
    """A stored run. ``end_state`` is an ``EndState`` value.

    ``ended_at`` is None while running. ``evaluation_problem`` says why an evaluation failed.
    """

    id: int
    kind: str
    plant: str
    parameters_name: str
    parameters: Document
    settings: Document
    bank_id: int | None
    who: str
    software: str
    started_at: datetime
    ended_at: datetime | None
    end_state: str
    end_detail: str
    note: str
    evaluation_problem: str = ""
    station: str = ""

    def number(self, section: str, name: str) -> float:
        """Return a plant parameter at the start of the run.

        Raises UnreadableDocumentError.
        """
        try:
            return float(self.parameters[section][name]["value"])
        except (KeyError, TypeError, ValueError):
            raise UnreadableDocumentError(
                messages.parameter_missing(run_id=self.id, parameter=f"{section}.{name}")
            ) from None

    @cached_property
    def set_to(self) -> RunSettings:
        """Settings of the run. Raises UnreadableDocumentError."""
        return SETTINGS.read(self.settings, f"run {self.id}")


def create(session: Session, new: NewRun) -> Run:
    """Store a run as running from now."""
    row = RunRow(
        **asdict(new),
        started_at=datetime.now(UTC),
        ended_at=None,
        end_state=EndState.RUNNING.value,
        end_detail="",
        evaluation_problem="",
        station=session_station(session),
    )
    row.kind = new.kind.value
    session.add(row)
    session.flush()
    mark_for_reindex(session, row.id)
    return to_record(Run, row)


def get(session: Session, run_id: int) -> Run:
    """Return one run. Raises UnknownRecordError."""
    return to_record(Run, require(session, RunRow, run_id, "run"))


def own(session: Session, run_id: int) -> RunRow:
    """Return the locked row of a run of the station, to change its annotations.

    Raises UnknownRecordError.
    """
    row = session.get(RunRow, run_id, with_for_update={"key_share": True}) or require(session, RunRow, run_id, "run")
    if row.station != session_station(session):
        raise UnknownRecordError(messages.run_of_another_station(run_id=run_id, station=row.station))
    return row


def began_at(session: Session, moment: datetime) -> list[Run]:
    """Return the runs of all stations that began at a time; imports may be duplicates."""
    query = select(RunRow).where(RunRow.started_at == moment).order_by(RunRow.id)
    return [to_record(Run, row) for row in session.scalars(query)]


def find(
    session: Session,
    *,
    kinds: Sequence[RunKind] = (),
    ended: EndState | None = None,
    limit: int = 200,
) -> list[Run]:
    """Return runs of the station, newest first, by kind and end state.

    ``backend.storage.search`` has more criteria.
    """
    of_station = RunRow.station == session_station(session)
    of_kind = [RunRow.kind.in_([kind.value for kind in kinds])] if kinds else []
    conditions = [*of_kind, *([] if ended is None else [RunRow.end_state == ended.value])]
    query = select(RunRow).where(of_station, *conditions).order_by(RunRow.id.desc()).limit(limit)
    return [to_record(Run, row) for row in session.scalars(query)]


def count(session: Session) -> int:
    """Return the number of runs of the station."""
    query = select(func.count()).select_from(RunRow).where(RunRow.station == session_station(session))
    return session.scalar(query) or 0


def of_numbers(session: Session, run_ids: Sequence[int]) -> list[Run]:
    """Return these runs in this order, without unknown ones."""
    rows = {row.id: row for row in session.scalars(select(RunRow).where(RunRow.id.in_(run_ids)))}
    return [to_record(Run, rows[number]) for number in run_ids if number in rows]


def with_banks(session: Session, bank_ids: Sequence[int], *, limit: int) -> list[int]:
    """Return the numbers of the runs that used one of these banks, newest first."""
    query = select(RunRow.id).where(RunRow.bank_id.in_(bank_ids)).order_by(RunRow.id.desc()).limit(limit)
    return list(session.scalars(query))


def set_note(session: Session, run_id: int, note: str) -> Run:
    """Replace the note, the only part of a run that a person may edit.

    At the run's station. Raises UnknownRecordError.
    """
    row = own(session, run_id)
    row.note = note
    session.flush()
    mark_for_reindex(session, run_id)
    return to_record(Run, row)


def set_evaluation_problem(session: Session, run_id: int, problem: str) -> None:
    """Store why an evaluation failed; empty once it succeeded.

    Raises UnknownRecordError.
    """
    require(session, RunRow, run_id, "run").evaluation_problem = problem


def save_walls(session: Session, run_id: int, walls: Sequence[StoredWall]) -> None:
    """Add the obstacles that were present to a run's settings.

    Nothing changes without any. Raises UnknownRecordError, UnreadableDocumentError.
    """
    if walls:
        row = require(session, RunRow, run_id, "run")
        earlier = SETTINGS.read(row.settings, f"run {run_id}").walls or ()
        row.settings = {**row.settings, "walls": [vars(wall) for wall in merge_wall_changes(earlier, walls)]}


def end(session: Session, run_id: int, end_state: EndState, detail: str = "") -> Run:
    """Close a run. The first reason remains unless it was only inferred.

    A run that was abandoned, or that a second service on the same data considered interrupted, may have continued: the
    end event of its loop corrects that. Raises UnknownRecordError.
    """
    row = require(session, RunRow, run_id, "run")
    if row.end_state in (EndState.RUNNING, EndState.SERVICE_DIED):
        row.end_state = end_state.value
        row.end_detail = detail
        row.ended_at = datetime.now(UTC)
        session.flush()
        mark_for_reindex(session, run_id)
    return to_record(Run, row)


def open_ones(session: Session) -> bool:
    """Return whether runs of the station are not over."""
    of_station = (RunRow.end_state == EndState.RUNNING.value, RunRow.station == session_station(session))
    return session.scalar(select(RunRow.id).where(*of_station).limit(1)) is not None


def close_interrupted(session: Session, detail: str = messages.service_ended_during_run()) -> list[int]:
    """Close the station's runs that a crash left open as service_died.

    Returns their numbers. The caller must be sure that no loop executes them: at a service's start, or in a data folder
    without a service.
    """
    ended = session.scalars(
        update(RunRow)
        .where(RunRow.end_state == EndState.RUNNING.value, RunRow.station == session_station(session))
        .values(
            end_state=EndState.SERVICE_DIED.value,
            end_detail=detail,
            ended_at=datetime.now(UTC),
        )
        .returning(RunRow.id)
    )
    closed = sorted(ended)
    mark_for_reindex(session, *closed)
    return closed


# Run title -----------------------------------------------------------------------------------------
# Name and title of a run, from its settings.


def run_title(run: Run) -> str:
    """Return the title of a run on one line; that of the experiment if there is one."""
    if run.kind != RunKind.EXPERIMENT:
        return run.kind.replace("_", " ").capitalize()
    return escape_line(_get_experiment_part(run, "title")) or messages.unreadable_experiment()


def run_experiment_name(run: Run) -> str:
    """Return the experiment name of a run, or its kind; "" if it is unreadable."""
    return _get_experiment_part(run, "name") if run.kind == RunKind.EXPERIMENT else run.kind


def _get_experiment_part(run: Run, part: str) -> str:
    """Return a part of the stored experiment of a run, "" if it is unreadable."""
    try:
        return str(json.loads(run.set_to.experiment or "")[part])
    except (UnreadableDocumentError, ValueError, KeyError, TypeError):
        return ""
