"""Formulas over many samples at once, against values worked out by hand and against the language of experiments."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.experiments.parser import (
    SIGNAL_NAMES,
    ExpressionError,
    evaluate_condition,
    evaluate_number,
    parse_derived_signal,
)
from backend.sample import COMBINED_SIGNALS, STORED_NAMES

CASES = json.loads((Path(__file__).parent / "formula_cases.json").read_text())
"""The page's test evaluates the same (frontend/src/samples/formula.test.ts)."""

LENGTHS = {"r_m": 0.0075, "r_j": 0.075}


def numbers(values: list[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([math.nan if value is None else value for value in values])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["expression"])
def test_values(case: dict[str, Any]) -> None:
    derived = parse_derived_signal("made", "1", case["expression"])
    columns = {name: numbers(values) for name, values in case["columns"].items()}
    wanted = numbers(case["values"])
    np.testing.assert_allclose(derived.values(columns, LENGTHS, len(wanted)), wanted, rtol=1e-12, atol=1e-15)


def test_the_steps_in_the_page_s_fixture_are_those_of_the_expressions() -> None:
    fixture = Path(__file__).parents[2] / "frontend/src/samples/formulaCases.fixture.json"
    made = [
        case | {"steps": [vars(step) for step in parse_derived_signal("made", "1", case["expression"]).steps]}
        for case in CASES
    ]
    assert json.loads(fixture.read_text()) == made


@pytest.mark.parametrize("name", SIGNAL_NAMES)
def test_every_signal_may_be_named(name: str) -> None:
    derived = parse_derived_signal("made", "1", f"2 * {name}")
    columns = {one: np.full(2, 3.0) for one in STORED_NAMES}
    combined = {one.name: one for one in COMBINED_SIGNALS}
    one = 3.0
    if name in combined:
        one = sum(term.sign * (LENGTHS[term.length] if term.length else 1.0) * 3.0 for term in combined[name].terms)
    np.testing.assert_allclose(derived.values(columns, LENGTHS, 2), [2 * one, 2 * one], rtol=1e-12)


def test_a_column_or_a_length_that_is_not_there_is_a_gap() -> None:
    derived = parse_derived_signal("made", "1", "q + F_wall")
    assert np.isnan(derived.values({"q": np.ones(3)}, {}, 3)).all()
    assert np.isnan(
        parse_derived_signal("made", "m", "x_A").values({"q": np.ones(1), "theta_A": np.ones(1)}, {}, 1)
    ).all()


@given(
    q=st.floats(-100, 100),
    S=st.floats(-100, 100),
    expression=st.sampled_from(
        ["q + S", "q / S", "q % S", "q ** 2", "abs(q) ** 0.3", "min(q, S)", "round(q, 1)", "q if q > S else S",
         "sqrt(q)", "q * S - S / q", "max(q, -S, 1)", "(q > 0) + (S > 0)", "not q", "q < S < 50"]
    ),
)  # fmt: skip
def test_it_says_what_the_language_of_experiments_says(q: float, S: float, expression: str) -> None:
    """Where that refuses a value, as of a division by zero, there is a gap."""
    derived = parse_derived_signal("made", "1", expression)
    (value,) = derived.values({"q": np.array([q]), "S": np.array([S])}, {}, 1)
    names = {"q": q, "S": S}
    try:
        wanted = evaluate_number(expression, names)
    except ExpressionError as error:
        if "is not a finite number" in str(error) and ("True" in str(error) or "False" in str(error)):
            wanted = float(evaluate_condition(expression, names))
        else:
            assert math.isnan(value)
            return
    assert value == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("F_C + 1", "there is no signal 'F_C': the nearest is F_"),
        ("theta_a", "the nearest is theta_A"),
        ("t * 2", "there is no signal 't'"),
        ("1 + 2", "speaks of no signal"),
        ("q +", "is no expression"),
        ("q.real", "is not taken"),
        ("__import__('os')", "is not taken"),
        ("'text' if q else 1", "is not taken"),
        ("sqrt(q, 2)", "sqrt takes 1 values, here are 2"),
        ("min(q)", "min takes 2 to 50 values, here are 1"),
        ("abs()", "abs takes 1 values"),
        ("round(q, ndigits=1)", "is not taken"),
        ("[q for q in q]", "is not taken"),
        ("q" + " + q" * 200, "characters"),
        ("-" * 40 + "q", "nested at most"),
    ],
)
def test_what_is_refused(expression: str, said: str) -> None:
    with pytest.raises(ExpressionError) as refused:
        parse_derived_signal("made", "1", expression)
    assert said in str(refused.value)


@pytest.mark.parametrize("name", ["q", "x_A", "min", "pi", "and", "t", "1a", "a b", "", "a" * 21, "_a"])
def test_names_that_are_taken_or_odd_are_refused(name: str) -> None:
    with pytest.raises(ExpressionError):
        parse_derived_signal(name, "1", "q")
