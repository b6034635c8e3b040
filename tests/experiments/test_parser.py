"""Experiments in text form: parts, expressions and choices."""

import json
import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.errors import Path
from backend.experiments import parser
from backend.experiments.library import READY_NAMES, load_ready_text
from backend.experiments.parser import (
    MAX_CHARACTERS,
    ExperimentError,
    ExpressionError,
    Names,
    build_experiment,
    evaluate_condition,
    evaluate_number,
    find_line,
    format_path,
    parse_canonical,
    parse_experiment,
    require_known,
    to_canonical_text,
)
from backend.experiments.schema import EXPERIMENT, Experiment, Hold, Section, Step
from backend.plain_text import escape_line
from plant.message import Message
from tests.experiments.composing.written import plan_of, with_parts
from tests.refusals import check_reason, refused, refused_because

# Parsing and serialization of experiments, with the lines of their parts.

SMALL = """\
# a comment
format: 1
name: small
title: Small
phases:
  - name: only
    title: Only
    parts:
      - do: hold
        duration_s: 2.0
      - {do: step,
         q_ref: 0.1, duration_s: 1e1}
"""


def of(*parts: Hold | Step, title: str = "Small") -> Experiment:
    return Experiment(
        format=1, name="small", title=title, phases=(Section(name="only", title="Only", parts=tuple(parts)),)
    )


EXPECTED = of(Hold(do="hold", duration_s=2.0), Step(do="step", q_ref=0.1, duration_s=10.0))


def test_each_part_is_parsed_with_its_line() -> None:
    experiment, lines = parse_experiment(SMALL)
    assert experiment == EXPECTED
    assert lines["format",] == 2
    assert lines["phases", 0, "parts", 0] == 9
    assert lines["phases", 0, "parts", 0, "duration_s"] == 10
    assert lines["phases", 0, "parts", 1, "do"] == 11
    assert lines["phases", 0, "parts", 1, "q_ref"] == 12


def test_a_path_without_a_line_has_the_line_of_its_parent() -> None:
    _, lines = parse_experiment(SMALL)
    assert find_line(("phases", 0, "parts", 1, "S_ref"), lines) == 11
    assert find_line(("phases", 0, "parts", 7), lines) == 8
    assert find_line(("phases", 0), {}) is None
    assert format_path(("phases", 0, "parts", 1, "q_ref")) == "phases 1, parts 2, q_ref"
    assert format_path(()) == "experiment"


def test_json_and_yaml_are_parsed_alike() -> None:
    document = EXPERIMENT.dump_python(EXPECTED, mode="json")
    for text in (json.dumps(document), json.dumps(document, indent=2)):
        assert parse_experiment(text)[0] == EXPECTED
    assert build_experiment(document, {}) == EXPECTED


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_all_kinds_of_line_endings_are_counted_alike(line_end: str) -> None:
    _, lines = parse_experiment(SMALL.replace("\n", line_end))
    assert lines["phases", 0, "parts", 1, "q_ref"] == 12


@pytest.mark.parametrize("word", ["no", "yes", "on", "off", "1:30", "0x1f", "1_000", "2001-01-01", "12", "true", "~"])
def test_titles_that_resemble_other_types_remain_strings(word: str) -> None:
    experiment = of(Hold(do="hold", duration_s=1.0), title=word)
    assert parse_canonical(to_canonical_text(experiment)) == experiment
    assert parse_experiment(json.dumps(json.loads(to_canonical_text(experiment))))[0] == experiment


@pytest.mark.parametrize("word", ["no", "on", "1:30", "0x1f", "1_000", "2001-01-01"])
def test_an_unquoted_title_is_not_parsed_as_a_number_or_a_boolean(word: str) -> None:
    assert parse_experiment(SMALL.replace("title: Small", f"title: {word}"))[0].title == word


@given(
    st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cn", "Cs")), min_size=1, max_size=100).filter(
        lambda title: escape_line(title) == title and title.strip() != ""
    )
)
def test_a_title_is_the_same_in_the_text_stored_with_a_run(title: str) -> None:
    experiment = of(Hold(do="hold", duration_s=1.0), title=title)
    assert parse_canonical(to_canonical_text(experiment)) == experiment


