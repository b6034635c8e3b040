"""Settings of experiments, declared and checked, and their JSON schema."""

import itertools
import json
import math
from dataclasses import asdict
from typing import Any

import pytest
import yaml
from jsonschema_rs import Draft202012Validator

from backend.errors import OutOfRangeError
from backend.experiments.library import (
    READY_NAMES,
    build_ready_plan,
    find_experiment,
    load_ready_experiment,
    load_ready_text,
)
from backend.experiments.parser import ExperimentError, build_experiment, build_settings, parse_values, require_rules
from backend.experiments.plans import ActuatorIdentificationPlan, Plan
from backend.experiments.schema import EXPERIMENT, Declared, Experiment, Hold, Rule, Section, build_json_schema
from backend.models.settings import Setting, SettingError, build_plan, describe_settings
from backend.realtime.program import Law, Segment, Shape
from plant.message import Message
from tests.reasons import TextWith
from tests.refusals import refused_because

# The JSON schema of an experiment accepts the same documents as the parser.

VALIDATOR = Draft202012Validator(build_json_schema())


def document(name: str = "compliance") -> dict[str, Any]:
    written: dict[str, Any] = EXPERIMENT.dump_python(load_ready_experiment(name)[0], mode="json", exclude_defaults=True)
    return written


@pytest.mark.parametrize("name", READY_NAMES)
def test_the_schema_accepts_the_ready_made_experiments(name: str) -> None:
    for taken in (document(name), yaml.safe_load(load_ready_text(name))):
        assert [error.message for error in VALIDATOR.iter_errors(taken)] == []


@pytest.mark.parametrize(
    "change",
    [
        {"format": 2},
        {"format": "1"},
        {"name": "2nd try"},
        {"name": "x" * 41},
        {"name": 3},
        {"title": ""},
        {"title": "x" * 101},
        {"description": "x" * 1001},
        {"phases": []},
        {"phases": "none"},
        {"phases": [{"name": "a", "title": "A", "parts": []}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "fly", "duration_s": 1}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "hold"}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "hold", "duration_s": "1+" * 100 + "1"}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "repeat", "times": 2, "parts": []}]}]},
        {
            "phases": [
                {"name": "a", "title": "A", "parts": [{"do": "push", "F_push": 1, "duration_s": 1, "shape": "x"}]}
            ]
        },
        {"measures": ["songs"]},
        {"criteria": [{"figure": "min tension"}]},
        {"settings": [{"name": "a", "symbol": "a", "meaning": "a", "default": 1, "kind": "colour"}]},
        {"colour": "red"},
    ],
)
def test_schema_and_parser_reject_the_same_invalid_documents(change: dict[str, Any]) -> None:
    wrong = document() | change
    assert not VALIDATOR.is_valid(wrong)
    with pytest.raises(ExperimentError):
        build_experiment(wrong, {})


@pytest.mark.parametrize("lacking", ["format", "name", "title", "phases"])
def test_schema_and_parser_reject_documents_with_missing_keys(lacking: str) -> None:
    wrong = {name: value for name, value in ({"format": 1} | document()).items() if name != lacking}
    assert not VALIDATOR.is_valid(wrong)
    with pytest.raises(ExperimentError):
        build_experiment(wrong, {})


# Settings declared by an experiment; invalid declarations are rejected.

DEPTH = Declared(
    name="depth", symbol="a", unit="rad", meaning="amplitude", default="pi / 4", minimum=0, maximum="pi / 2"
)
TURNS = Declared(name="turns", kind="integer", symbol="n", meaning="turns", default=3, minimum=1, maximum=9)
HOW = Declared(name="how", kind="choice", symbol="how", meaning="way", default="a", choices=("a", "b"))
SURE = Declared(name="sure", kind="boolean", symbol="sure", meaning="whether", default=True)


def experiment(*declared: Declared, rules: tuple[Rule, ...] = ()) -> Experiment:
    held = Section(name="all", title="All", parts=(Hold(do="hold", duration_s=1.0),))
    return Experiment(format=1, name="tried", title="Tried", settings=declared, rules=rules, phases=(held,))


def declared(**changes: Any) -> Declared:
    usual = {"name": "depth", "symbol": "a", "meaning": "m", "default": 0.2, "minimum": 0.0, "maximum": 1.0}
    return Declared(**{**usual, **changes})


def test_settings_of_each_kind_are_declared_as_written() -> None:
    assert build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}) == (
        Setting("depth", "number", "a", "rad", "amplitude", math.pi / 4.0, 0.0, math.pi / 2.0),
        Setting("turns", "integer", "n", "1", "turns", 3, 1.0, 9.0),
        Setting("how", "choice", "how", "1", "way", "a", choices=("a", "b")),
        Setting("sure", "boolean", "sure", "1", "whether", True),
    )


