"""Which figure a list of runs shows: the criterion that failed, else the first that was measured."""

import pytest

from backend.models.run import MeasuredFigure, Metrics, RunCriterion, find_headline

PASSED = RunCriterion("settling_q_s", "Settling of q", "<", 2.0, 1.5, "s", True)
FAILED = RunCriterion("overshoot_q_percent", "Overshoot of q", "<", 2.0, 3.5, "%", False)
UNSEEN = RunCriterion("min_tension_N", "Smallest tension", ">", 1.0, None, "N", None, "the run ended early")
GAP = MeasuredFigure("rise_q_s", "s", "Rise of q", "10 to 90 %", None, "no step")
PEAK = MeasuredFigure("peak_voltage_V", "V", "Peak voltage", "largest |u|", 6.5)


@pytest.mark.parametrize(
    ("figures", "criteria", "shown"),
    [
        ((PEAK,), (PASSED, FAILED), ("overshoot_q_percent", 3.5, "<", 2.0)),
        ((PEAK,), (UNSEEN, PASSED), ("settling_q_s", 1.5, "<", 2.0)),
        ((GAP, PEAK), (UNSEEN,), ("peak_voltage_V", 6.5, "", None)),
        ((GAP,), (), None),
        (None, (), None),
    ],
)
def test_the_criterion_that_failed_comes_before_what_was_measured(
    figures: tuple[MeasuredFigure, ...] | None,
    criteria: tuple[RunCriterion, ...],
    shown: tuple[str, float, str, float | None] | None,
) -> None:
    metrics = None if figures is None else Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=figures)
    found = find_headline(metrics, criteria)
    assert (None if found is None else (found.name, found.value, found.relation, found.bound)) == shown


def test_the_lower_fit_of_an_identification_comes_before_its_motion() -> None:
    metrics = Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=(PEAK,))
    found = find_headline(metrics, (), {"G_q": 97.2, "G_S": 91.4})
    assert found is not None
    assert (found.name, found.label, found.value, found.unit) == ("fit_percent", "Fit of G_S", 91.4, "%")
    judged = find_headline(metrics, (PASSED,), {"G_q": 97.2})
    assert judged is not None
    assert judged.name == "settling_q_s"
