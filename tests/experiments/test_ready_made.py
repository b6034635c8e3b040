"""The ready-made experiments run, pass their criteria, and can be copied as own experiments."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.analysis.evaluation import reevaluate_run
from backend.banks.tuning_settings import TuningSettings
from backend.execution.runner import ExperimentRig, RunRequest, RunResult, run_experiment
from backend.execution.simulation import dry_run, open_headless_rig
from backend.experiments import parser
from backend.experiments.library import (
    READY_NAMES,
    build_ready_plan,
    find_experiment,
    list_stored_values,
    load_ready_experiment,
    load_ready_text,
    parse_stored_plan,
)
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.experiments.schema import build_json_schema
from backend.recording.reader import read_recorded_columns
from backend.services.library import OwnExperiments
from backend.storage.database import open_database
from plant.parameters import load_parameters


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path_factory.mktemp("ready-made"))
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as made:
        yield made
    database.close()


def played(station: ExperimentRig, plan: ExperimentPlan) -> RunResult:
    return asyncio.run(run_experiment(station, RunRequest(plan, LoopSettings(), "A. Operator")))


@pytest.mark.parametrize("name", READY_NAMES)
def test_it_completes_on_the_simulator_and_its_criteria_hold(station: ExperimentRig, name: str) -> None:
    outcome = played(station, build_ready_plan(name))
    assert outcome.run.end_state == "completed"
    result = outcome.evaluation.result
    assert result is not None
    assert [item.title for item in result.criteria if not item.passed] == []
    assert result.criteria
    again = reevaluate_run(station.database, outcome.run.id).result
    assert again is not None
    assert (again.metrics, again.criteria) == (result.metrics, result.criteria)


@pytest.mark.parametrize("name", READY_NAMES)
def test_dry_run_and_command_line_give_the_same_to_the_last_digit(tmp_path: Path, name: str) -> None:
    """What the page plays dry, and what ``sinew experiment`` plays, each in an installation of its own."""
    lab, order = load_parameters("lab"), RunRequest(build_ready_plan(name), LoopSettings(), "A. Operator")
    dry = dry_run(lab, order, (), ("q",), 10, tmp_path / "dry").result
    database = open_database(tmp_path / "command")
    with open_headless_rig(database, lab, LoopSettings()) as station:
        commanded = asyncio.run(run_experiment(station, order)).evaluation.result
    database.close()
    assert dry is not None
    assert commanded is not None
    assert (dry.metrics, dry.criteria) == (commanded.metrics, commanded.criteria)


@pytest.mark.parametrize("name", READY_NAMES)
def test_writing_and_reading_gives_it_back(name: str) -> None:
    written, _ = load_ready_experiment(name)
    assert parser.parse_canonical(parser.to_canonical_text(written)) == written
    plan = build_ready_plan(name)
    assert parse_stored_plan(plan.kind, list_stored_values(plan)) == plan


@pytest.mark.parametrize("name", READY_NAMES)
def test_an_own_one_can_do_all_that_it_does(tmp_path: Path, name: str) -> None:
    database = open_database(tmp_path)
    own = OwnExperiments(database)
    copied = load_ready_text(name).replace(f"name: {name}\n", "name: mine\n", 1)
    kept = own.check_and_store(copied, "A. Operator", load_parameters("lab"), TuningSettings())
    assert (kept.name, kept.version) == ("mine", 1)
    mine, theirs = own.find_definition("mine"), find_experiment(name)
    assert mine.default_plan.program() == theirs.default_plan.program()
    assert mine.settings == theirs.settings
    database.close()


def test_own_experiments_are_stored_in_versions(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    own, lab = OwnExperiments(database), load_parameters("lab")
    first = load_ready_text("step_battery").replace("name: step_battery\n", "name: mine\n", 1)
    second = first.replace("default: 5 * pi / 18", "default: 0.7")
    for written, version in ((first, 1), (second, 2), (second, 2), (first, 3)):
        assert own.check_and_store(written, "A. Operator", lab, TuningSettings()).version == version
    assert own.load_text("mine@1").text == own.load_text("mine").text == first
    assert own.load_text("mine@2").text == second
    assert [entry.name for entry in own.list_definitions()][-1] == "mine@3"
    assert [(one.name, one.version, one.title) for one in own.list_own()] == [("mine", 3, "Step battery")]
    database.close()


def test_the_schema_knows_every_motion_and_nothing_else() -> None:
    motions = build_json_schema()["$defs"]
    listed = {one["properties"]["do"]["const"] for one in motions.values() if "do" in one.get("properties", {})}
    assert listed == {
        "hold", "step", "ramp", "pulse", "sine", "sweep", "prbs", "multisine", "push", "hand", "load", "tuning",
        "wall", "no_wall", "choose", "repeat", "learn", "until_contact",
    }  # fmt: skip
    assert all(one.get("additionalProperties") is False for one in motions.values() if "properties" in one)


def test_a_lambda_sweep_controls_with_each_lambda_and_the_operators_is_back(station: ExperimentRig) -> None:
    plan = build_ready_plan("lambda_sweep", lam_first=0.8, lam_last=0.6, count=2, hold_s=5.0)
    outcome = played(station, plan)
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    lam = columns["lam_q"]
    assert sorted(np.unique(np.round(lam, 6))) == [0.5, 0.6, 0.8]
    changed = np.flatnonzero(np.diff(lam)) + 1
    assert [round(at / 5000) for at in changed] == [1, 5]
    newest = station.loop.ring.newest()
    assert newest is not None
    told = played(station, build_ready_plan("step_battery", sizes=1, hold_s=2.0))
    after, _ = read_recorded_columns(station.database, told.run.id)
    assert set(after["lam_q"]) == {0.5}


def test_a_step_is_faster_under_a_smaller_lambda(station: ExperimentRig) -> None:
    outcome = played(station, build_ready_plan("lambda_sweep", lam_first=1.0, lam_last=0.5, count=2))
    result = outcome.evaluation.result
    assert result is not None
    steps = [step for step in result.metrics.steps or () if step.signal == "q" and step.after > step.before]
    slow, fast = (step.reach_s for step in steps)
    assert slow is not None
    assert fast is not None
    assert slow / fast == pytest.approx(2.0, rel=0.1)


def test_a_bank_comparison_differs_only_in_how_entries_are_used() -> None:
    plan = build_ready_plan("bank_comparison")
    segments = plan.program().segments
    half = len(segments) // 2
    switching, interpolating = segments[1 : half + 1], segments[half + 1 :]
    assert [replace(segment, tuning=0) for segment in interpolating] == list(switching)
    assert [dict(change) for change in plan.compiled.changes] == [{"interpolate": False}, {"interpolate": True}]