def test_omitted_values_are_the_defaults_and_strings_are_parsed() -> None:
    settings = build_settings(experiment(DEPTH, TURNS, HOW, SURE), {})
    assert parse_values(settings, {"turns": "5", "sure": "no"}) == {
        "depth": math.pi / 4.0, "turns": 5, "how": "a", "sure": False,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "label", "minimum", "maximum"),
    [
        ({"depth": 2.0}, "amplitude", 0.0, math.pi / 2.0),
        ({"depth": float("nan")}, "amplitude", 0.0, math.pi / 2.0),
        ({"depth": float("inf")}, "amplitude", 0.0, math.pi / 2.0),
        ({"turns": 10**9}, "turns", 1.0, 9.0),
    ],
)
def test_a_value_beyond_its_bounds_is_rejected_with_the_setting(
    values: dict[str, float], label: str, minimum: float, maximum: float
) -> None:
    ((name, value),) = values.items()
    with pytest.raises(OutOfRangeError) as refused:
        parse_values(build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}), values)
    assert (refused.value.quantity, refused.value.label) == (name, label)
    assert (refused.value.minimum, refused.value.maximum) == pytest.approx((minimum, maximum))
    assert refused.value.value == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"depth": "wide"}, "a number is required"),
        ({"depth": True}, "a number is required"),
        ({"turns": 2.5}, "a whole number is required"),
        ({"how": "c"}, "choose one of a, b"),
        ({"sure": 2}, "true or false is required"),
    ],
)
def test_a_value_of_the_wrong_type_is_rejected_with_the_setting(values: dict[str, object], reason: str) -> None:
    with pytest.raises(SettingError) as refused:
        parse_values(build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}), values)
    assert refused.value.reason == reason


def test_an_unknown_setting_is_rejected_with_the_declared_names() -> None:
    with refused_because(SettingError, "unknown_setting", known="depth, turns, how, sure") as caught:
        parse_values(build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}), {"width": 1})
    assert caught.value.quantity == "width"


@pytest.mark.parametrize(
    ("wrong", "code", "values"),
    [
        *(
            (declared(name=name), "setting_name_taken", {"name": name})
            for name in ("lam_q", "bank", "seed", "experiment", "pi", "max", "first")
        ),
        (declared(minimum=None), "setting_without_bounds", {"name": "depth"}),
        (declared(maximum=None), "setting_without_bounds", {"name": "depth"}),
        (declared(default=1.1), "invalid_default", {"name": "depth", "default": 1.1}),
        (declared(minimum=0.5, maximum=0.4), "invalid_default", {"default": 0.2}),
        (declared(default=True), "not_a_finite_number", {"value": True}),
        (declared(default="first"), "unknown_name", {"name": "first"}),
        (declared(maximum="1 / 0"), "no_value", {"expression": "1 / 0"}),
        (declared(maximum="2 ** 1e9"), "no_value", {"expression": "2 ** 1e9"}),
        (declared(kind="choice", default="c", choices=("a", "b")), "default_not_a_choice", {"default": "c"}),
        (declared(kind="choice", default="c"), "default_not_a_choice", {"default": "c"}),
        (declared(kind="boolean", default=3), "invalid_default", {"default": 3}),
    ],
)
def test_an_invalid_declaration_is_rejected_with_its_line(
    wrong: Declared, code: str, values: dict[str, object]
) -> None:
    lines = {(): 1, ("settings",): 5, ("settings", 0): 6, ("settings", 1): 7, ("settings", 1, "name"): 8}
    with refused_because(ExperimentError, code, **values) as caught:
        build_settings(experiment(declared(name="first"), wrong), lines)
    assert caught.value.line == (8 if code == "setting_name_taken" else 7)
    assert caught.value.path[:2] == ("settings", 1)


def test_a_default_beyond_its_bounds_is_rejected_with_the_bounds() -> None:
    with refused_because(ExperimentError, "invalid_default", default=1.1, reason=TextWith(r"1\.1 .* 0 to 1\b")):
        build_settings(experiment(declared(default=1.1)), {})
    with refused_because(ExperimentError, "invalid_default", default=3, reason=TextWith("true or false")):
        build_settings(experiment(declared(kind="boolean", default=3)), {})


def test_a_violated_rule_lists_the_values_that_violate_it() -> None:
    low, high = (declared(name=name, default=default) for name, default in (("low", 0.2), ("high", 0.8)))
    checked = experiment(low, high, rules=(Rule(that="low < high", remedy="keep low below high"),))
    lines = {(): 1, ("rules", 0, "that"): 21}
    require_rules(checked, build_settings(checked, {}), {"low": 0.2, "high": 0.8}, ("low",), lines)
    broken = {"rule": "low < high", "values": "low is 0.8, high is 0.8", "remedy": "keep low below high"}
    with refused_because(ExperimentError, "rule_not_satisfied", **broken) as caught:
        require_rules(checked, build_settings(checked, {}), {"low": 0.8, "high": 0.8}, (), lines)
    assert (caught.value.line, caught.value.path) == (21, ("rules", 0, "that"))