@pytest.mark.parametrize("line", ["", "[]", "{", "[" * 100_000, '{"format": 1}'])
def test_an_invalid_canonical_text_is_rejected(line: str) -> None:
    with pytest.raises(ExperimentError):
        parse_canonical(line)


@pytest.mark.parametrize(
    ("value", "tag"),
    [("!!int abc", "int"), ("!!float abc", "float"), ("!!int '5'", "int"), ("!!str 5", "str"), ("! 5", "")],
)
def test_yaml_tags_are_rejected(value: str, tag: str) -> None:
    with refused_because(ExperimentError, "unsupported_tag", tag=f"tag:yaml.org,2002:{tag}" if tag else "!") as caught:
        parse_experiment(SMALL.replace("duration_s: 2.0", f"duration_s: {value}"))
    assert caught.value.line == 10


def test_equal_experiments_have_equal_texts() -> None:
    other = parse_experiment(SMALL.replace("1e1", "10.0").replace("# a comment", "# another"))[0]
    assert to_canonical_text(other) == to_canonical_text(EXPECTED)
    assert to_canonical_text(of(Hold(do="hold", duration_s=3.0))) != to_canonical_text(EXPECTED)
    assert "\n" not in to_canonical_text(EXPECTED)


DURATION: Path = ("phases", 0, "parts", 0, "duration_s")
PARTS = (
    "hold, step, ramp, pulse, sine, sweep, prbs, multisine, push, hand, load, learn, "
    "tuning, wall, no_wall, choose, repeat, until_contact"
)


@pytest.mark.parametrize(
    ("old", "new", "line", "path", "code", "values"),
    [
        ("duration_s: 2.0", "duration_s: &a 2.0", 10, (), "anchor_or_alias", {}),
        ("duration_s: 2.0", "duration_s: *a", 10, (), "anchor_or_alias", {}),
        ("duration_s: 2.0", "duration_s: !!python/name:os.system x", 10, (), "unsupported_tag", {}),
        ("duration_s: 2.0", "duration_s: !mine 2", 10, (), "unsupported_tag", {"tag": "!mine"}),
        ("duration_s: 2.0", "duration_s: !!timestamp 2001-01-01", 10, (), "unsupported_tag", {}),
        ("duration_s: 2.0", "duration_s: !!binary aGk=", 10, (), "unsupported_tag", {}),
        ("duration_s: 2.0", "duration_s: !!set {a}", 10, (), "unsupported_tag", {}),
        ("duration_s: 2.0", "duration_s: 1e400", 10, DURATION, "unsupported_scalar", {"value": "1e400"}),
        ("duration_s: 2.0", "duration_s: -1e400", 10, DURATION, "unsupported_scalar", {"value": "-1e400"}),
        ("duration_s: 2.0", f"duration_s: {'123456789' * 2}9", 10, DURATION, "too_many_digits", {}),
        ("duration_s: 2.0", "duration_s: 2.0\n        do: hold", 11, (*DURATION[:4], "do"), "key_given_twice", {}),
        ("duration_s: 2.0", "duration_s: true", 10, DURATION, "invalid_value", {}),
        ("duration_s: 2.0", "duration_s: null", 10, DURATION, "invalid_value", {}),
        ("duration_s: 2.0", "duration_s: [2.0]", 10, DURATION, "invalid_value", {}),
        ("duration_s: 2.0", "duration_s: {a: 2.0}", 10, DURATION, "invalid_value", {}),
        ("duration_s: 2.0", "duration_s: " + "1+" * 100 + "1", 10, DURATION, "invalid_value", {}),
        ("duration_s: 2.0", "2: 2.0", 10, DURATION[:4], "key_not_a_text", {"key": 2}),
        ("do: hold", "do: [", 11, (), "not_yaml_or_json", {}),
        ("do: hold", "do: fly", 9, DURATION[:4], "unknown_part", {"name": "fly", "known": PARTS}),
        ("name: small", "name: small\nname: other", 4, ("name",), "key_given_twice", {}),
        ("format: 1", "format: 2", 2, ("format",), "unknown_format", {"value": 2, "known": 1}),
        ("format: 1", "format: one", 2, ("format",), "unknown_format", {"value": "one"}),
        ("title: Small", f"title: {'x' * 101}", 4, ("title",), "invalid_value", {"error_type": "string_too_long"}),
        ("title: Small", "title: Small\n---\nname: other", 5, (), "not_yaml_or_json", {}),
    ],
)
def test_an_unsupported_construct_is_rejected_with_its_line(
    old: str, new: str, line: int, path: Path, code: str, values: dict[str, object]
) -> None:
    assert SMALL.count(old) == 1
    with refused_because(ExperimentError, code, **values) as caught:
        parse_experiment(SMALL.replace(old, new))
    assert (caught.value.line, caught.value.path[: len(path)]) == (line, path)


