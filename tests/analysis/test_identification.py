"""Identifications of runs: friction over the load, one estimate each, grades, names."""

import json
import re
import shlex
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from backend.analysis.identification import (
    build_actuator_record,
    build_friction_document,
    build_motor_record,
    estimate_run_friction,
    identify_actuator,
    identify_motors,
)
from backend.banks.builder import BankError, build_bank
from backend.cli import app, main
from backend.experiments.plans import ActuatorIdentificationPlan, MotorIdentificationPlan
from backend.identification import messages as identification_messages
from backend.identification.actuator import ActuatorIdentification
from backend.identification.fitting import Method
from backend.identification.models import Grade
from backend.identification.motor import judge_motor
from backend.models.identification import ChannelName
from backend.models.run import Metrics
from backend.models.upgrades import upgrade_quality
from backend.recording.reader import Columns
from backend.reports.build import build_report
from backend.reports.identification_report import build_estimate_command
from backend.reports.model import Code, Paragraph, Report, Table
from backend.reports.provenance import lineage as lineage_names
from backend.reports.run_data import RunData, load_source
from backend.reports.sections import identifications_section
from backend.schemas.run import ChecklistState
from backend.services import lineage
from backend.services.banks import _build_entry_lineage
from backend.services.runs import build_bank_view
from backend.storage import banks, identifications, runs
from backend.storage.database import Database, Session, open_database
from backend.storage.identifications import Identification, NewIdentification
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import EndState, NewRun, Run, RunKind
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.exports.written import to_csv
from tests.identification.test_friction import C0, C1, computed
from tests.models.earlier_identifications import ACTUATOR, MODEL
from tests.refusals import refused
from tests.reports.test_identification_report import identification
from tests.reports.tracking_run import BEGAN, PLAN, samples, source_of

# Load-dependent friction from stored runs: selection of runs, result, and report of a series.

SETTINGS = {"amplitude_rad": 1.0, "chip_s": 0.08, "bits": 5, "periods": 2, "settle_s": 8.0, "estimator": "default"}
BEFORE = 700


def played(number: int, tension_N: float, **changes: Any) -> tuple[Run, Columns]:
    """Return a run with this number: rest, then a motor in closed form during the excitation."""
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()}).run
    settings = {**tracked.settings, "plan": {**SETTINGS, "tension_N": tension_N}}
    run = replace(tracked, id=number, kind="actuator_identification", settings=settings, **changes)
    excited = round(ActuatorIdentificationPlan(bits=5).excitation().duration_s * 1000)
    columns = computed(number, tension_N, samples=excited).columns
    rested = {name: np.concatenate((np.full(BEFORE, values[0]), values)) for name, values in columns.items()}
    return run, {"t": np.arange(BEFORE + excited) * 1e-3, **rested}


def test_runs_at_two_tensions_give_the_friction_of_motor_A() -> None:
    found = estimate_run_friction([played(3, 12.0), played(4, 31.0)])
    assert found.estimate is not None
    assert found.estimate.runs == (3, 4)
    assert abs(found.estimate.c0 - C0) < 0.02 * C0
    assert abs(found.estimate.c1 - C1) < 0.02 * C1
    assert build_friction_document(found)["estimate"]["runs"] == (3, 4)


def test_runs_of_another_rig_and_runs_that_ended_early_are_left_out() -> None:
    other, early = played(2, 31.0, plant="rig"), played(3, 31.0, end_state=EndState.STOPPED.value)
    run, columns = played(4, 31.0)
    t = np.array(columns["t"])
    t[BEFORE + 100 :] += 0.005
    holes = run, {**columns, "t": t}
    found = estimate_run_friction([other, early, holes, played(5, 12.0)])
    assert found.estimate is None
    assert found.problem
    assert [reason.partition(":")[0] for reason in found.left_out] == ["run 2", "run 3", "run 4"]
    assert build_friction_document(found)["estimate"] is None


