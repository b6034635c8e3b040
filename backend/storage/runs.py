"""Stored runs: who asked for what, on which plant, and how they ended."""

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
from backend.storage.orm import Document, RunRow, UnknownRecordError, mark_for_reindex, require, to_record
from backend.storage.stations import session_station

# Runs ----------------------------------------------------------------------------------------------
#
# Runs: who asked for what, on which plant and parameters, and how it ended.


class RunKind(StrEnum):
    """What a run was for."""

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
    """Why a run is over; RUNNING while it is not."""

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
    """Return how a run ends that this fault has stopped."""
    return _OF_A_FAULT.get(fault, EndState.TRIPPED)


@dataclass(frozen=True)
class NewRun:
    """What is known when a run starts.

    ``parameters`` is the whole parameter document in use, so that the run can be understood after the file has changed;
    ``settings`` are those of the experiment and the loop (tuning, seed, program); ``bank_id`` the bank in use.
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
    """A stored run. ``end_state`` is an ``EndState`` value; ``ended_at`` is None while it runs.

    ``evaluation_problem`` says why there is no result, where somebody tried to compute one in vain.
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
        """Return a number of the plant as it was when the run began. Raises UnreadableDocumentError."""
        try:
            return float(self.parameters[section][name]["value"])
        except (KeyError, TypeError, ValueError):
            what = f"its parameters have no number {section}.{name}"
            raise UnreadableDocumentError(f"run {self.id}: {what}") from None

    @cached_property
    def set_to(self) -> RunSettings:
        """What the run was set to. Raises UnreadableDocumentError."""
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
    """Return the row of a run of the station, locked, to change what people say of it. Raises UnknownRecordError."""
    row = session.get(RunRow, run_id, with_for_update={"key_share": True}) or require(session, RunRow, run_id, "run")
    if row.station != session_station(session):
        whose = f"is one of station {row.station}" if row.station else "is of no station"
        raise UnknownRecordError(f"run {run_id} {whose}: what is said of it is changed there")
    return row


def began_at(session: Session, moment: datetime) -> list[Run]:
    """Return the runs, of all stations, that began at a moment: there is one, or several where a run was imported."""
    query = select(RunRow).where(RunRow.started_at == moment).order_by(RunRow.id)
    return [to_record(Run, row) for row in session.scalars(query)]


def find(
    session: Session,
    *,
    kinds: Sequence[RunKind] = (),
    ended: EndState | None = None,
    limit: int = 200,
) -> list[Run]:
    """Return runs of the station, newest first: of these kinds, ended like that. ``run_search`` looks for more."""
    of_station = RunRow.station == session_station(session)
    of_kind = [RunRow.kind.in_([kind.value for kind in kinds])] if kinds else []
    conditions = [*of_kind, *([] if ended is None else [RunRow.end_state == ended.value])]
    query = select(RunRow).where(of_station, *conditions).order_by(RunRow.id.desc()).limit(limit)
    return [to_record(Run, row) for row in session.scalars(query)]


def count(session: Session) -> int:
    """Count the runs of the station."""
    query = select(func.count()).select_from(RunRow).where(RunRow.station == session_station(session))
    return session.scalar(query) or 0


def of_numbers(session: Session, run_ids: Sequence[int]) -> list[Run]:
    """Return these runs in this order, without those that are not there."""
    rows = {row.id: row for row in session.scalars(select(RunRow).where(RunRow.id.in_(run_ids)))}
    return [to_record(Run, rows[number]) for number in run_ids if number in rows]


def with_banks(session: Session, bank_ids: Sequence[int], *, limit: int) -> list[int]:
    """Return the numbers of the runs that used one of these banks, newest first."""
    query = select(RunRow.id).where(RunRow.bank_id.in_(bank_ids)).order_by(RunRow.id.desc()).limit(limit)
    return list(session.scalars(query))


def set_note(session: Session, run_id: int, note: str) -> Run:
    """Replace the note, the one part of a run that a person may edit, at its station. Raises UnknownRecordError."""
    row = own(session, run_id)
    row.note = note
    session.flush()
    mark_for_reindex(session, run_id)
    return to_record(Run, row)


def set_evaluation_problem(session: Session, run_id: int, problem: str) -> None:
    """Keep why a run could not be evaluated; empty once it could. Raises UnknownRecordError."""
    require(session, RunRow, run_id, "run").evaluation_problem = problem


def save_walls(session: Session, run_id: int, walls: Sequence[StoredWall]) -> None:
    """Add to a run's settings which walls stood in the joint's way. Raises UnknownRecordError, UnreadableDocumentError.

    Nothing changes where there were none.
    """
    if walls:
        row = require(session, RunRow, run_id, "run")
        earlier = SETTINGS.read(row.settings, f"run {run_id}").walls or ()
        row.settings = {**row.settings, "walls": [vars(wall) for wall in merge_wall_changes(earlier, walls)]}


def end(session: Session, run_id: int, end_state: EndState, detail: str = "") -> Run:
    """Close a run. The first reason stays, except one that was only inferred. Raises UnknownRecordError.

    A run that was given up, or that a second service on the same data took for interrupted, may have gone on: whoever
    heard of its end corrects that.
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
    """Whether runs of the station are not over."""
    of_station = (RunRow.end_state == EndState.RUNNING.value, RunRow.station == session_station(session))
    return session.scalar(select(RunRow.id).where(*of_station).limit(1)) is not None


def close_interrupted(
    session: Session, detail: str = "the service ended while this run was open; found at its next start"
) -> list[int]:
    """Close the station's runs that a crash left open as service_died; return their numbers.

    For whoever knows that nothing plays them: a service's start, or a command in a folder that nobody holds.
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
#
# What was run, by name and in words, from what a stored run was set to.


def run_title(run: Run) -> str:
    """Return what was run, in words on one line; of an experiment that is data its own title."""
    if run.kind != RunKind.EXPERIMENT:
        return run.kind.replace("_", " ").capitalize()
    return escape_line(_get_experiment_part(run, "title")) or "Experiment that cannot be read"


def run_experiment_name(run: Run) -> str:
    """Return what was run as it is called when it is ordered, "" where that cannot be read."""
    return _get_experiment_part(run, "name") if run.kind == RunKind.EXPERIMENT else run.kind


def _get_experiment_part(run: Run, part: str) -> str:
    """Return a part of the experiment that a run has kept, "" where it cannot be read."""
    try:
        return str(json.loads(run.set_to.experiment or "")[part])
    except (UnreadableDocumentError, ValueError, KeyError, TypeError):
        return ""