@pytest.mark.parametrize(("that", "bounds"), [("low < high", (None, 0.8)), ("low >= 2 * high", (1.6, None))])
def test_a_rule_violation_names_the_given_setting(that: str, bounds: tuple[float | None, float | None]) -> None:
    low, high = (declared(name=name, default=default) for name, default in (("low", 0.2), ("high", 0.8)))
    checked = experiment(low, high, rules=(Rule(that=that, remedy="mind the gap"),))
    with pytest.raises(OutOfRangeError) as refused:
        require_rules(checked, build_settings(checked, {}), {"low": 0.9, "high": 0.8}, ("low",), {})
    assert (refused.value.quantity, refused.value.minimum, refused.value.maximum) == ("low", *bounds)
    assert refused.value.remedy == "mind the gap"


@pytest.mark.parametrize("that", ["low < middle", "low + 1", "low", "low <", "__import__('os')", "1 / 0 < low"])
def test_a_rule_that_is_not_a_comparison_is_rejected_with_its_line(that: str) -> None:
    checked = experiment(declared(name="low"), rules=(Rule(that=that, remedy="none"),))
    with pytest.raises(ExperimentError) as refused:
        require_rules(checked, build_settings(checked, {}), {"low": 0.2}, (), {("rules", 0, "that"): 3})
    assert refused.value.line == 3


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


def test_command_line_values_are_converted_to_numbers() -> None:
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
def test_a_value_that_is_not_a_number_is_rejected_with_the_unit(value: object) -> None:
    with pytest.raises(SettingError, match="a number is required") as refused:
        build_ready_plan("tracking", **{"q_amplitude": value})
    assert (refused.value.quantity, refused.value.value, refused.value.unit) == ("q_amplitude", value, "rad")


def test_unknown_settings_and_fractional_counts_are_rejected() -> None:
    with refused_because(SettingError, "unknown_setting") as unknown:
        build_ready_plan("tracking", **{"q_amplitud": 1.0})
    assert "q_amplitude" in unknown.value.legal
    with pytest.raises(SettingError, match="whole number"):
        build_plan(ActuatorIdentificationPlan, {"bits": 7.5})


def test_settings_are_checked_against_each_other() -> None:
    with pytest.raises(OutOfRangeError) as levels:
        build_ready_plan("tracking", S_low=12, S_high=11)
    assert (levels.value.value, levels.value.maximum, levels.value.unit) == (12.0, 11.0, "N·m/rad")
    assert levels.value.remedy == "keep it below the upper level"
    with pytest.raises(OutOfRangeError) as chips:
        ActuatorIdentificationPlan(chip_s=2.0, bits=12).program()
    assert (chips.value.quantity, chips.value.maximum, chips.value.unit) == ("chip_s", 600.0, "s")
    assert isinstance(chips.value.remedy, Message)
    assert chips.value.remedy.code == "shorter_excitation"


def test_the_tracking_program_holds_its_references_for_the_durations_of_the_paper() -> None:
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
def test_segments_last_a_whole_number_of_milliseconds(plan: Plan) -> None:
    for segment in plan.program().segments:
        assert segment.duration_s * 1000 == pytest.approx(round(segment.duration_s * 1000), abs=1e-9)


@pytest.mark.parametrize("profile", ["hand", "steps", "ramp"])
def test_compliance_pushes_in_both_directions_within_its_bound_and_ends_at_rest(profile: str) -> None:
    plan = build_ready_plan("compliance", **{"profile": profile, "F_push": 12.0, "pushes": 20})
    program = plan.program()
    forces = [segment.F_push for segment in program.segments]
    assert program.law is Law.COMPLIANCE
    assert -12.0 <= min(forces) < -3.0
    assert 3.0 < max(forces) <= 12.0
    assert forces[0] == forces[-1] == 0.0
    assert {(segment.q_ref, segment.S_ref) for segment in program.segments} == {(0.0, 10.0)}
    assert build_ready_plan("compliance", **{"profile": profile, "F_push": 12.0, "pushes": 20}).program() == program


def test_manual_pushes_differ_with_the_seed_and_have_no_jumps() -> None:
    first, second = (build_ready_plan("compliance", push_seed=seed).program().segments for seed in (1, 2))
    assert first != second
    for before, after in itertools.pairwise(first):
        assert after.shape is Shape.RAMP or after.F_push == pytest.approx(before.F_push)
        assert abs(after.F_push - before.F_push) < 6.0
