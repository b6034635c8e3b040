"""Settings declared by an experiment; invalid declarations are rejected."""

import math
from typing import Any

import pytest

from backend.errors import OutOfRangeError
from backend.experiments.parser import ExperimentError, build_settings, parse_values, require_rules
from backend.experiments.schema import Declared, Experiment, Hold, Rule, Section
from backend.models.settings import Setting, SettingError

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


def test_each_kind_is_declared_as_it_was_written() -> None:
    assert build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}) == (
        Setting("depth", "number", "a", "rad", "amplitude", math.pi / 4.0, 0.0, math.pi / 2.0),
        Setting("turns", "integer", "n", "1", "turns", 3, 1.0, 9.0),
        Setting("how", "choice", "how", "1", "way", "a", choices=("a", "b")),
        Setting("sure", "boolean", "sure", "1", "whether", True),
    )


def test_values_that_are_not_named_are_the_defaults_and_words_are_read() -> None:
    settings = build_settings(experiment(DEPTH, TURNS, HOW, SURE), {})
    assert parse_values(settings, {"turns": "5", "sure": "no"}) == {
        "depth": math.pi / 4.0, "turns": 5, "how": "a", "sure": False,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "error", "told"),
    [
        ({"width": 1}, SettingError, "unknown setting; known are depth, turns, how, sure"),
        ({"depth": 2.0}, OutOfRangeError, "amplitude: 2\u202frad is outside 0 to 1.57"),
        ({"depth": float("nan")}, OutOfRangeError, "amplitude"),
        ({"depth": float("inf")}, OutOfRangeError, "amplitude"),
        ({"depth": "wide"}, SettingError, "it needs a number"),
        ({"depth": True}, SettingError, "it needs a number"),
        ({"turns": 2.5}, SettingError, "it needs a whole number"),
        ({"turns": 10**9}, OutOfRangeError, "is outside 1 to 9"),
        ({"how": "c"}, SettingError, "choose one of a, b"),
        ({"sure": 2}, SettingError, "it needs true or false"),
    ],
)
def test_a_wrong_value_is_refused_as_of_any_other_setting(
    values: dict[str, object], error: type[Exception], told: str
) -> None:
    with pytest.raises(error) as refused:
        parse_values(build_settings(experiment(DEPTH, TURNS, HOW, SURE), {}), values)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (declared(name="lam_q"), "'lam_q' is taken"),
        (declared(name="bank"), "'bank' is taken"),
        (declared(name="seed"), "'seed' is taken"),
        (declared(name="experiment"), "'experiment' is taken"),
        (declared(name="pi"), "'pi' is taken"),
        (declared(name="max"), "'max' is taken"),
        (declared(name="first"), "'first' is taken"),
        (declared(minimum=None), "depth needs a minimum and a maximum"),
        (declared(maximum=None), "depth needs a minimum and a maximum"),
        (declared(default=1.1), "1.1 is outside 0 to 1"),
        (declared(minimum=0.5, maximum=0.4), "is outside"),
        (declared(default=True), "not a finite number"),
        (declared(default="first"), "'first' is not known here"),
        (declared(maximum="1 / 0"), "has no value"),
        (declared(maximum="2 ** 1e9"), "has no value"),
        (declared(kind="choice", default="c", choices=("a", "b")), "the default 'c' is none of its choices"),
        (declared(kind="choice", default="c"), "the default 'c' is none of its choices"),
        (declared(kind="boolean", default=3), "it needs true or false"),
    ],
)
def test_a_declaration_that_cannot_be_is_refused_in_its_line(wrong: Declared, told: str) -> None:
    lines = {(): 1, ("settings",): 5, ("settings", 0): 6, ("settings", 1): 7, ("settings", 1, "name"): 8}
    with pytest.raises(ExperimentError) as refused:
        build_settings(experiment(declared(name="first"), wrong), lines)
    assert told in str(refused.value)
    assert refused.value.line == (8 if "taken" in told else 7)
    assert refused.value.path[:2] == ("settings", 1)


def test_rules_hold_or_say_which_values_break_them() -> None:
    low, high = (declared(name=name, default=default) for name, default in (("low", 0.2), ("high", 0.8)))
    asked = experiment(low, high, rules=(Rule(that="low < high", remedy="keep low below high"),))
    lines = {(): 1, ("rules", 0, "that"): 21}
    require_rules(asked, build_settings(asked, {}), {"low": 0.2, "high": 0.8}, ("low",), lines)
    with pytest.raises(ExperimentError) as refused:
        require_rules(asked, build_settings(asked, {}), {"low": 0.8, "high": 0.8}, (), lines)
    assert str(refused.value) == (
        "line 21: rules 1, that: low < high does not hold (low is 0.8, high is 0.8): keep low below high"
    )


@pytest.mark.parametrize(("that", "bounds"), [("low < high", (None, 0.8)), ("low >= 2 * high", (1.6, None))])
def test_a_rejection_names_the_setting_that_was_given(that: str, bounds: tuple[float | None, float | None]) -> None:
    low, high = (declared(name=name, default=default) for name, default in (("low", 0.2), ("high", 0.8)))
    asked = experiment(low, high, rules=(Rule(that=that, remedy="mind the gap"),))
    with pytest.raises(OutOfRangeError, match="mind the gap") as refused:
        require_rules(asked, build_settings(asked, {}), {"low": 0.9, "high": 0.8}, ("low",), {})
    assert (refused.value.quantity, refused.value.minimum, refused.value.maximum) == ("low", *bounds)


@pytest.mark.parametrize("that", ["low < middle", "low + 1", "low", "low <", "__import__('os')", "1 / 0 < low"])
def test_a_rule_that_is_no_comparison_is_refused_in_its_line(that: str) -> None:
    asked = experiment(declared(name="low"), rules=(Rule(that=that, remedy="none"),))
    with pytest.raises(ExperimentError) as refused:
        require_rules(asked, build_settings(asked, {}), {"low": 0.2}, (), {("rules", 0, "that"): 3})
    assert refused.value.line == 3
