"""Recorded references made into parts: what these play is what was recorded, tick by tick, within what is stated."""

from typing import Any

import numpy as np
import pytest

from backend.experiments.composing.recorded import WITHIN_Q_RAD, WITHIN_S, followed
from backend.experiments.composing.refused import ExperimentError
from backend.experiments.composing.text import of_document
from backend.experiments.plans.composed_plan import ComposedPlan
from backend.loop.program import Law, Program, Segment, Shape
from tests.experiments.test_profile import played

STEPS_AND_RAMPS = (
    Segment(0.5, 0.2, 9.0),
    Segment(1.0, -0.4, 11.0, shape=Shape.RAMP),
    Segment(0.7, -0.4, 11.0),
    Segment(1.5, 0.5, 11.0, shape=Shape.RAMP),
    Segment(0.4, 0.1, 10.0),
)
SINE = (Segment(0.5, 0.0, 10.0), Segment(4.0, 0.4, 11.0, shape=Shape.SINE, period_s=2.0))


def again(parts: list[dict[str, Any]]) -> np.ndarray:
    """Every tick as the loop plays the parts, of an experiment that is read as any other."""
    document = {
        "format": 1,
        "name": "again",
        "title": "Again",
        "phases": [{"name": "recorded", "title": "Recorded", "parts": parts}],
    }
    return played(ComposedPlan(of_document(document, {}), {}).program(), 0.0, 10.0)


@pytest.mark.parametrize("segments", [STEPS_AND_RAMPS, SINE], ids=["steps and ramps", "sine"])
def test_what_is_played_again_is_what_was_recorded(segments: tuple[Segment, ...]) -> None:
    recorded = played(Program(Law.CASCADE, segments), 0.0, 10.0)
    found = followed(recorded[:, 0], recorded[:, 1])
    replayed = again(found.parts)
    assert len(replayed) == len(recorded)
    off_q, off_S = np.abs(replayed - recorded).max(axis=0)
    assert off_q == pytest.approx(found.off_q_rad, abs=1e-9)
    assert off_S == pytest.approx(found.off_S, abs=1e-9)
    assert off_q <= WITHIN_Q_RAD
    assert off_S <= WITHIN_S


def test_steps_holds_and_ramps_come_back_as_they_were_written() -> None:
    recorded = played(Program(Law.CASCADE, STEPS_AND_RAMPS), 0.0, 10.0)
    parts = followed(recorded[:, 0], recorded[:, 1]).parts
    assert [part["do"] for part in parts] == ["step", "ramp", "hold", "ramp", "step"]
    assert [part["duration_s"] for part in parts] == [segment.duration_s for segment in STEPS_AND_RAMPS]


def test_a_way_that_begins_with_a_jump_is_off_by_what_is_told() -> None:
    way = np.linspace(0.3, 0.6, 1000)
    found = followed(way, np.full(1000, 10.0))
    replayed = again(found.parts)
    assert found.off_q_rad == pytest.approx(np.abs(replayed[:1000, 0] - way).max(), abs=1e-9)
    assert found.off_q_rad == pytest.approx(9 * 0.3 / 999, abs=1e-6)  # of the shortest part there is, ten ticks


@pytest.mark.parametrize(
    ("q_ref", "told"),
    [
        (np.full(100, np.nan), "no references"),
        (np.where(np.arange(100) == 50, np.nan, 0.0), "a gap"),
        (np.where(np.arange(40_000) // 20 % 2, 0.1, 0.0), "more than 1000"),
    ],
    ids=["none", "gap", "too many"],
)
def test_what_cannot_be_followed_is_refused(q_ref: np.ndarray, told: str) -> None:
    with pytest.raises(ExperimentError, match=told):
        followed(q_ref, np.full(len(q_ref), 10.0))
