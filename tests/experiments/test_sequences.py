"""Experiments that replace sequences of earlier versions: program, metrics and stored runs are unchanged.

``sequences.json`` contains the output of the last version that supported sequences: the segments of their
programs, and the metrics and every hundredth sample of one run.
"""

import asyncio
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.analysis.evaluation import reevaluate_run
from backend.errors import OutOfRangeError
from backend.execution.runner import RunRequest, compile_program, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments import messages
from backend.experiments.library import find_experiment, parse_stored_plan
from backend.experiments.parser import ExperimentError
from backend.experiments.plans import ExperimentPlan, LoopSettings, split_values
from backend.models.settings import SettingError
from backend.models.upgrades import convert_sequence, upgrade_run_settings
from backend.realtime.program import Law, Program, Segment, Shape
from backend.recording.reader import read_recorded_columns
from backend.reports.build import build_metrics_document
from backend.reports.evidence import (
    LAYOUT,
    MANIFEST,
    ReportManifest,
    compute_hashes,
    compute_manifest_hash,
    find_element,
    read_manifest,
    to_element,
)
from backend.reports.rendering import render_report
from backend.reports.run_data import load_source
from backend.reports.verification import AccompanyingFiles, verify_report
from backend.storage import results
from backend.storage.database import Database, open_database
from backend.storage.imports import RUN, build_record_document, parse_required_record
from plant.parameters import load_parameters
from tests.migrations.old_schema import migrated
from tests.refusals import refused_because

BEFORE = "0016_current_documents"
"""The last revision with sequences."""
KNOWN = json.loads(Path(__file__).with_name("sequences.json").read_text(encoding="utf-8"))
RECORDED = KNOWN["recorded"]
GOOD: dict[str, Any] = {"duration_s": 600, "q_ref": 0, "S_ref": 10}
IDEAL = load_parameters("ideal")


def plan_of(*segments: object) -> ExperimentPlan:
    return written(json.dumps(segments))


def written(segments: str) -> ExperimentPlan:
    entry = find_experiment("sequence")
    plan, _ = split_values(entry.settings, entry.make_plan, {"segments": segments})
    assert isinstance(plan, ExperimentPlan)
    return plan


def played(row: list[Any]) -> Segment:
    duration_s, q_ref, S_ref, F_push, shape, period_s = row
    period_s = period_s if shape == Shape.SINE else 1.0  # it had no meaning for other shapes
    return Segment(duration_s, q_ref, S_ref, F_push, Shape(shape), period_s)


@pytest.mark.parametrize("known", KNOWN["programs"])
def test_the_experiment_of_a_sequence_compiles_to_the_program_of_the_sequence(known: dict[str, Any]) -> None:
    plan = written(known["segments"])
    assert plan.program() == Program(Law.CASCADE, tuple(map(played, known["played"])))
    (phase,) = plan.phases()
    assert (phase.name, phase.title, phase.start_s, phase.end_s) == (
        "sequence",
        "Own sequence",
        0.0,
        plan.program().duration_s,
    )
    assert parse_stored_plan("sequence", plan.to_stored_values()) == plan


def test_sequences_with_an_initial_sine_are_read_and_those_beyond_the_range_do_not_start() -> None:
    def start(plan: ExperimentPlan) -> Program:
        return compile_program(lambda number: pytest.fail(f"bank {number}"), IDEAL, plan, LoopSettings().tuning)

    first, far = written(KNOWN["programs"][1]["segments"]), written(KNOWN["programs"][2]["segments"])
    assert start(first) == first.program()
    with refused_because(ExperimentError, "out_of_range", quantity="q_ref", value=3.0) as caught:
        start(far)
    assert caught.value.path == ("phases", 0, "parts", 1)


def test_the_previous_default_sequence_is_the_default_experiment() -> None:
    entry = find_experiment("sequence")
    assert entry.default_plan.program().duration_s == 20.0
    assert entry.default_plan == written(KNOWN["programs"][0]["segments"])
    assert entry.replacement


def test_an_invalid_list_of_segments_is_rejected() -> None:
    for segment in ({**GOOD, "q_ref": "left"}, {**GOOD, "q_reff": 1}, {"duration_s": 1}, {**GOOD, "shape": "jump"}, 3):
        with refused_because(SettingError, "not_a_list_of_segments"):
            plan_of(segment)
    for words in ("step 3", "[]", "{}", '[{"duration_s": 1, "q_ref": 1e999, "S_ref": 10}]', "[" * 10_000):
        with refused_because(SettingError, "not_a_list_of_segments"):
            written(words)
    with refused_because(ExperimentError, "too_many_segments", maximum=1000):
        plan_of(*[{**GOOD, "duration_s": 1}] * 1001)
    with pytest.raises(OutOfRangeError) as refused:
        plan_of(*[GOOD] * 7)
    assert refused.value.label == messages.label_in_segment(segment=7, label=messages.duration_up_to_part())
    assert (refused.value.value, refused.value.maximum, refused.value.unit) == (4200.0, 3600.0, "s")
    with pytest.raises(OutOfRangeError) as refused:
        plan_of(GOOD, {**GOOD, "S_ref": -1})
    assert refused.value.label == messages.label_in_segment(segment=2, label="stiffness reference")
    assert (refused.value.quantity, refused.value.path) == ("S_ref", ("segments", 1, "S_ref"))
    assert (refused.value.value, refused.value.minimum, refused.value.unit) == (-1.0, 1e-4, "N·m/rad")