def test_the_report_of_a_series_has_the_friction_or_a_reason() -> None:
    made = [
        RunData(run, None, columns, None, replace(identification(), run_id=run.id))
        for run, columns in (played(3, 12.0), played(4, 31.0))
    ]
    assert list_friction_sentences(made) == [estimate_run_friction([(one.run, one.columns) for one in made]).sentence]
    assert "not measured" in list_friction_sentences(made[:1])[0]


def list_friction_sentences(made: list[RunData]) -> list[str]:
    (section,) = identifications_section(made)
    words = (block.text for block in section.blocks if isinstance(block, Paragraph))
    return [text.partition(". Motor B")[0] for text in words if "friction" in text and "Motor B" in text]


# Stored estimate, report and data file of a run agree.

CHANNELS = ("G_q", "G_S")
REST = 1_500
LAG_S = 0.0854
PLAY_RAD = 0.4


def columns_of(plan: ActuatorIdentificationPlan) -> dict[str, np.ndarray]:
    """Return samples of four lags in counts: the joint has play, as with Coulomb friction; the stiffness has none."""
    excitation = plan.excitation()
    levels = np.array([1.0 if level == "+" else -1.0 for level in excitation.levels])
    chips = np.repeat(np.tile(levels, excitation.periods), round(excitation.chip_s / T_s))
    u = np.concatenate([np.zeros(REST), chips])
    theta, pole = u, np.exp(-T_s / LAG_S)
    for _ in range(4):
        theta = np.array([state := 0.0] + [state := pole * state + (1 - pole) * value for value in theta[:-1]])
    followed, at = np.empty(theta.size), 0.0
    for k, value in enumerate(theta):
        at = min(max(at, value - PLAY_RAD / 2.0), value + PLAY_RAD / 2.0)
        followed[k] = at
    count_q, count_theta = 2 * np.pi / 4000, 2 * np.pi / 8000
    return {
        "t": np.arange(u.size) * T_s,
        "theta_A_ref": 9.0 + u,
        "q": np.round((0.47 + 0.05 * followed) / count_q) * count_q,
        "S": 10.5 + 0.7209 * np.round(theta / count_theta) * count_theta,
        "F_A": np.full(u.size, 20.0),
        "F_B": np.full(u.size, 20.0),
    }


@pytest.fixture(scope="module")
def record() -> dict[str, np.ndarray]:
    return {
        name: values.astype(np.float32).astype(float)
        for name, values in columns_of(ActuatorIdentificationPlan()).items()
    }


@pytest.fixture(scope="module")
def found(record: dict[str, np.ndarray]) -> Identification:
    return stored(record, ActuatorIdentificationPlan())


@pytest.fixture(scope="module")
def by_arx(record: dict[str, np.ndarray]) -> Identification:
    return stored(record, ActuatorIdentificationPlan(estimator=Method.ARX))


def stored(record: dict[str, np.ndarray], plan: ActuatorIdentificationPlan) -> Identification:
    run = replace(source_of(samples(PLAN)).run, id=12)
    new = build_actuator_record(run, plan, record, _identified(record, plan), "0.1.0")
    document = json.loads(json.dumps({name: getattr(new, name) for name in ("data", "options", "model", "quality")}))
    return Identification(
        id=5, kind=new.kind, run_id=12, method=new.method, usable=new.usable, verdict=new.verdict, who=new.who,
        software=new.software, created_at=BEGAN, **document,
    )  # fmt: skip


def _identified(record: dict[str, np.ndarray], plan: ActuatorIdentificationPlan) -> ActuatorIdentification:
    return identify_actuator(record, plan.excitation(), load_parameters("lab"), Method(plan.estimator))


def report_of(found: Identification, record: dict[str, np.ndarray]) -> Report:
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()})
    assert tracked.result is not None
    run = replace(
        tracked.run, kind="actuator_identification", settings={**tracked.run.settings, "plan": {"tension_N": 20.0}}
    )
    result = replace(tracked.result, metrics=Metrics(complete=True, played_s=1.0, planned_s=1.0), criteria=())
    return build_report(RunData(run, result, record, None, found))


