"""Documents of a run: settings, plant, result and headline."""

import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from backend.banks.builder import BankError, require_same_parameters
from backend.banks.tuning_settings import TuningSettings
from backend.experiments.plans import LoopSettings
from backend.models.document import UnreadableDocumentError
from backend.models.run import (
    CRITERIA,
    METRICS,
    PLANT_NUMBERS,
    SETTINGS,
    MeasuredFigure,
    Metrics,
    RunCriterion,
    StoredLoopSettings,
    StoredPlantNumber,
    find_headline,
)
from backend.models.upgrades import NO_STORED_REASON
from backend.reports.build import build_metrics_document, build_report
from backend.reports.run_data import load_source
from backend.services.identifications import StoredIdentifications
from backend.services.runs import RunQuery, StoredRuns
from backend.services.tuning_state import default_tuning
from backend.storage import results, runs
from backend.storage.database import Database, open_database
from backend.storage.results import NewResult
from backend.workers import WorkerProcess
from plant.parameters import SHIPPED, load_parameters
from tests.migrations.old_schema import migrated
from tests.models import earlier
from tests.models.earlier import BEFORE, earlier_database, put_result, put_run
from tests.refusals import refused

# Headline of a run: the failed criterion, otherwise the first measured metric.

PASSED = RunCriterion("settling_q_s", "Settling of q", "<", 2.0, 1.5, "s", True)
FAILED = RunCriterion("overshoot_q_percent", "Overshoot of q", "<", 2.0, 3.5, "%", False)
UNSEEN = RunCriterion("min_tension_N", "Smallest tension", ">", 1.0, None, "N", None, "the run ended early")
GAP = MeasuredFigure("rise_q_s", "s", "Rise of q", "10 to 90 %", None, "no step")
PEAK = MeasuredFigure("peak_voltage_V", "V", "Peak voltage", "largest |u|", 6.5)


@pytest.mark.parametrize(
    ("figures", "criteria", "shown"),
    [
        ((PEAK,), (PASSED, FAILED), ("overshoot_q_percent", 3.5, "<", 2.0)),
        ((PEAK,), (UNSEEN, PASSED), ("settling_q_s", 1.5, "<", 2.0)),
        ((GAP, PEAK), (UNSEEN,), ("peak_voltage_V", 6.5, "", None)),
        ((GAP,), (), None),
        (None, (), None),
    ],
)
def test_the_headline_is_the_failed_criterion_or_the_first_measured_metric(
    figures: tuple[MeasuredFigure, ...] | None,
    criteria: tuple[RunCriterion, ...],
    shown: tuple[str, float, str, float | None] | None,
) -> None:
    metrics = None if figures is None else Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=figures)
    found = find_headline(metrics, criteria)
    assert (None if found is None else (found.name, found.value, found.relation, found.bound)) == shown


def test_the_headline_of_an_identification_is_its_lowest_fit() -> None:
    metrics = Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=(PEAK,))
    found = find_headline(metrics, (), {"G_q": 97.2, "G_S": 91.4})
    assert found is not None
    assert (found.name, found.label, found.value, found.unit) == ("fit_percent", "Fit of G_S", 91.4, "%")
    judged = find_headline(metrics, (PASSED,), {"G_q": 97.2})
    assert judged is not None
    assert judged.name == "settling_q_s"


# Plant parameters that a run stores.


@pytest.mark.parametrize("name", SHIPPED)
def test_stored_plant_parameters_are_read_back_unchanged(name: str) -> None:
    parameters = load_parameters(name)
    recorded = PLANT_NUMBERS.read(json.loads(json.dumps(parameters.to_document())), "run 1")
    assert recorded["motor"]["u_max"] == StoredPlantNumber(
        parameters.motor.u_max, "V", parameters.sources.get("motor.u_max", "")
    )
    assert recorded["geometry"]["r_j"].value == parameters.geometry.r_j
    assert PLANT_NUMBERS.write(recorded) == parameters.to_document()


def test_a_plant_parameter_may_lack_unit_and_source() -> None:
    assert PLANT_NUMBERS.read({"motor": {"u_max": {"value": 10.0}}}, "run 1")["motor"]["u_max"].value == 10.0


def test_an_invalid_plant_parameter_is_rejected_with_its_field() -> None:
    values = {"owner": "run 3", "label": "the parameters of its plant", "field": "motor.u_max"}
    with refused(UnreadableDocumentError, "document_unreadable", **values):
        PLANT_NUMBERS.read({"motor": {"u_max": 10.0}}, "run 3")