@pytest.mark.parametrize(
    ("path", "line", "place", "text"),
    [
        (DURATION, 10, "phases 1, parts 1, duration_s", "line 10: phases 1, parts 1, duration_s: too long"),
        (DURATION, None, "phases 1, parts 1, duration_s", "phases 1, parts 1, duration_s: too long"),
        ((), 3, "", "line 3: too long"),
        ((), None, "", "too long"),
    ],
)
def test_line_and_path_precede_the_reason(path: Path, line: int | None, place: str, text: str) -> None:
    error = ExperimentError(Message("too long", "too_long"), path, line)
    assert (error.message, error.message.code) == (text, "at_place")
    assert error.message.values == {"line": line, "place": place, "reason": "too long"}
    check_reason(error, "too_long")


@pytest.mark.parametrize("least", [MAX_CHARACTERS + 1, 1_000_000])
def test_a_text_that_is_too_long_is_not_parsed(least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(parser, "_Loader")
    with refused_because(ExperimentError, "text_too_long", characters=least, maximum=MAX_CHARACTERS):
        parse_experiment(SMALL + "#" * (least - len(SMALL)))


def test_a_text_of_the_maximum_length_is_parsed() -> None:
    assert parse_experiment(SMALL + "#" * (MAX_CHARACTERS - len(SMALL)))[0] == EXPECTED


@pytest.mark.parametrize("nest", ["[", "{a: ", "- ", "? "])
@pytest.mark.parametrize("deep", [42, 200, 20_000])
def test_a_text_that_is_nested_too_deeply_is_rejected(nest: str, deep: int) -> None:
    closing = {"[": "]", "{a: ": "}"}.get(nest, "")
    with pytest.raises(ExperimentError):
        parse_experiment(nest * deep + "1" + closing * deep)


@given(st.text(max_size=300))
def test_an_arbitrary_text_is_rejected_with_a_message(text: str) -> None:
    with pytest.raises(ExperimentError) as refused:
        parse_experiment(text)
    assert str(refused.value)


@given(st.sampled_from(READY_NAMES), st.integers(0, 2000), st.text(max_size=4))
def test_a_typing_error_gives_an_experiment_or_a_rejection(name: str, at: int, typed: str) -> None:
    text = load_ready_text(name)
    with suppress(ExperimentError):
        assert isinstance(parse_experiment(text[:at] + typed + text[at + len(typed) :])[0], Experiment)


# Expressions have their arithmetic value; other texts are rejected.

KNOWN: Names = {"hold_s": 3.0, "count": 4, "profile": "hand", "on": True}


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (7, 7.0),
        (0.25, 0.25),
        ("2 * hold_s", 6.0),
        ("  hold_s  ", 3.0),
        ("-hold_s + +1", -2.0),
        ("pi / 3", math.pi / 3.0),
        ("hold_s ** 2 / count % 2", 0.25),
        ("0.9 * (0.5 / 0.9) ** (1 / (count - 1))", 0.9 * (0.5 / 0.9) ** (1.0 / 3.0)),
        ("max(hold_s, count, 1) - min(1, 2)", 3.0),
        ("abs(-2.5) + sqrt(count) + round(2.6)", 7.5),
        ("1.0 if on else 2.0", 1.0),
        ("1.0 if profile == 'steps' else 2.0", 2.0),
        ("1 if 1 < hold_s <= 3 and not count > 4 else 0", 1.0),
        ("1 if hold_s != 3 or count >= 4 else 0", 1.0),
        ("1e-3", 0.001),
    ],
)
def test_an_expression_has_its_arithmetic_value(expression: float | str, expected: float) -> None:
    assert evaluate_number(expression, KNOWN) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("expression", "held"),
    [("hold_s < count", True), ("hold_s < count < 4", False), ("profile == 'hand'", True), ("not on", False)],
)
def test_a_comparison_is_true_or_false(expression: str, held: bool) -> None:
    assert evaluate_condition(expression, KNOWN) is held


