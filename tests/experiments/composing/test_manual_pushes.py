"""Random manual pushes stay within their bounds and are reproducible by their seed."""

import math

import numpy as np
import pytest

from backend.experiments.compiler import SMOOTH_SEGMENT_S, PushSegment, generate_manual_pushes, generate_smooth_push
from backend.realtime.program import Shape


@pytest.mark.parametrize(("start", "end"), [(0.0, 12.0), (12.0, 0.0), (-5.0, 7.0)])
def test_a_smooth_push_goes_along_half_a_cosine(start: float, end: float) -> None:
    pieces = list(generate_smooth_push(start, end, 0.8))
    share = np.arange(1, 21) / 20.0
    expected = start + (end - start) * 0.5 * (1.0 - np.cos(math.pi * share))
    np.testing.assert_allclose([piece.F_push for piece in pieces], expected, atol=1e-12)
    assert {(piece.duration_s, piece.shape) for piece in pieces} == {(SMOOTH_SEGMENT_S, Shape.RAMP)}
    assert pieces[-1].F_push == pytest.approx(end)


def pushes(pieces: list[PushSegment]) -> list[list[PushSegment]]:
    """The pieces of each push: it ends with its pause, without force."""
    found: list[list[PushSegment]] = [[]]
    for piece in pieces:
        found[-1].append(piece)
        if piece.shape is Shape.STEP and piece.F_push == 0.0:
            found.append([])
    assert found.pop() == []
    return found


def test_each_push_rises_holds_lets_go_and_pauses() -> None:
    found = pushes(list(generate_manual_pushes(20.0, 40, 2.0, 5)))
    assert len(found) == 40
    for push in found:
        held, pause = (piece for piece in push if piece.shape is Shape.STEP)
        forces = np.array([piece.F_push for piece in push[:-1]])
        at = push.index(held)
        assert 0.3 * 20.0 <= abs(held.F_push) <= 20.0
        assert 0.2 <= held.duration_s <= 1.5
        assert 0.3 * 2.0 <= pause.duration_s <= 2.0
        assert (np.diff(np.abs(forces[: at + 1])) >= -1e-9).all()
        assert (np.diff(np.abs(forces[at:])) <= 1e-9).all()
        for ramp in (push[:at], push[at + 1 : -1]):
            assert 0.3 - SMOOTH_SEGMENT_S / 2.0 <= len(ramp) * SMOOTH_SEGMENT_S <= 0.9 + SMOOTH_SEGMENT_S / 2.0
        assert push[-2].F_push == pytest.approx(0.0, abs=1e-12)
    assert {math.copysign(1.0, max(push, key=lambda piece: abs(piece.F_push)).F_push) for push in found} == {-1.0, 1.0}


def test_the_same_seed_gives_the_same_pushes_and_another_one_others() -> None:
    again = [list(generate_manual_pushes(20.0, 3, 1.0, seed)) for seed in (0, 0, 1)]
    assert again[0] == again[1]
    assert again[0] != again[2]


def test_more_pushes_begin_as_fewer_do() -> None:
    few, many = (list(generate_manual_pushes(20.0, pushes, 1.0, 7)) for pushes in (2, 5))
    assert many[: len(few)] == few
