"""Parts selected by a setting: each value has its parts, and only those are executed."""

import pytest

from backend.experiments.parser import ExperimentError
from tests.experiments.composing.written import plan_of, with_parts

HOW = "settings:\n  - {name: how, kind: choice, symbol: how, meaning: way, default: up, choices: [up, down]}\n"
UP, DOWN = "up: [{do: step, q_ref: 0.2, duration_s: 1}]", "down: [{do: step, q_ref: -0.2, duration_s: 2}]"


def chosen(*of: str, by: str = "how") -> str:
    return with_parts("{do: hold, duration_s: 1}", f"{{do: choose, by: {by}, of: {{{', '.join(of)}}}}}", settings=HOW)


@pytest.mark.parametrize(("how", "q_ref", "duration_s"), [("up", 0.2, 1.0), ("down", -0.2, 2.0)])
def test_the_parts_of_the_value_are_played(how: str, q_ref: float, duration_s: float) -> None:
    segment = plan_of(chosen(UP, DOWN), how=how).program().segments[1]
    assert (segment.q_ref, segment.duration_s) == (q_ref, duration_s)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (chosen(UP), "it needs parts for each of up, down"),
        (chosen(DOWN), "it needs parts for each of up, down"),
        (chosen(), "it needs parts for each of up, down"),
        (chosen(UP, DOWN, "sideways: []"), "it needs parts for each of up, down"),
        (chosen(UP, DOWN, by="where"), "'where' is no setting with choices"),
        (chosen(UP, UP), "it is said twice"),
    ],
)
def test_a_choice_without_parts_is_refused_in_its_line(text: str, told: str) -> None:
    with pytest.raises(ExperimentError) as refused:
        plan_of(text)
    assert told in str(refused.value)
    assert refused.value.line == 11


def test_a_value_that_is_not_among_the_choices_is_refused() -> None:
    with pytest.raises(ValueError, match="choose one of up, down"):
        plan_of(chosen(UP, DOWN), how="sideways")