@pytest.mark.parametrize("then", [11.0, None])
def test_one_different_parameter_identifies_another_plant(then: float | None) -> None:
    parameters = load_parameters("lab")
    recorded = parameters.to_document()
    if then is None:
        del recorded["motor"]["u_max"]
    else:
        recorded = replace(parameters, motor=replace(parameters.motor, u_max=then)).to_document()
    values = {"parameter": "motor.u_max", "recorded": then, "current": parameters.motor.u_max}
    with refused(BankError, "other_parameters", **values):
        require_same_parameters(parameters, "identification 3", recorded)


# Settings of runs are read and written unchanged; runs with unreadable settings are listed.

LOOP = {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "b": 0.0, "bank": 0, "interpolate": False, "seed": 7}
PROGRAM: dict[str, Any] = {
    "plan": {"tension_N": 20.0, "bits": 7, "estimator": "default"},
    "loop": LOOP,
    "declared": [{"name": "b", "symbol": "b", "unit": "1", "meaning": "weight of the reference", "value": 0.0}],
    "versions": {"Python": "3.11.2"},
}
SESSION: dict[str, Any] = {"mode": "run", "loop": {name: LOOP[name] for name in LOOP if name != "seed"}}
EARLY_SESSION: dict[str, Any] = {"mode": "run", "lam_q": 0.5, "lam_S": 0.42, "interpolate": False, "bank": None}
TUNING = default_tuning(load_parameters("ideal"))[0]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    put_run(opened, 1, "actuator_identification", PROGRAM)
    put_run(opened, 2, "session", EARLY_SESSION)
    with closing(migrated(opened, tmp_path, BEFORE)) as found:
        yield found


def test_stored_loop_settings_contain_the_whole_tuning_and_the_seed() -> None:
    assert [part.name for part in fields(StoredLoopSettings)] == [part.name for part in fields(LoopSettings)]
    recorded = StoredLoopSettings(**asdict(LoopSettings(lam_q=0.6, bank=3, seed=4)))
    assert TuningSettings.from_values(recorded.get_known_values()) == TuningSettings(lam_q=0.6, bank=3)
    assert recorded.get_known_values()["seed"] == 4


@pytest.mark.parametrize("document", [PROGRAM, SESSION])
def test_reading_and_writing_settings_only_adds_the_version(document: dict[str, Any]) -> None:
    written = SETTINGS.write(SETTINGS.read(document, "run 7"))
    assert written == {**document, "version": 1}
    assert list(written)[:-1] == list(document)
    assert type(written.get("plan", {}).get("bits", 7)) is int


def test_settings_of_early_sessions_are_upgraded(database: Database) -> None:
    with database.reading() as session:
        settings_read = runs.get(session, 2).set_to
    assert (settings_read.mode, settings_read.plan, settings_read.declared) == ("run", None, None)
    assert settings_read.loop == StoredLoopSettings(lam_q=0.5, lam_S=0.42, interpolate=False)
    assert settings_read.get_values() == {"lam_q": 0.5, "lam_S": 0.42, "interpolate": False}


@pytest.mark.parametrize(
    ("settings", "code", "values"),
    [
        ({**PROGRAM, "version": 2}, "document_of_newer_version", {"version": 2}),
        ({**PROGRAM, "loop": {**LOOP, "b": "half"}}, "document_unreadable", {"field": "loop.b"}),
        ([], "document_unreadable", {}),
    ],
)
def test_unreadable_settings_are_reported_in_the_lists_with_run_and_field(
    database: Database, settings: Any, code: str, values: dict[str, object]
) -> None:
    put_run(database, 3, "actuator_identification", settings)
    with database.reading() as session, pytest.raises(UnreadableDocumentError) as caught:
        assert runs.get(session, 3).set_to
    message = caught.value.message
    assert (message.code, message.values) == (
        code,
        {**message.values, **values, "owner": "run 3", "label": "its settings"},
    )
    stored = StoredRuns(database, lambda: None, lambda _run: False)
    listed = stored.find_runs(RunQuery(limit=10)).runs
    assert [(run.id, len(run.settings)) for run in listed] == [
        (3, 0),
        (2, 3),
        (1, 0),
    ]  # an identification uses λ_motor alone
    assert message in listed[0].evaluation_problem
    found = StoredIdentifications(
        database, lambda _run: 1.0, WorkerProcess(print), lambda: TUNING
    ).list_identifications()
    assert [(one.id, one.tension_N) for one in found] == [(3, None), (1, 20.0)]
    assert message in found[0].message