@pytest.mark.parametrize(
    "expression",
    [
        "__import__('os').system('true')",
        "().__class__",
        "pi.real",
        "pi()",
        "open('x')",
        "[1][0]",
        "{1: 2}",
        "[x for x in (1,)]",
        "lambda: 1",
        "(x := 1)",
        "x = 1",
        "f'{hold_s}'",
        "max(1, key=2)",
        "max(*hold_s)",
        "~count",
        "7 // 2",
        "7 @ 2",
        "1 << 30",
        "1 in 2",
        "on is on",
        "1, 2",
        "await hold_s",
        "None",
        "...",
        "1j",
        "b'1'",
        "",
        " ",
        "1 +",
        "1; 2",
        "\x00",
        "\ud800",
        "(" * 5_000,
        "-" * 50_000 + "1",
    ],
)
def test_unsupported_expressions_are_rejected_by_every_evaluator(expression: str) -> None:
    for ask in (evaluate_number, evaluate_condition, require_known):
        with pytest.raises(ExpressionError):
            ask(expression, KNOWN)


@pytest.mark.parametrize(
    ("expression", "code", "values"),
    [
        ("1 / 0", "no_value", {"expression": "1 / 0"}),
        ("count % 0", "no_value", {}),
        ("2 ** 1e9", "no_value", {}),
        ("9 ** 9 ** 9 ** 9", "no_value", {}),
        ("(-8) ** 0.5", "no_value", {}),
        ("sqrt(-1)", "no_value", {}),
        ("abs()", "no_value", {}),
        ("'a' + 1", "no_value", {}),
        ("'a' * 1000000", "no_value", {}),
        ("profile < 3", "no_value", {}),
        ("1e999", "not_a_finite_number", {"value": math.inf}),
        ("1e308 * 10", "not_a_finite_number", {"value": math.inf}),
        ("1e999 - 1e999", "not_a_finite_number", {"value": pytest.approx(math.nan, nan_ok=True)}),
        ("profile", "not_a_finite_number", {"value": "hand"}),
        ("on", "not_a_finite_number", {"value": True}),
        ("1 < 2", "not_a_finite_number", {"value": True}),
        ("hold", "unknown_name", {"name": "hold", "known": "hold_s, count, profile, on, pi"}),
        ("nan", "unknown_name", {"name": "nan"}),
        ("hold_s if 1 < 2 else hold", "unknown_name", {"name": "hold"}),
    ],
)
def test_an_expression_without_a_value_has_a_reason(expression: str, code: str, values: dict[str, object]) -> None:
    with refused(ExpressionError, code, **values):
        evaluate_number(expression, KNOWN)


def test_a_division_by_zero_is_named_as_such() -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate_number("1 / 0", KNOWN)
    assert "division" in str(caught.value.message.values["reason"])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True])
def test_literal_values_that_are_not_finite_are_rejected(value: float) -> None:
    with refused(ExpressionError, "not_a_finite_number"):
        evaluate_number(value, KNOWN)


def test_a_number_is_rejected_as_a_comparison() -> None:
    with refused(ExpressionError, "not_a_comparison", value=4.0):
        evaluate_condition("hold_s + 1", KNOWN)


