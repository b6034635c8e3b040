import itertools
import json
import math
from dataclasses import asdict

import pytest

from backend.errors import OutOfRangeError
from backend.experiments.library import build_ready_plan, find_experiment
from backend.experiments.plans import ActuatorIdentificationPlan, Plan
from backend.models.settings import SettingError, build_plan, describe_settings
from backend.realtime.program import Law, Segment, Shape


def test_every_setting_has_unit_bounds_default_and_meaning() -> None:
    for settings in (build_ready_plan("tracking").settings, describe_settings(ActuatorIdentificationPlan)):
        for setting in settings:
            assert setting.unit
            assert setting.symbol
            assert setting.meaning
            if setting.kind == "choice":
                assert setting.default in (setting.choices or ())
            else:
                assert setting.minimum is not None
                assert setting.maximum is not None
                assert setting.minimum <= setting.default <= setting.maximum  # type: ignore[operator]  # a number here
            json.dumps(asdict(setting))


def test_words_of_a_command_line_become_numbers() -> None:
    plan = build_ready_plan("tracking", **{"q_amplitude": "0.5", "S_low": 9})
    assert [plan.values[name] for name in ("q_amplitude", "S_low", "S_high")] == [0.5, 9.0, 14.0]
    assert build_plan(ActuatorIdentificationPlan, {"bits": "9"}).bits == 9


@pytest.mark.parametrize(("name", "value"), [("q_amplitude", 1.6), ("q_amplitude", math.nan), ("S_low", "1e400")])
def test_a_number_out_of_bounds_is_refused_with_bounds_and_unit(name: str, value: object) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        build_ready_plan("tracking", **{name: value})
    setting = next(item for item in build_ready_plan("tracking").settings if item.name == name)
    assert refused.value.quantity == name
    assert (refused.value.minimum, refused.value.maximum) == (setting.minimum, setting.maximum)
    assert refused.value.unit == setting.unit


@pytest.mark.parametrize("value", ["wide", True, None, [1.0]])
def test_what_is_no_number_is_refused_with_its_unit(value: object) -> None:
    with pytest.raises(SettingError, match="needs a number in rad") as refused:
        build_ready_plan("tracking", **{"q_amplitude": value})
    assert (refused.value.quantity, refused.value.value, refused.value.unit) == ("q_amplitude", value, "rad")


def test_unknown_names_and_fractions_of_counts_are_refused() -> None:
    with pytest.raises(SettingError, match="unknown setting") as unknown:
        build_ready_plan("tracking", **{"q_amplitud": 1.0})
    assert "q_amplitude" in unknown.value.legal
    with pytest.raises(SettingError, match="whole number"):
        build_plan(ActuatorIdentificationPlan, {"bits": 7.5})


def test_settings_are_checked_against_each_other() -> None:
    with pytest.raises(OutOfRangeError, match="12 N·m/rad is more than 11 N·m/rad; keep it below the upper level"):
        build_ready_plan("tracking", S_low=12, S_high=11)
    with pytest.raises(OutOfRangeError, match="shorter chip"):
        ActuatorIdentificationPlan(chip_s=2.0, bits=12).program()


def test_tracking_program_holds_its_references_as_the_paper_does() -> None:
    plan = build_ready_plan("tracking")
    program, phases = plan.program(), plan.phases()
    assert program.law is Law.CASCADE
    assert [phase.name for phase in phases] == ["lead_in", "position", "stiffness", "both"]
    assert phases[0].start_s == 0.0
    assert phases[-1].end_s == program.duration_s
    assert all(a.end_s == b.start_s for a, b in itertools.pairwise(phases))

    start = 0.0
    by_phase: dict[str, list[Segment]] = {phase.name: [] for phase in phases}
    for segment in program.segments:
        phase = next(phase for phase in phases if phase.start_s <= start < phase.end_s)
        by_phase[phase.name].append(segment)
        start += segment.duration_s
    assert {segment.S_ref for segment in by_phase["position"]} == {10.0}
    assert {segment.q_ref for segment in by_phase["position"]} >= {math.pi / 3, -math.pi / 3}
    assert {segment.duration_s for segment in by_phase["position"]} == {8.0}
    assert {segment.q_ref for segment in by_phase["stiffness"]} == {0.0}
    assert {segment.S_ref for segment in by_phase["stiffness"]} == {8.0, 10.0, 14.0}
    assert {segment.duration_s for segment in by_phase["stiffness"]} == {6.0}
    for before, after in zip([by_phase["stiffness"][-1], *by_phase["both"]], by_phase["both"], strict=False):
        assert before.q_ref != after.q_ref
        assert before.S_ref != after.S_ref


def test_identification_program_is_the_default_experiment_of_the_method() -> None:
    program = ActuatorIdentificationPlan(tension_N=30.0).program()
    assert program.law is Law.FORCE_HOLD
    assert program.tension_N == 30.0
    assert program.segments == ()
    assert program.excitation is not None
    assert program.excitation.duration_s == pytest.approx(20.32)
    assert program.duration_s == pytest.approx(program.settle_s + 20.32)


@pytest.mark.parametrize(
    "plan",
    [
        build_ready_plan("tracking", q_duration_s=1.23456, S_duration_s=0.98765),
        build_ready_plan("compliance", push_seed=4),
        find_experiment("sequence").make_plan({"segments": '[{"duration_s": 0.12345, "q_ref": 0, "S_ref": 10}]'}),
    ],
)
def test_segments_last_whole_milliseconds_as_the_loop_plays_them(plan: Plan) -> None:
    for segment in plan.program().segments:
        assert segment.duration_s * 1000 == pytest.approx(round(segment.duration_s * 1000), abs=1e-9)


@pytest.mark.parametrize("profile", ["hand", "steps", "ramp"])
def test_compliance_pushes_both_ways_within_its_bound_and_ends_at_rest(profile: str) -> None:
    plan = build_ready_plan("compliance", **{"profile": profile, "F_push": 12.0, "pushes": 20})
    program = plan.program()
    forces = [segment.F_push for segment in program.segments]
    assert program.law is Law.COMPLIANCE
    assert -12.0 <= min(forces) < -3.0
    assert 3.0 < max(forces) <= 12.0
    assert forces[0] == forces[-1] == 0.0
    assert {(segment.q_ref, segment.S_ref) for segment in program.segments} == {(0.0, 10.0)}
    assert build_ready_plan("compliance", **{"profile": profile, "F_push": 12.0, "pushes": 20}).program() == program


def test_a_hand_pushes_differently_with_another_seed_and_never_jumps() -> None:
    first, second = (build_ready_plan("compliance", push_seed=seed).program().segments for seed in (1, 2))
    assert first != second
    for before, after in itertools.pairwise(first):
        assert after.shape is Shape.RAMP or after.F_push == pytest.approx(before.F_push)
        assert abs(after.F_push - before.F_push) < 6.0
