"""Ready-made experiments, and experiments from recorded references."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.analysis.evaluation import reevaluate_run
from backend.banks.tuning_settings import TuningSettings
from backend.execution.runner import ExperimentRig, RunRequest, RunResult, run_experiment
from backend.execution.simulation import dry_run, open_headless_rig
from backend.experiments import parser
from backend.experiments.library import (
    READY_NAMES,
    TOLERANCE_F_N,
    TOLERANCE_Q_RAD,
    TOLERANCE_S,
    ReferenceChange,
    approximate_columns,
    build_ready_plan,
    find_commanded_range,
    find_experiment,
    list_stored_values,
    load_ready_experiment,
    load_ready_text,
    parse_stored_plan,
)
from backend.experiments.parser import ExperimentError, build_experiment
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.experiments.schema import build_json_schema
from backend.realtime.program import Law, Program, Segment, Shape
from backend.recording.reader import read_recorded_columns
from backend.services.library import OwnExperiments
from backend.storage.database import open_database
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.experiments.test_compiler import played
from tests.refusals import refused_because

# Parts built from recorded references reproduce them within the reported deviations.

STEPS_AND_RAMPS = (
    Segment(0.5, 0.2, 9.0),
    Segment(1.0, -0.4, 11.0, shape=Shape.RAMP),
    Segment(0.7, -0.4, 11.0),
    Segment(1.5, 0.5, 11.0, shape=Shape.RAMP),
    Segment(0.4, 0.1, 10.0),
)
SINE = (Segment(0.5, 0.0, 10.0), Segment(4.0, 0.4, 11.0, shape=Shape.SINE, period_s=2.0))


def again(parts: list[dict[str, Any]]) -> np.ndarray:
    """Parse an experiment with these parts; return its references at every tick."""
    document = {
        "format": 1,
        "name": "again",
        "title": "Again",
        "phases": [{"name": "recorded", "title": "Recorded", "parts": parts}],
    }
    return played(ExperimentPlan(build_experiment(document, {}), {}).program(), 0.0, 10.0)


@pytest.mark.parametrize("segments", [STEPS_AND_RAMPS, SINE], ids=["steps and ramps", "sine"])
def test_an_experiment_of_recorded_references_reproduces_the_recording(segments: tuple[Segment, ...]) -> None:
    recorded = played(Program(Law.CASCADE, segments), 0.0, 10.0)
    found = approximate_columns(recorded[:, 0], recorded[:, 1])
    replayed = again(found.parts)
    assert len(replayed) == len(recorded)
    off_q, deviation_S = np.abs(replayed - recorded).max(axis=0)
    assert off_q == pytest.approx(found.deviation_q_rad, abs=1e-9)
    assert deviation_S == pytest.approx(found.deviation_S, abs=1e-9)
    assert off_q <= TOLERANCE_Q_RAD
    assert deviation_S <= TOLERANCE_S


def test_recorded_steps_holds_and_ramps_are_recovered_exactly() -> None:
    recorded = played(Program(Law.CASCADE, STEPS_AND_RAMPS), 0.0, 10.0)
    parts = approximate_columns(recorded[:, 0], recorded[:, 1]).parts
    assert [part["do"] for part in parts] == ["step", "ramp", "hold", "ramp", "step"]
    assert [part["duration_s"] for part in parts] == [segment.duration_s for segment in STEPS_AND_RAMPS]


def test_a_ramp_after_a_step_has_the_reported_deviation() -> None:
    way = np.linspace(0.3, 0.6, 1000)
    found = approximate_columns(way, np.full(1000, 10.0))
    replayed = again(found.parts)
    assert found.deviation_q_rad == pytest.approx(np.abs(replayed[:1000, 0] - way).max(), abs=1e-9)
    assert found.deviation_q_rad == pytest.approx(9 * 0.3 / 999, abs=1e-6)  # of the shortest part, ten ticks


@pytest.mark.parametrize(
    ("q_ref", "code"),
    [
        (np.full(100, np.nan), "no_recorded_references"),
        (np.where(np.arange(100) == 50, np.nan, 0.0), "gap_in_references"),
    ],
    ids=["none", "gap"],
)
def test_a_recording_without_commanded_references_is_rejected(q_ref: np.ndarray, code: str) -> None:
    with refused_because(ExperimentError, code):
        find_commanded_range(q_ref, np.full(len(q_ref), 10.0))


def test_a_recording_with_too_many_parts_is_rejected() -> None:
    q_ref = np.where(np.arange(40_000) // 20 % 2, 0.1, 0.0)
    with refused_because(ExperimentError, "too_many_recorded_parts", maximum=1000):
        approximate_columns(q_ref, np.full(len(q_ref), 10.0))


def pushed(parts: list[dict[str, Any]]) -> np.ndarray:
    """Return the push at every tick, as docs/how-to/experiments.md defines the parts."""
    ticks: list[float] = []
    before = 0.0
    for part in parts:
        length = round(part.get("duration_s", 0.0) / T_s)
        F = part.get("F_push", 0.0)
        ramp = part.get("shape") == "ramp"
        ticks += [before + (F - before) * (k + 1) / length if ramp else F for k in range(length)]
        before = F if length else before
    return np.array(ticks)


def test_recorded_pushes_are_recovered_with_their_ticks_and_forces() -> None:
    F = np.zeros(4000)
    F[500:1500] = 6.0
    F[2000:2500] = -4.5
    q_ref = np.full(4000, 0.1)
    q_ref[1700:] = 0.3
    found = approximate_columns(q_ref, np.full(4000, 10.0), F)
    assert [(part["do"], part["duration_s"]) for part in found.parts] == [
        ("step", 0.5),
        ("push", 1.0),
        ("hold", 0.2),
        ("step", 0.3),
        ("push", 0.5),
        ("hold", 1.5),
    ]
    assert np.array_equal(pushed(found.parts), F)
    assert (found.delay_ticks, found.unpushed, found.deviation_F_N) == (0, [], 0.0)


def test_a_recorded_smooth_push_is_approximated_within_the_tolerance() -> None:
    F = np.zeros(3000)
    F[1000:2000] = 8.0 * np.sin(np.pi * np.arange(1000) / 1000.0) ** 2
    found = approximate_columns(np.full(3000, 0.1), np.full(3000, 10.0), F)
    off = np.abs(pushed(found.parts)[:3000] - F).max()
    assert off <= TOLERANCE_F_N
    assert off == pytest.approx(found.deviation_F_N, abs=1e-9)


def test_a_push_during_a_motion_is_omitted_and_reported() -> None:
    F = np.zeros(4000)
    F[500:3500] = 6.0
    q_ref = np.full(4000, 0.1)
    q_ref[1000:2000] += 0.4 * np.arange(1, 1001) / 1000.0
    q_ref[2000:3000] = 0.5
    q_ref[3000:] = 0.2
    found = approximate_columns(q_ref, np.full(4000, 10.0), F)
    assert found.unpushed == [(1000, 2000), (3000, 3010)]
    missing = np.flatnonzero(pushed(found.parts)[:4000] != F)
    assert missing.tolist() == [*range(1000, 2000), *range(3000, 3010)]
    replayed = again(found.parts)
    assert np.abs(replayed[:4000, 0] - q_ref).max() <= TOLERANCE_Q_RAD


def test_changes_precede_the_part_that_begins_at_their_tick() -> None:
    first, second = {"do": "tuning", "lam_q": 0.5, "b": 0.2}, {"do": "tuning", "lam_q": 0.8}
    wall = {"do": "wall", "q_wall": 0.6}
    changes = [
        ReferenceChange(0, first),
        ReferenceChange(700, second),
        ReferenceChange(703, {"do": "tuning", "lam_S": 0.6}),
        ReferenceChange(1200, wall),
    ]
    found = approximate_columns(np.full(2000, 0.1), np.full(2000, 10.0), None, changes)
    assert [part["do"] for part in found.parts] == [
        "tuning",
        "step",
        "tuning",
        "hold",
        "tuning",
        "hold",
        "wall",
        "hold",
    ]
    assert [part["duration_s"] for part in found.parts if "duration_s" in part] == [0.7, 0.01, 0.49, 0.8]
    assert found.delay_ticks == 7  # the second of two changes within a shortest part


# The ready-made experiments run, pass their criteria, and can be copied as own experiments.


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path_factory.mktemp("ready-made"))
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as made:
        yield made
    database.close()


def played_shipped(station: ExperimentRig, plan: ExperimentPlan) -> RunResult:
    return asyncio.run(run_experiment(station, RunRequest(plan, LoopSettings(), "A. Operator")))


@pytest.mark.parametrize("name", READY_NAMES)
def test_each_ready_made_experiment_completes_on_the_simulator_and_passes(station: ExperimentRig, name: str) -> None:
    outcome = played_shipped(station, build_ready_plan(name))
    assert outcome.run.end_state == "completed"
    result = outcome.evaluation.result
    assert result is not None
    assert [item.title for item in result.criteria if not item.passed] == []
    assert result.criteria
    again = reevaluate_run(station.database, outcome.run.id).result
    assert again is not None
    assert (again.metrics, again.criteria) == (result.metrics, result.criteria)


@pytest.mark.parametrize("name", READY_NAMES)
def test_dry_run_and_command_line_give_identical_results(tmp_path: Path, name: str) -> None:
    """The dry run of the page and ``sinew experiment`` each use their own installation."""
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
def test_a_ready_made_experiment_is_unchanged_after_writing_and_reading(name: str) -> None:
    written, _ = load_ready_experiment(name)
    assert parser.parse_canonical(parser.to_canonical_text(written)) == written
    plan = build_ready_plan(name)
    assert parse_stored_plan(plan.kind, list_stored_values(plan)) == plan


@pytest.mark.parametrize("name", READY_NAMES)
def test_a_copy_of_a_ready_made_experiment_compiles_to_the_same_program(tmp_path: Path, name: str) -> None:
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


def test_the_schema_lists_exactly_the_known_motions() -> None:
    motions = build_json_schema()["$defs"]
    listed = {one["properties"]["do"]["const"] for one in motions.values() if "do" in one.get("properties", {})}
    assert listed == {
        "hold", "step", "ramp", "pulse", "sine", "sweep", "prbs", "multisine", "push", "hand", "load", "tuning",
        "wall", "no_wall", "choose", "repeat", "learn", "until_contact",
    }  # fmt: skip
    assert all(one.get("additionalProperties") is False for one in motions.values() if "properties" in one)


def test_a_lambda_sweep_applies_each_lambda_and_restores_the_operators_tuning(station: ExperimentRig) -> None:
    plan = build_ready_plan("lambda_sweep", lam_first=0.8, lam_last=0.6, count=2, hold_s=5.0)
    outcome = played_shipped(station, plan)
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    lam = columns["lam_q"]
    assert sorted(np.unique(np.round(lam, 6))) == [0.5, 0.6, 0.8]
    changed = np.flatnonzero(np.diff(lam)) + 1
    assert [round(at / 5000) for at in changed] == [1, 5]
    newest = station.loop.ring.newest()
    assert newest is not None
    battery = played_shipped(station, build_ready_plan("step_battery", sizes=1, hold_s=2.0))
    after, _ = read_recorded_columns(station.database, battery.run.id)
    assert set(after["lam_q"]) == {0.5}


def test_a_step_is_faster_with_a_smaller_lambda(station: ExperimentRig) -> None:
    outcome = played_shipped(station, build_ready_plan("lambda_sweep", lam_first=1.0, lam_last=0.5, count=2))
    result = outcome.evaluation.result
    assert result is not None
    steps = [step for step in result.metrics.steps or () if step.signal == "q" and step.after > step.before]
    slow, fast = (step.reach_s for step in steps)
    assert slow is not None
    assert fast is not None
    assert slow / fast == pytest.approx(2.0, rel=0.1)


def test_the_halves_of_a_bank_comparison_differ_only_in_the_scheduling() -> None:
    plan = build_ready_plan("bank_comparison")
    segments = plan.program().segments
    half = len(segments) // 2
    switching, interpolating = segments[1 : half + 1], segments[half + 1 :]
    assert [replace(segment, tuning=0) for segment in interpolating] == list(switching)
    assert [dict(change) for change in plan.compiled.changes] == [{"interpolate": False}, {"interpolate": True}]