def test_unknown_names_are_found_without_evaluation() -> None:
    require_known("1 / (count - count)", KNOWN)
    require_known(3.0, KNOWN)
    with refused(ExpressionError, "unknown_name", name="depth"):
        require_known("max(1, 2 * depth)", KNOWN)


@given(st.text(max_size=200))
def test_an_arbitrary_text_evaluates_to_a_number_or_is_rejected(text: str) -> None:
    with suppress(ExpressionError):
        assert math.isfinite(evaluate_number(text, KNOWN))


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.sampled_from(["+", "-", "*", "<", "<=", ">", ">=", "==", "!="]))
def test_operators_give_the_same_results_as_in_python(a: float, b: float, sign: str) -> None:
    names = {"a": a, "b": b}
    expected = eval(f"a {sign} b", {}, names)
    found = (
        evaluate_condition(f"a {sign} b", names)
        if isinstance(expected, bool)
        else evaluate_number(f"a {sign} b", names)
    )
    assert found == expected


@pytest.mark.parametrize(
    "expression",
    [
        "round(1, -1000000000)",
        "round(1, 1e300)",
        "round(1, 0.5)",
        "10 ** 400",
        "9" * 400,
        "1" + " + 1" * 101,
        "-" * 31 + "1",
        "(" * 40 + "-1" + ")" * 40 + " + 0" * 101,
        "min(" * 31 + "1" + ")" * 31,
        10**400,
    ],
)
def test_a_costly_expression_is_rejected_before_its_evaluation(expression: str | int) -> None:
    with pytest.raises(ExpressionError):
        evaluate_number(expression, {})


@pytest.mark.parametrize(
    ("expression", "value"), [("round(7.5)", 8.0), ("round(2.345, 1)", 2.3), ("round(1234, -2)", 1200.0)]
)
def test_expressions_round_like_floats(expression: str, value: float) -> None:
    assert evaluate_number(expression, {}) == value


def test_integers_are_floats_in_every_operation() -> None:
    """With Python integers, 3 ** 2000 would be exact and its cost unbounded."""
    assert evaluate_number("n * n", {"n": 2**60}) == float(2**60) ** 2
    with pytest.raises(ExpressionError):
        evaluate_number("3 ** 2000", {})


# Parts selected by a setting: each value has its parts, and only those are executed.

HOW = "settings:\n  - {name: how, kind: choice, symbol: how, meaning: way, default: up, choices: [up, down]}\n"
UP, DOWN = "up: [{do: step, q_ref: 0.2, duration_s: 1}]", "down: [{do: step, q_ref: -0.2, duration_s: 2}]"


def chosen(*of: str, by: str = "how") -> str:
    return with_parts("{do: hold, duration_s: 1}", f"{{do: choose, by: {by}, of: {{{', '.join(of)}}}}}", settings=HOW)


@pytest.mark.parametrize(("how", "q_ref", "duration_s"), [("up", 0.2, 1.0), ("down", -0.2, 2.0)])
def test_a_choice_plays_the_parts_of_the_selected_value(how: str, q_ref: float, duration_s: float) -> None:
    segment = plan_of(chosen(UP, DOWN), how=how).program().segments[1]
    assert (segment.q_ref, segment.duration_s) == (q_ref, duration_s)


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        (chosen(UP), "choices_without_parts", {"choices": "up, down"}),
        (chosen(DOWN), "choices_without_parts", {"choices": "up, down"}),
        (chosen(), "choices_without_parts", {"choices": "up, down"}),
        (chosen(UP, DOWN, "sideways: []"), "choices_without_parts", {"choices": "up, down"}),
        (chosen(UP, DOWN, by="where"), "setting_without_choices", {"name": "where"}),
        (chosen(UP, UP), "key_given_twice", {}),
    ],
)
def test_a_choice_without_parts_is_rejected_with_its_line(text: str, code: str, values: dict[str, object]) -> None:
    with refused_because(ExperimentError, code, **values) as caught:
        plan_of(text)
    assert caught.value.line == 11


def test_a_value_that_is_not_among_the_choices_is_refused() -> None:
    with pytest.raises(ValueError, match="choose one of up, down"):
        plan_of(chosen(UP, DOWN), how="sideways")
