"""What a report says of the control law of its run: the settings that the law uses, and what it knows of the plant."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.analysis.evaluation import USED_SETTINGS, find_control_law, select_used_settings
from backend.banks.tuning_settings import TUNING_NAMES
from backend.experiments.library import build_ready_plan, describe_plan_values, list_stored_values
from backend.experiments.plans import LoopSettings
from backend.models.settings import describe_values
from backend.realtime.program import Law
from backend.reports.build import build_report
from backend.reports.model import Report, Table
from backend.reports.run_data import RunData
from backend.tuning.gains import (
    TuningParameters,
    make_cascade_tuning,
    make_feedback_linearization_tuning,
    make_single_loop_tuning,
)
from backend.tuning.simulation import simulate_cascade
from plant.parameters import load_parameters
from tests.reports.tracking_run import PLAN, samples, source_of

CASCADE_ONLY = {"lam_motor", "b", "bank", "interpolate", "motion", "u_plan", "k_ext"}


def of_law(law: str) -> RunData:
    tracked = source_of(samples(PLAN))
    plan = build_ready_plan("tracking", controller=law, q_duration_s=4.0, S_duration_s=3.0)
    loop = LoopSettings(motion="time-optimal", u_plan=8.5, k_ext=0.3)
    settings = {
        "plan": list_stored_values(plan),
        "loop": vars(loop),
        "declared": [vars(item) for item in (*describe_plan_values(plan), *describe_values(loop))],
    }
    return replace(tracked, run=replace(tracked.run, settings=settings))


def settings_in(report: Report) -> set[str]:
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, Table)]
    return {row[1] for table in tables if table.caption.startswith("Settings of the run") for row in table.rows}


@pytest.mark.parametrize("law", ["single-loop", "feedback-linearization"])
def test_a_law_for_comparison_lists_only_what_it_uses_and_says_what_it_knows(law: str) -> None:
    source = of_law(law)
    report = build_report(source)
    symbols = settings_in(report)
    assert {"λ_q", "λ_S", "seed", "controller", "t_q"} <= symbols
    assert not symbols & {"λ_motor", "b", "bank", "interpolate", "motion", "U_plan", "k_ext"}
    facts = {fact.label: fact.text for fact in report.facts}
    assert facts["Tuning"] == "λ_q = 0.5 s, λ_S = 0.42 s"
    known = "true plant" if law == "feedback-linearization" else "identified geometry, spring and motors"
    assert known in facts["The law knows"]
    assert ("friction" in facts["The law knows"]) == (law == "feedback-linearization")
    assert "U_plan = 8.5 V" not in facts["Controller"]
    made = next(section for section in report.sections if section.heading == "How it was made")
    assert not any("Gains were computed" in getattr(block, "text", "") for block in made.blocks)


def test_the_cascade_lists_all_of_its_tuning() -> None:
    report = build_report(of_law("cascade"))
    assert {"λ_q", "λ_S", "λ_motor", "b", "bank", "interpolate", "motion", "U_plan", "k_ext"} <= settings_in(report)
    facts = {fact.label: fact.text for fact in report.facts}
    assert "U_plan = 8.5 V" in facts["Controller"]
    assert "not their friction" in facts["The law knows"]


@pytest.mark.parametrize("tuning_of", [make_single_loop_tuning, make_feedback_linearization_tuning])
def test_what_is_left_out_changes_nothing_in_the_law(tuning_of: Any) -> None:
    lab = load_parameters("lab")
    usual = tuning_of(lab, TuningParameters())
    assert tuning_of(lab, TuningParameters(lam_motor=0.12, b=0.4)) == usual
    assert tuning_of(lab, TuningParameters(lam_q=0.7)) != usual
    assert tuning_of(lab, TuningParameters(lam_S=0.7)) != usual


def test_every_law_has_its_settings() -> None:
    assert set(USED_SETTINGS) == set(Law)
    assert set(USED_SETTINGS[Law.CASCADE]) == set(TUNING_NAMES)
    assert set(TUNING_NAMES) - set(USED_SETTINGS[Law.SINGLE_LOOP]) == CASCADE_ONLY


@pytest.mark.parametrize(
    ("kind", "law", "used"),
    [
        ("motor_identification", Law.MOTOR_STEPS, {"lam_motor"}),
        ("spring_identification", Law.TENSION_SWEEP, {"lam_motor"}),
        ("actuator_identification", Law.FORCE_HOLD, {"lam_motor"}),
    ],
)
def test_an_identification_uses_the_motor_loops_alone(kind: str, law: Law, used: set[str]) -> None:
    source = of_law("cascade")
    settings = {**source.run.settings, "plan": {}}
    identification = replace(source.run, kind=kind, settings=settings)
    assert find_control_law(identification) is law
    assert {item.name for item in select_used_settings(identification)} & set(TUNING_NAMES) == used


def test_the_compliance_experiment_runs_with_its_position_loop_open() -> None:
    plan = build_ready_plan("compliance")
    source = of_law("cascade")
    compliant = replace(
        source.run, kind="compliance", settings={**source.run.settings, "plan": list_stored_values(plan)}
    )
    assert find_control_law(compliant) is Law.COMPLIANCE
    assert "lam_q" not in {item.name for item in select_used_settings(compliant)}


def test_S_that_is_shown_is_wrong_by_as_much_as_the_springs_are() -> None:
    """The note of every report, on a plant whose springs are 20 % stiffer than identified."""
    lab = load_parameters("lab")
    stiffer = replace(lab, asymmetry=replace(lab.asymmetry, spring_A=1.2, spring_B=1.2))
    ticks = 6_000
    found = simulate_cascade(
        stiffer, make_cascade_tuning(lab, TuningParameters()), np.zeros(ticks), np.full(ticks, 12.0)
    )
    rest = slice(-500, None)
    assert found.S[rest].mean() == pytest.approx(12.0, abs=0.02)
    assert found.S_true[rest].mean() == pytest.approx(14.4, abs=0.05)
    said = [
        getattr(block, "text", "") for section in build_report(of_law("cascade")).sections for block in section.blocks
    ]
    assert any("S is 14.4 N·m/rad while 12" in text for text in said)