@pytest.mark.parametrize(
    "plan",
    [
        {"segments": "step 3"},
        {"segments": '[{"duration_s": 1}]'},
        {"segments": json.dumps([GOOD]), "more": 1.0},
        {"segments": 7},
    ],
)
def test_settings_in_an_unknown_form_are_unchanged_and_rejected_by_the_parser(plan: dict[str, Any]) -> None:
    settings = {"plan": plan, "loop": {}, "declared": []}
    assert upgrade_run_settings(settings) == settings
    with refused_because(ExperimentError, "program_in_unknown_form"):
        parse_stored_plan("sequence", plan)


def test_upgraded_settings_contain_the_experiment_and_no_declared_list() -> None:
    segments, other = json.dumps([GOOD]), {"name": "b", "symbol": "b", "unit": "1", "meaning": "weight", "value": 0.0}
    declared = {"name": "segments", "symbol": "segments", "unit": "1", "meaning": "list", "value": segments}
    settings = {"plan": {"segments": segments}, "loop": {"b": 0.0}, "declared": [declared, other], "version": 1}
    upgraded = upgrade_run_settings(settings)
    assert json.loads(upgraded["plan"]["experiment"]) == convert_sequence(segments)
    assert upgraded == {**settings, "plan": {"experiment": upgraded["plan"]["experiment"]}, "declared": [other]}
    assert upgrade_run_settings(upgraded) == upgraded


# A run recorded by an earlier version --------------------------------------------------------------------


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    """Open a database of the previous version that contains run 1 of a sequence."""
    folder, settings = tmp_path_factory.mktemp("recorded"), LoopSettings(seed=7)
    opened = open_database(folder)
    with open_headless_rig(opened, IDEAL, settings) as station:
        request = RunRequest(written(RECORDED["segments"]), settings, "A. Operator")
        outcome = asyncio.run(run_experiment(station, request))
    assert (outcome.run.kind, outcome.run.end_state) == ("sequence", "completed")
    again = migrated(opened, folder, BEFORE)
    yield again
    again.close()


def test_samples_and_metrics_of_an_upgraded_run_are_unchanged(database: Database) -> None:
    columns, missed = read_recorded_columns(database, 1)
    assert (columns["t"].size, missed) == (RECORDED["samples"], 0)
    for name, known in RECORDED["columns"].items():
        np.testing.assert_allclose(columns[name][:: RECORDED["every"]], known, rtol=1e-9, atol=1e-12, err_msg=name)
    with database.reading() as session:
        before = results.newest(session, 1)
    again = reevaluate_run(database, 1).result
    assert before is not None
    assert again is not None
    assert (again.metrics, again.criteria) == (before.metrics, ())
    known = RECORDED["metrics"]
    assert [(one.name, bool(one.reason)) for one in again.metrics.figures] == [
        (one["name"], bool(one["reason"])) for one in known["figures"]
    ]
    for figure, row in zip(again.metrics.figures, known["figures"], strict=True):
        assert figure.value == (None if row["value"] is None else pytest.approx(row["value"], rel=1e-9)), figure.name
    assert again.metrics.steps is not None
    assert [(step.start_s, step.before, step.after) for step in again.metrics.steps] == [
        (step["start_s"], step["before"], step["after"]) for step in known["steps"]
    ]


def test_reports_and_run_records_of_an_earlier_version_are_verified(database: Database) -> None:
    """The settings are restored to the earlier form, with matching hashes."""
    columns, _ = read_recorded_columns(database, 1)
    source = load_source(database, 1)
    earlier = {**source.run.settings, "plan": {"segments": RECORDED["segments"]}}
    page = render_report(source, "html").decode()
    assert verify_report(page, columns).holds
    account = read_manifest(page)
    assert isinstance(account, ReportManifest)
    account = replace(
        account, run=replace(account.run, settings=earlier), made_with={**account.made_with, LAYOUT: "0" * 16}
    )
    hashes = compute_hashes(account, columns)
    assert hashes["settings"] != account.hashes["settings"]
    account = replace(account, hashes=hashes)
    account = replace(account, hashes={**hashes, MANIFEST: compute_manifest_hash(account)})
    metrics = json.dumps(build_metrics_document(source) | {"settings": earlier})
    beside = AccompanyingFiles(metrics=metrics, stored=columns, stored_as="run 1")
    found = verify_report(page.replace(find_element(page), to_element(account)), columns, beside)
    assert (found.holds, found.differences) == (None, ())
    assert ["the visible page" in one for one in found.left_out] == [True]
    with database.reading() as session:
        record = build_record_document(session, RUN, 1)
    assert parse_required_record(RUN, {**record, "settings": earlier}) == record
