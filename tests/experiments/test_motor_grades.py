"""Grades of motor identifications: in the database, in reports, and for old documents without one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.analysis.identification import build_motor_record, identify_motors
from backend.experiments.plans import MotorIdentificationPlan
from backend.identification.models import Grade
from backend.identification.motor import judge_motor
from backend.models.run import Metrics
from backend.models.upgrades import upgrade_quality
from backend.reports.build import build_report
from backend.reports.run_data import RunData
from backend.schemas.run import ChecklistState
from backend.services import lineage
from backend.storage import runs
from backend.storage.database import Session, open_database
from backend.storage.identifications import Identification
from backend.storage.runs import EndState, NewRun, RunKind
from plant.parameters import load_parameters
from tests.reports.tracking_run import BEGAN, PLAN, samples, source_of

NAN = float("nan")


def columns_of(wander_rad: float) -> dict[str, np.ndarray]:
    """Two steps each way of both motors; the angles wander by so much, as a slipping encoder's would."""
    random, t = np.random.default_rng(5), np.arange(1500) * 1e-3
    parts = []
    for voltage in (2.0, -2.0, 5.0, -5.0):
        turned = 2.88 * voltage * (t + 0.22 * np.expm1(-t / 0.22))
        turned = turned + wander_rad * np.cumsum(random.standard_normal(t.size)) / np.sqrt(t.size)
        u = np.concatenate([np.zeros(200), np.full(t.size, voltage), np.full(100, -np.sign(voltage))])
        theta = np.concatenate([np.zeros(200), turned, np.full(100, turned[-1])])
        part = {"u": np.concatenate([np.zeros(100), u]), "theta": np.concatenate([np.zeros(100), theta])}
        part["theta_ref"] = np.concatenate([np.zeros(100), np.full(u.size, np.nan)])
        parts.append(part)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns = {f"{name}_{side}": whole[name] for name in ("u", "theta") for side in ("A", "B")}
    rest = {"F_A": np.zeros(whole["u"].size), "F_B": np.zeros(whole["u"].size), "t": np.arange(whole["u"].size) * 1e-3}
    return columns | rest | {f"theta_{side}_ref": whole["theta_ref"] for side in ("A", "B")}


def stored(wander_rad: float) -> Identification:
    lab, columns = load_parameters("lab"), columns_of(wander_rad)
    run = replace(source_of(samples(PLAN)).run, id=12, kind="motor_identification")
    new = build_motor_record(run, MotorIdentificationPlan(), identify_motors(columns, lab), lab, "0.1.0")
    return Identification(
        id=5, kind=new.kind, run_id=12, data=new.data, method=new.method, options=new.options, model=new.model,
        quality=new.quality, usable=new.usable, verdict=new.verdict, who=new.who, software=new.software,
        created_at=BEGAN,
    )  # fmt: skip


def outcome(found: Identification) -> tuple[str, str]:
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()})
    assert tracked.result is not None
    run = replace(tracked.run, kind="motor_identification")
    result = replace(tracked.result, metrics=Metrics(complete=True, played_s=1.0, planned_s=1.0), criteria=())
    report = build_report(RunData(run, result, tracked.columns, None, found))
    return report.outcome, report.verdict


@pytest.mark.parametrize(
    ("wander_rad", "grade", "passed"),
    [(0.002, Grade.USABLE, "passed"), (0.2, Grade.CAUTION, "incomplete"), (12.0, Grade.UNUSABLE, "failed")],
)
def test_store_and_report_say_the_grade_that_the_errors_give(wander_rad: float, grade: Grade, passed: str) -> None:
    found = stored(wander_rad)
    for side in ("A", "B"):
        errors = [
            found.model[side]["std_errors"][name] / found.model[side]["parameters"][name] for name in ("K_m", "T_m")
        ]
        assert found.quality[side]["grade"] == grade
        assert f"known to ±{100.0 * max(np.abs(errors)):.2g} %" in found.quality[side]["verdict"]
    assert found.usable is (grade is not Grade.UNUSABLE)
    assert outcome(found) == (passed, found.verdict)


def test_a_document_without_a_grade_gets_the_one_that_its_figures_give() -> None:
    found = stored(12.0)
    side = {**found.quality["A"], "verdict": "Usable: K_m and T_m known to ±85 %."}
    del side["grade"]
    quality = upgrade_quality("motor", found.model, {"A": side, "B": side})
    assert [quality[name]["grade"] for name in ("A", "B")] == [Grade.UNUSABLE] * 2
    assert outcome(replace(found, quality=quality))[0] == "failed"


@pytest.mark.parametrize(
    ("K_m", "T_m", "spread", "counts", "misfit"),
    [
        (2.9, 0.2, 85.0, 1.0, 0.1),
        (2.9, 0.2, NAN, 1.0, 0.1),
        (2.9, 0.2, 1.0, NAN, 0.1),
        (2.9, 0.2, 1.0, 1.0, NAN),
        (2.9, 0.2, 1.0, 1.0, 20.0),
        (NAN, 0.2, 1.0, 1.0, 0.1),
        (-2.9, 0.2, 1.0, 1.0, 0.1),
    ],
)
def test_a_motor_can_be_unusable(K_m: float, T_m: float, spread: float, counts: float, misfit: float) -> None:
    assert judge_motor(2.9, 0.2, 1.0, 1.0, 0.1) is Grade.USABLE
    assert judge_motor(K_m, T_m, spread, counts, misfit) is Grade.UNUSABLE


def test_a_note_with_the_word_completed_completes_nothing(tmp_path_factory: pytest.TempPathFactory) -> None:
    lab = load_parameters("lab")
    database = open_database(tmp_path_factory.mktemp("noted"))
    try:
        with database.session() as session:
            new = NewRun(
                RunKind.TRACKING, "simulator", "lab", lab.to_document(), "A. Operator", "0.1.0", note="not completed"
            )
            stopped = runs.create(session, new)
            runs.end(session, stopped.id, EndState.STOPPED)
        with database.reading() as session:
            assert experiment(session, lab.to_document()) is ChecklistState.MISSING
        with database.session() as session:
            done = runs.create(session, replace(new, note=""))
            runs.end(session, done.id, EndState.COMPLETED)
            again = runs.create(session, new)
            runs.end(session, again.id, EndState.TRIPPED)
        with database.reading() as session:
            assert experiment(session, lab.to_document()) is ChecklistState.DONE
            assert [run.id for run in runs.find(session, ended=EndState.COMPLETED)] == [done.id]
    finally:
        database.close()


def experiment(session: Session, parameters: dict[str, Any]) -> ChecklistState:
    return next(step.state for step in lineage.build_checklist(session, parameters, None) if step.name == "experiment")
