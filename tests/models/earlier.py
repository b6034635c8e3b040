"""A migrated database of the last version without document versions."""

import json
from pathlib import Path
from typing import Any

from sqlalchemy import text

from backend.storage.database import Database, open_database
from backend.storage.orm import mark_for_reindex
from plant.parameters import load_parameters
from tests.migrations.old_schema import migrated

BEFORE = "0015_formulas"
"""The last revision with documents of earlier forms."""
AT = "2026-03-04 10:20:30.000000"
FIGURES: list[dict[str, Any]] = [
    {
        "name": "rise_q_s",
        "unit": "s",
        "label": "Rise time of q",
        "definition": "longest 10-90 % time of all q steps",
        "value": None,
        "reason": "no such step was played to its end",
    },
    {"name": "rmse_q", "unit": "rad", "label": "RMSE of q", "definition": "root mean square", "value": 0.25},
]
STEP: dict[str, Any] = {
    "signal": "q",
    "phase": "position",
    "start_s": 2.0,
    "end_s": 4.0,
    "before": 0.0,
    "after": 1.0471975511965976,
    "alone": True,
    "rise_s": None,
    "settling_s": None,
    "overshoot_percent": 0.5,
    "steady_error": None,
    "cross_coupling": 0.01,
}
METRICS: dict[str, Any] = {
    "complete": True,
    "played_s": 28.000000000000004,
    "planned_s": 28.0,
    "figures": FIGURES,
    "steps": [STEP],
    "phases": [{"name": "lead_in", "title": "Lead-in", "start_s": 0.0, "end_s": 2.0}],
}
CRITERIA: list[dict[str, Any]] = [
    {
        "name": "overshoot_q",
        "title": "Overshoot of q",
        "relation": "<",
        "bound": 2.0,
        "figure": None,
        "unit": "%",
        "passed": None,
    }
]


def earlier_database(folder: Path) -> Database:
    """Return a migrated database in which run 1 is a tracking run with a result."""
    database = open_database(folder)
    put_run(database, 1, "tracking", {})
    put_result(database, 1, METRICS, CRITERIA)
    return migrated(database, folder, BEFORE)


def put_run(database: Database, number: int, kind: str, settings: Any) -> None:
    """Insert the row of a completed run."""
    put(
        database,
        "run",
        id=number,
        kind=kind,
        plant="simulator",
        parameters_name="lab",
        parameters=json.dumps(load_parameters("lab").to_document()),
        settings=json.dumps(settings),
        bank_id=None,
        who="Ana",
        software="0.9.0",
        started_at=AT,
        ended_at=AT,
        end_state="completed",
        end_detail="",
        note="",
        evaluation_problem="",
    )


def put_result(database: Database, run: int, metrics: Any, criteria: Any) -> None:
    """Insert the row of a result."""
    put(
        database,
        "result",
        run_id=run,
        metrics=json.dumps(metrics),
        criteria=json.dumps(criteria),
        software="0.9.0",
        created_at=AT,
    )


def put(database: Database, table: str, **values: Any) -> None:
    """Insert one row."""
    names = ", ".join(values)
    marks = ", ".join(f":{name}" for name in values)
    with database.session() as session:
        session.execute(text(f"INSERT INTO {table} ({names}) VALUES ({marks})"), values)
        mark_for_reindex(
            session, *(values[key] for kind, key in (("run", "id"), ("result", "run_id")) if kind == table)
        )
