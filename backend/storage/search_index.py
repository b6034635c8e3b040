"""Maintenance of the tables for the search of runs.

A row is rebuilt whenever a part of its data is stored. ``renew`` builds missing rows and those of earlier versions of
this module.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Any, TypeGuard

from sqlalchemy import Select, delete, insert, or_, select
from sqlalchemy.orm import Session

from backend.models import UnreadableDocumentError, document_digest, judge_run
from backend.storage import results, runs
from backend.storage.orm import (
    VALUE_NAME_MAX,
    BankRow,
    ParameterValueRow,
    RunIndexRow,
    RunRow,
    RunTagRow,
    RunValueRow,
    ValueNameRow,
    require_lengths,
    to_record,
)
from backend.storage.runs import EndState, Run, RunKind, run_experiment_name, run_title
from backend.storage.stations import one_at_a_time

VERSION = 1
"""Version of the rows; a change rebuilds all rows at the next opening of the database."""
NO_OUTCOME = "none"
"""Outcome of a session, and of a run that is not over."""
_NEW_WORDS = "what runs are searched by"
_AT_ONCE = 200
_LONGEST_WORD = 200
"""Longest searchable setting; longer ones are texts rather than values."""


class ValueSource(StrEnum):
    """Source of a value."""

    PARAMETER = "parameter"
    SETTING = "setting"
    METRIC = "metric"


def update(session: Session, run_ids: Sequence[int]) -> None:
    """Rebuild the search entries of runs from their committed state.

    Their rows are locked first, in order: of two transactions that change a run the second one sees the result of the
    first; otherwise both would insert the same rows. Rows that refer to a run may be added meanwhile.
    """
    session.flush()
    numbers = sorted(run_ids)
    for begin in range(0, len(numbers), _AT_ONCE):
        some = numbers[begin : begin + _AT_ONCE]
        locked = select(RunRow.id).where(RunRow.id.in_(some)).order_by(RunRow.id)
        session.execute(locked.with_for_update(key_share=True))
    for number in numbers:
        row = session.get(RunRow, number, populate_existing=True)
        if row is not None:
            _write(session, to_record(Run, row))


def is_behind(session: Session) -> bool:
    """Return whether there are rows to renew."""
    return session.scalar(_behind().limit(1)) is not None


def renew(session: Session) -> int:
    """Build some missing or outdated rows; return how many."""
    found = runs.of_numbers(session, session.scalars(_behind().limit(_AT_ONCE)).all())
    for run in found:
        _write(session, run)
    return len(found)


def _behind() -> Select[int]:
    behind = or_(RunIndexRow.run_id.is_(None), RunIndexRow.version != VERSION)
    return select(RunRow.id).outerjoin(RunIndexRow, RunIndexRow.run_id == RunRow.id).where(behind)


def _write(session: Session, run: Run) -> None:
    metrics, outcome = _index_result(session, run)
    settings = _settings(run)
    tags = list(session.scalars(select(RunTagRow.tag).where(RunTagRow.run_id == run.id)))
    bank = None if run.bank_id is None else session.get(BankRow, run.bank_id)
    digest = document_digest(run.parameters)
    title, experiment = run_title(run), run_experiment_name(run)
    bank_name, bank_version = ("", "") if bank is None else (bank.name, f"{bank.name}@{bank.version}")
    texts = (run.kind.replace("_", " "), experiment, title, run.plant, run.parameters_name, run.who, run.note)
    others = (run.station, run.end_state, run.end_detail, bank_version, *tags)
    session.execute(delete(RunIndexRow).where(RunIndexRow.run_id == run.id))
    session.execute(delete(RunValueRow).where(RunValueRow.run_id == run.id))
    session.execute(
        insert(RunIndexRow).values(
            run_id=run.id,
            version=VERSION,
            station=run.station,
            kind=run.kind.casefold(),
            experiment=experiment.casefold(),
            title=title.casefold(),
            bank_name=bank_name.casefold(),
            bank=bank_version.casefold(),
            plant=run.plant.casefold(),
            parameters=run.parameters_name.casefold(),
            parameters_sha256=digest,
            who=run.who.casefold(),
            started_at=run.started_at,
            lasted_s=None if run.ended_at is None else (run.ended_at - run.started_at).total_seconds(),
            end_state=run.end_state,
            outcome=outcome,
            note=run.note.casefold(),
            words="\n".join((*texts, run.kind, *others)).casefold(),
        )
    )
    _write_values(session, run.id, {ValueSource.SETTING: settings, ValueSource.METRIC: metrics})
    _write_parameters(session, digest, run.parameters)


def _index_result(session: Session, run: Run) -> tuple[dict[str, float | str], str]:
    """Return the numbers of a run's newest result by name, and its outcome."""
    try:
        result = results.newest(session, run.id)
    except UnreadableDocumentError:
        return {}, judge_run(None, ())
    if result is None and (run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING):
        return {}, NO_OUTCOME
    figures = () if result is None else result.metrics.figures
    found: dict[str, float | str] = {item.name: item.value for item in figures if _is_number(item.value)}
    return found, judge_run(None if result is None else result.metrics, () if result is None else result.criteria)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _settings(run: Run) -> dict[str, float | str]:
    """Return the settings of a run by name; booleans as yes or no."""
    try:
        values = {name: value for name, value in run.set_to.get_values().items() if name != "experiment"}
        mode = run.set_to.mode
    except UnreadableDocumentError:
        return {}
    found: dict[str, float | str] = {} if mode is None else {"mode": mode.casefold()}
    for name, value in values.items():
        if isinstance(value, bool):
            found[name] = "yes" if value else "no"
        elif _is_number(value):
            found[name] = float(value)
        elif isinstance(value, str) and len(value) <= _LONGEST_WORD:
            found[name] = value.casefold()
    return found


