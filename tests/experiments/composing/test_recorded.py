"""Parts built from recorded references reproduce them within the reported deviations."""

from typing import Any

import numpy as np
import pytest

from backend.experiments.library import (
    TOLERANCE_F_N,
    TOLERANCE_Q_RAD,
    TOLERANCE_S,
    ReferenceChange,
    approximate_columns,
    find_commanded_range,
)
from backend.experiments.parser import ExperimentError, build_experiment
from backend.experiments.plans import ExperimentPlan
from backend.realtime.program import Law, Program, Segment, Shape
from plant.interface import T_s
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
    return played(ExperimentPlan(build_experiment(document, {}), {}).program(), 0.0, 10.0)


@pytest.mark.parametrize("segments", [STEPS_AND_RAMPS, SINE], ids=["steps and ramps", "sine"])
def test_what_is_played_again_is_what_was_recorded(segments: tuple[Segment, ...]) -> None:
    recorded = played(Program(Law.CASCADE, segments), 0.0, 10.0)
    found = approximate_columns(recorded[:, 0], recorded[:, 1])
    replayed = again(found.parts)
    assert len(replayed) == len(recorded)
    off_q, deviation_S = np.abs(replayed - recorded).max(axis=0)
    assert off_q == pytest.approx(found.deviation_q_rad, abs=1e-9)
    assert deviation_S == pytest.approx(found.deviation_S, abs=1e-9)
    assert off_q <= TOLERANCE_Q_RAD
    assert deviation_S <= TOLERANCE_S


def test_steps_holds_and_ramps_come_back_as_they_were_written() -> None:
    recorded = played(Program(Law.CASCADE, STEPS_AND_RAMPS), 0.0, 10.0)
    parts = approximate_columns(recorded[:, 0], recorded[:, 1]).parts
    assert [part["do"] for part in parts] == ["step", "ramp", "hold", "ramp", "step"]
    assert [part["duration_s"] for part in parts] == [segment.duration_s for segment in STEPS_AND_RAMPS]


def test_a_ramp_after_a_step_has_the_reported_deviation() -> None:
    way = np.linspace(0.3, 0.6, 1000)
    found = approximate_columns(way, np.full(1000, 10.0))
    replayed = again(found.parts)
    assert found.deviation_q_rad == pytest.approx(np.abs(replayed[:1000, 0] - way).max(), abs=1e-9)
    assert found.deviation_q_rad == pytest.approx(9 * 0.3 / 999, abs=1e-6)  # of the shortest part there is, ten ticks


@pytest.mark.parametrize(
    ("q_ref", "told"),
    [
        (np.full(100, np.nan), "no references"),
        (np.where(np.arange(100) == 50, np.nan, 0.0), "a gap"),
    ],
    ids=["none", "gap"],
)
def test_what_was_not_commanded_cannot_be_followed(q_ref: np.ndarray, told: str) -> None:
    with pytest.raises(ExperimentError, match=told):
        find_commanded_range(q_ref, np.full(len(q_ref), 10.0))


def test_too_many_parts_are_refused() -> None:
    q_ref = np.where(np.arange(40_000) // 20 % 2, 0.1, 0.0)
    with pytest.raises(ExperimentError, match="more than 1000"):
        approximate_columns(q_ref, np.full(len(q_ref), 10.0))


def pushed(parts: list[dict[str, Any]]) -> np.ndarray:
    """The push at every tick, by what docs/how-to/experiments.md says of the parts."""
    ticks: list[float] = []
    before = 0.0
    for part in parts:
        length = round(part.get("duration_s", 0.0) / T_s)
        F = part.get("F_push", 0.0)
        ramp = part.get("shape") == "ramp"
        ticks += [before + (F - before) * (k + 1) / length if ramp else F for k in range(length)]
        before = F if length else before
    return np.array(ticks)


def test_pushes_come_back_at_their_ticks_with_their_force() -> None:
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


def test_a_smooth_push_is_followed_within_its_bound() -> None:
    F = np.zeros(3000)
    F[1000:2000] = 8.0 * np.sin(np.pi * np.arange(1000) / 1000.0) ** 2
    found = approximate_columns(np.full(3000, 0.1), np.full(3000, 10.0), F)
    off = np.abs(pushed(found.parts)[:3000] - F).max()
    assert off <= TOLERANCE_F_N
    assert off == pytest.approx(found.deviation_F_N, abs=1e-9)


def test_a_push_is_left_out_while_the_references_move_and_reported() -> None:
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


def test_changes_come_before_the_part_that_begins_at_their_tick() -> None:
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
