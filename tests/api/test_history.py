"""Lineage, marks and checklist through the interface, and the checklist's rules on a database of its own."""

import math
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.banks.tuning_settings import saved_tuning_key
from backend.models.run import SAVED_TUNING, SavedLoopSettings
from backend.schemas.run import ChecklistState
from backend.services.lineage import build_checklist
from backend.storage import banks, identifications, runs, settings
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.storage.identifications import NewIdentification
from backend.storage.runs import EndState, NewRun, RunKind
from backend.units import AngleUnit, format_text
from tests.api.conftest import until, wait_for
from tests.models.earlier_identifications import ACTUATOR

PARAMETERS = {"r_m": 0.0075}


def test_a_session_tells_its_origin_and_what_happened_in_it(running: httpx.Client) -> None:
    run = running.get("/api/state").json()["recording_run"]
    running.put("/api/references", json={"q_ref": math.radians(15.0), "S_ref": 10.25}).raise_for_status()
    running.post("/api/mode", json={"mode": "stopping"}).raise_for_status()
    wait_for(running, "mode", "off")

    def about_references() -> list[dict[str, Any]]:
        marks = running.get(f"/api/runs/{run}/marks").raise_for_status().json()["marks"]
        return [mark for mark in marks if mark["text"].startswith("q_ref ")]

    [mark] = until(about_references)  # the journal writes by itself, the samples follow
    assert format_text(mark["text"], AngleUnit.DEGREES) == "q_ref 15°, S_ref 10.25 N·m/rad"
    assert 0.0 <= mark["t"] < 60.0
    assert mark["who"] == "operator"
    lineage = running.get(f"/api/runs/{run}/lineage").raise_for_status().json()
    assert (lineage["bank"], lineage["parameters_as_now"]) == (None, True)
    assert running.get("/api/runs/999999/lineage").status_code == 404
    assert running.post(f"/api/runs/{run}/replay", json={"t": 0.1}).status_code == 204
    assert running.post("/api/runs/999999/replay", json={"t": 0.1}).status_code == 404


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


def identified(database: Database, kind: RunKind, parameters: dict[str, Any] = PARAMETERS, S: float = 10.5) -> int:
    """Store a completed identification and return the number of its estimate."""
    run = completed(database, kind, parameters)
    new = NewIdentification(
        kind=kind.removesuffix("_identification"),
        run_id=run,
        data={},
        method="oe",
        options={},
        model=ACTUATOR["model"] | {"S_nominal": S},
        quality=ACTUATOR["quality"],
        usable=True,
        verdict="usable",
        who="a",
        software="0",
    )
    with database.session() as session:
        return identifications.add(session, new).id


def completed(
    database: Database, kind: RunKind, parameters: dict[str, Any] = PARAMETERS, bank: int | None = None
) -> int:
    with database.session() as session:
        new = NewRun(
            kind=kind,
            plant="simulator",
            parameters_name="lab",
            parameters=parameters,
            who="a",
            software="0",
            settings={},
            bank_id=bank,
        )
        run = runs.create(session, new).id
        runs.end(session, run, EndState.COMPLETED)
        return run


def built(database: Database, estimate: int) -> int:
    with database.session() as session:
        return banks.add(session, "bench", [BankEntry(10.5, {"S_nominal": 10.5}, estimate)], "a").id


def states(database: Database, in_use: int | None, parameters: dict[str, Any] = PARAMETERS) -> dict[str, str]:
    with database.reading() as session:
        return {step.name: str(step.state) for step in build_checklist(session, parameters, in_use)}


def test_the_checklist_leads_from_pretension_to_report(database: Database) -> None:
    assert set(states(database, None).values()) == {"missing"}
    identified(database, RunKind.MOTOR_IDENTIFICATION)
    identified(database, RunKind.SPRING_IDENTIFICATION)
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    assert states(database, None)["bank"] == "missing"  # built but not in use, which is to be done and not out of date
    completed(database, RunKind.TRACKING, bank=bank)
    told = states(database, bank)
    assert (told.pop("report"), told.pop("tuning")) == ("missing", "missing")
    assert set(told.values()) == {"done"}


def test_a_tuning_is_done_once_it_is_saved_for_the_bank_in_use(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    other = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION, S=14.0))
    with database.session() as session:
        value = SAVED_TUNING.write(SavedLoopSettings(lam_q=0.45, lam_S=0.1, bank=bank))
        settings.save(session, saved_tuning_key(bank), value, "Ada")
    with database.reading() as session:
        [step] = [one for one in build_checklist(session, PARAMETERS, bank) if one.name == "tuning"]
    assert (step.state, step.run) == (ChecklistState.DONE, None)
    assert re.fullmatch(r"λ_q = 0\.45 s, λ_S = 0\.1 s, saved for \w+ v\d by Ada", step.detail)
    assert states(database, other)["tuning"] == "missing"
    assert states(database, None)["tuning"] == "missing"


def test_a_bank_older_than_the_parameters_is_out_of_date(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    assert states(database, bank)["bank"] == "done"
    told = states(database, bank, {"r_m": 0.008})
    assert (told["actuator"], told["bank"]) == ("outdated", "outdated")


def test_what_was_identified_again_makes_the_later_steps_out_of_date(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    completed(database, RunKind.TRACKING, bank=bank)
    identified(database, RunKind.ACTUATOR_IDENTIFICATION, S=14.0)  # another point
    assert states(database, bank)["bank"] == "done"
    identified(database, RunKind.ACTUATOR_IDENTIFICATION)
    assert states(database, bank)["bank"] == "outdated"
    identified(database, RunKind.MOTOR_IDENTIFICATION)
    assert states(database, bank)["actuator"] == "outdated"
    assert states(database, built(database, 1))["experiment"] == "outdated"