def _write_values(session: Session, run_id: int, values: Mapping[ValueSource, Mapping[str, float | str]]) -> None:
    rows = [
        {
            "run_id": run_id,
            "name_id": _get_name_number(session, source, name),
            "value": None if isinstance(value, str) else value,
            "word": value if isinstance(value, str) else None,
        }
        for source, named in values.items()
        for name, value in named.items()
        if len(name) <= VALUE_NAME_MAX
    ]
    if rows:
        session.execute(insert(RunValueRow), rows)


def _write_parameters(session: Session, digest: str, document: Mapping[str, Any]) -> None:
    if session.scalar(select(ParameterValueRow.name_id).where(ParameterValueRow.parameters_sha256 == digest).limit(1)):
        return
    rows = [
        {"parameters_sha256": digest, "name_id": _get_name_number(session, ValueSource.PARAMETER, name), "value": value}
        for name, value in dict(iterate_parameters(document)).items()
        if len(name) <= VALUE_NAME_MAX
    ]
    if rows:
        one_at_a_time(session.connection(), _NEW_WORDS)
        insert_new(session, ParameterValueRow, rows)


def iterate_parameters(document: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a parameter set as section.name.

    Of a row of numbers as section.name.0 and so on.
    """
    for section, entries in document.items():
        for name, entry in entries.items() if isinstance(entries, Mapping) else ():
            value = entry.get("value") if isinstance(entry, Mapping) else None
            for place, item in enumerate(value) if isinstance(value, list) else ():
                if _is_number(item):
                    yield f"{section}.{name}.{place}", float(item)
            if _is_number(value):
                yield f"{section}.{name}", float(value)


def _get_name_number(session: Session, source: ValueSource, name: str) -> int:
    """Return the number of a name; new names get one, also with concurrent writers.

    One transaction at a time adds names: two with common names would wait for each other.
    """
    known: dict[tuple[str, str], int] = session.info.setdefault("value_names", {})
    found = known.get((source, name))
    if found is None:
        query = select(ValueNameRow.id).where(ValueNameRow.source == source.value, ValueNameRow.name == name)
        found = session.scalar(query)
        if found is None:
            one_at_a_time(session.connection(), _NEW_WORDS)
            insert_new(session, ValueNameRow, [{"source": source.value, "name": name}])
            found = session.scalars(query).one()
        known[source, name] = found
    return found


def insert_new(session: Session, table: Any, rows: list[dict[str, Any]]) -> None:
    """Insert rows except existing ones. Raises UnfitError for too long texts."""
    for row in rows:
        require_lengths(table, row)
    if session.get_bind().dialect.name == "postgresql":
        from sqlalchemy.dialects.postgresql import insert as postgres_insert

        session.execute(postgres_insert(table).on_conflict_do_nothing(), rows)
    else:
        from sqlalchemy.dialects.sqlite import insert as sqlite_insert

        session.execute(sqlite_insert(table).on_conflict_do_nothing(), rows)