def test_a_missing_plant_parameter_is_reported_by_name(database: Database) -> None:
    with database.reading() as session:
        run = runs.get(session, 1)
    assert run.number("geometry", "r_j") == 0.075
    with refused(UnreadableDocumentError, "parameter_missing", run_id=1, parameter="safety.F_least"):
        run.number("safety", "F_least")


# Results of earlier versions are shown; unreadable results are reported, and the list of runs still opens.


@pytest.fixture
def database_result(tmp_path: Path) -> Iterator[Database]:
    opened = earlier_database(tmp_path)
    yield opened
    opened.close()


def test_a_result_without_reasons_is_read_with_a_default_reason(database_result: Database) -> None:
    source = load_source(database_result, 1)
    assert source.result is not None
    metrics, criteria = source.result.metrics, source.result.criteria
    assert (metrics.complete, metrics.played_s, metrics.problem) == (True, 28.000000000000004, "")
    assert metrics.definitions == 0
    assert [item.reason for item in metrics.figures] == ["no such step was played to its end", ""]
    assert metrics.steps is not None
    assert (metrics.steps[0].overshoot_percent, metrics.steps[0].reach_s, metrics.steps[0].reasons) == (0.5, None, {})
    assert [item.reason for item in criteria] == [NO_STORED_REASON]
    assert build_metrics_document(source)["criteria"] == [{**earlier.CRITERIA[0], "reason": NO_STORED_REASON}]
    assert build_report(source).outcome == "incomplete"


def test_rewriting_a_result_only_adds_version_and_reasons(database_result: Database) -> None:
    with database_result.session() as session:
        read = results.newest(session, 1)
        assert read is not None
        results.add(session, NewResult(1, read.metrics, read.criteria, "1.0.0"))
        row = session.execute(text("SELECT metrics, criteria FROM result ORDER BY id DESC LIMIT 1")).one()
    metrics, criteria = json.loads(row.metrics), json.loads(row.criteria)
    assert metrics.pop("version") == 1
    assert {name: metrics[name] for name in earlier.METRICS if name not in ("figures", "steps")} == {
        name: value for name, value in earlier.METRICS.items() if name not in ("figures", "steps")
    }
    assert metrics["figures"] == [earlier.FIGURES[0], {**earlier.FIGURES[1], "reason": ""}]
    assert criteria == [{**earlier.CRITERIA[0], "reason": NO_STORED_REASON}]


@pytest.mark.parametrize(
    ("metrics", "criteria", "code", "values"),
    [
        ({**earlier.METRICS, "version": 2}, [], "document_of_newer_version", {"label": "its result", "version": 2}),
        (
            {**earlier.METRICS, "played_s": "long"},
            [],
            "document_unreadable",
            {"label": "its result", "field": "played_s", "reason": "it should be a valid number"},
        ),
        (
            {**earlier.METRICS, "figures": [{"name": "rmse_q"}]},
            [],
            "document_unreadable",
            {"field": "figures.0.unit", "reason": "it is missing"},
        ),
        (
            {**earlier.METRICS, "figures": 3},
            [],
            "document_unreadable",
            {"field": "figures", "reason": "it should be a valid array"},
        ),
        ([], [], "document_unreadable", {"label": "its result"}),
        (
            earlier.METRICS,
            [{**earlier.CRITERIA[0], "bound": None}],
            "document_unreadable",
            {"label": "its criteria", "field": "0.bound"},
        ),
    ],
)
def test_unreadable_results_are_reported_with_run_and_field(
    database_result: Database, metrics: Any, criteria: Any, code: str, values: dict[str, object]
) -> None:
    put_result(database_result, 1, metrics, criteria)
    with refused(UnreadableDocumentError, code, owner="run 1", **values):
        load_source(database_result, 1)
    stored = StoredRuns(database_result, lambda: None, lambda _run: False)
    listed = stored.find_runs(RunQuery(limit=10))
    assert [run.id for run in listed.runs] == [1]


@pytest.mark.parametrize("version", ["1", 1.5, True, -1])
def test_invalid_version_numbers_are_rejected(version: Any) -> None:
    values = {"owner": "run 7", "label": "its result", "field": "version"}
    with refused(UnreadableDocumentError, "document_unreadable", **values):
        METRICS.read({**earlier.METRICS, "version": version}, "run 7")


def test_criteria_are_written_as_they_were_read() -> None:
    read = CRITERIA.read([{**earlier.CRITERIA[0], "reason": "no number"}], "run 7")
    assert CRITERIA.write(read) == [{**earlier.CRITERIA[0], "reason": "no number"}]