def words_of(report: Report) -> str:
    blocks = [block for section in report.sections for block in section.blocks]
    return " ".join(block.text for block in blocks if isinstance(block, Paragraph | Code))


def test_the_report_names_the_estimator_of_each_channel(found: Identification, record: dict[str, np.ndarray]) -> None:
    methods = {key: found.model[key]["method"] for key in CHANNELS}
    assert methods == {
        "G_q": identification_messages.output_error(noise_order=8, is_low_pass=False),
        "G_S": identification_messages.output_error(noise_order=0, is_low_pass=True),
    }
    named = identification_messages.methods_of_channels(methods=methods)
    assert found.method == named
    assert f"Method: {named}." in words_of(report_of(found, record))


def test_the_report_of_an_earlier_identification_names_the_method_of_both_channels(
    found: Identification, record: dict[str, np.ndarray]
) -> None:
    old = replace(found, method=found.model["G_S"]["method"])
    assert f"Method: {found.method}." in words_of(report_of(old, record))


def test_model_estimate_report_and_bank_name_the_papers_arx_method(
    by_arx: Identification, record: dict[str, np.ndarray]
) -> None:
    """A bank states the estimation method of each entry."""
    named = identification_messages.arx_with_prefilter()
    assert by_arx.method == named
    for key in CHANNELS:
        assert by_arx.model[key]["method"] == named
        assert by_arx.model[key]["structure"] == "first"
        assert by_arx.model[key]["first_order"]["K"] == by_arx.quality[key]["arx"]["K"]
    assert by_arx.options["estimator"] == "arx"
    assert f"Method: {named}." in words_of(report_of(by_arx, record))


@pytest.mark.parametrize("estimator", ["found", "by_arx"])
@pytest.mark.parametrize("key", CHANNELS)
def test_the_command_in_the_report_reproduces_the_estimate_from_the_data_file(
    key: ChannelName,
    estimator: str,
    request: pytest.FixtureRequest,
    record: dict[str, np.ndarray],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found: Identification = request.getfixturevalue(estimator)
    command = build_estimate_command(found, key)
    assert command in words_of(report_of(found, record))
    (tmp_path / "data.csv").write_bytes(to_csv(record))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [*shlex.split(command.replace("\\\n", "")), "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    assert printed["method"] == found.model[key]["method"]
    stored, std_errors = found.model[key]["parameters"], found.model[key]["std_errors"]
    assert list(printed["parameters"]) == list(stored)
    # The file has single precision, and the search stops within a thousandth of a standard error.
    assert all(abs(value - stored[name]) < 1e-2 * std_errors[name] for name, value in printed["parameters"].items())
    assert printed["std_errors"] == pytest.approx(std_errors, rel=1e-3)
    assert printed["verdict"] == found.quality[key]["verdict"]
    assert printed["grade"] == found.quality[key]["grade"]
    assert re.search(r"--resolution 0\.00", command)


# Grades of motor identifications: in the database, in reports, and for old documents without one.

NAN = float("nan")


def columns_of_grades(wander_rad: float) -> dict[str, np.ndarray]:
    """Return two steps of both motors in each direction; the angles drift like those of a slipping encoder."""
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


def stored_grades(wander_rad: float) -> Identification:
    lab, columns = load_parameters("lab"), columns_of_grades(wander_rad)
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
def test_database_and_report_contain_the_grade_that_follows_from_the_errors(
    wander_rad: float, grade: Grade, passed: str
) -> None:
    found = stored_grades(wander_rad)
    for side in ("A", "B"):
        errors = [
            found.model[side]["std_errors"][name] / found.model[side]["parameters"][name] for name in ("K_m", "T_m")
        ]
        assert found.quality[side]["grade"] == grade
        spread = identification_messages.steps_give_std_errors(spread_percent=100.0 * max(np.abs(errors)))
        assert spread in found.quality[side]["verdict"]
    assert found.usable is (grade is not Grade.UNUSABLE)
    assert outcome(found) == (passed, found.verdict)


def test_the_grade_of_an_old_document_is_derived_from_its_errors() -> None:
    found = stored_grades(12.0)
    side = {**found.quality["A"], "verdict": "Usable: standard errors of K_m and T_m within ±85 %."}
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


def test_the_word_completed_in_a_note_does_not_mark_a_run_as_completed(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
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


# Banks, rejections, command line and reports name an identification by the number of its run.

PARAMETERS = load_parameters("ideal")
POINTS = {4: (10.0, 8.24), 5: (20.0, 10.55), 6: (30.0, 12.43)}
"""Tension [N] and stiffness [N·m/rad] by the number of the run; the estimates' own numbers are 2, 3 and 4."""


def new_run(kind: RunKind, bank_id: int | None = None) -> NewRun:
    return NewRun(
        kind=kind,
        who="Ana",
        plant="simulator",
        parameters_name="ideal",
        parameters=PARAMETERS.to_document(),
        software="0.1.0",
        settings={},
        bank_id=bank_id,
    )


def estimate(run_id: int, *, usable: bool = True) -> NewIdentification:
    tension_N, S = POINTS[run_id]
    channels = {name: MODEL | {"first_order": {"K": K, "T": 0.342}} for name, K in (("G_q", 0.05), ("G_S", 0.7209))}
    return NewIdentification(
        kind="actuator",
        run_id=run_id,
        data={},
        method="output error",
        options={"tension_N": tension_N},
        model={"S_nominal": S} | channels,
        quality=ACTUATOR["quality"],
        usable=usable,
        verdict="fits badly",
        who="Ana",
        software="0.1.0",
    )


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """Three runs without an estimate, then a spring's table, then three identifications."""
    opened = open_database(tmp_path)
    with opened.session() as session:
        for _ in range(3):
            runs.create(session, new_run(RunKind.TRACKING))
        identifications.add(session, replace(estimate(4), kind="spring", run_id=None))
        for number in POINTS:
            assert runs.create(session, new_run(RunKind.ACTUATOR_IDENTIFICATION)).id == number
            assert identifications.add(session, estimate(number)).id == number - 2
    yield opened
    opened.close()


def test_bank_command_line_and_report_name_the_same_runs(database: Database, tmp_path: Path) -> None:
    bank = build_bank(database, PARAMETERS, "bench", list(POINTS), "Ana")
    with database.session() as session:
        view = build_bank_view(bank, identifications.find_estimate_runs(session), {}, None)
        follower = runs.create(session, new_run(RunKind.TRACKING, bank.id))
    assert [entry.identification for entry in view.entries] == list(POINTS)

    shown = CliRunner().invoke(app, ["bank", "show", str(bank.id), "--json", "--data", str(tmp_path)])
    assert [entry["identification"] for entry in json.loads(shown.stdout)["entries"]] == list(POINTS)

    with database.reading() as session:
        lines = [_build_entry_lineage(session, entry) for entry in bank.entries]
    assert [(line.identification, line.run, line.method) for line in lines if line] == [
        (number, number, "output error") for number in POINTS
    ]

    (table,) = lineage_names(load_source(database, follower.id))
    assert isinstance(table, Table)
    assert [(row[0], row[-3]) for row in table.rows] == [
        (f"{tension_N:g} N", f"identification {number}") for number, (tension_N, _) in POINTS.items()
    ]


def test_a_bank_uses_the_newest_estimate_of_a_run_and_rejections_name_the_run(database: Database) -> None:
    with database.session() as session:
        again = identifications.add(session, estimate(5))
        identifications.add(session, estimate(6, usable=False))
    bank = build_bank(database, PARAMETERS, "bench", [4, 5], "Ana")
    with database.reading() as session:
        assert [entry.identification_id for entry in banks.get(session, bank.id).entries] == [2, again.id]
    with refused(BankError, "not_usable", source="identification 6"):
        build_bank(database, PARAMETERS, "bench", [4, 6], "Ana")
    with refused(UnknownRecordError, "identification_without_model", run_id=2):
        build_bank(database, PARAMETERS, "bench", [2], "Ana")
