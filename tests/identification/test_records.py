"""Unusable records are rejected with quantity, value, bound, unit and remedy."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from backend.identification.records import Record, RecordError, mean_period, rest_at_limit
from tests.refusals import refused

N = 1000
PERIOD_S = 1e-3
RANDOM = np.random.default_rng(0)
U = np.repeat(RANDOM.choice([-1.0, 1.0], N // 50), 50)
Y = np.cumsum(U) * PERIOD_S
T = np.arange(N, dtype=float) * PERIOD_S


def with_nan() -> Record:
    y = Y.copy()
    y[17] = np.nan
    return Record(PERIOD_S, U, y)


def with_gap() -> Record:
    return Record(PERIOD_S, U, Y, t=np.where(np.arange(N) < 400, T, T + 0.010))


def with_time_running_back() -> Record:
    t = T.copy()
    t[500] = t[499]
    return Record(PERIOD_S, U, Y, t=t)


def clipped(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.clip(values, -0.8, 0.8)


def late_sine() -> NDArray[np.float64]:
    """Return the response of a lag of 0.1 s to SINE, in the unit of the clipping."""
    late = lfilter([0.0, 0.01], [1.0, -0.99], SINE)
    return np.asarray(1.6 * late / np.max(late[N // 2 :]))


SINE = np.sin(2 * np.pi * 3.1 * T) + 0.01 * RANDOM.standard_normal(N)

REFUSED: dict[str, tuple[Callable[[], Record], str, dict[str, object]]] = {
    "constant input": (
        lambda: Record(PERIOD_S, np.ones(N), Y),
        "signal_is_constant",
        {"name": "u", "peak_to_peak": 0.0},
    ),
    "constant output": (
        lambda: Record(PERIOD_S, U, np.ones(N)),
        "signal_is_constant",
        {"name": "y", "peak_to_peak": 0.0},
    ),
    "nan": (with_nan, "samples_not_finite", {"name": "y", "count": 1, "first": 17}),
    "short": (lambda: Record(PERIOD_S, U[:100], Y[:100]), "record_too_short", {"length": 100, "minimum": 200}),
    "lengths": (
        lambda: Record(PERIOD_S, U, Y[:-1]),
        "columns_of_unequal_length",
        {"name": "y", "length": 999, "expected": 1000},
    ),
    "gap": (with_gap, "samples_missing", {"sample": 399, "gap_s": pytest.approx(0.011)}),
    "time": (with_time_running_back, "time_step_not_positive", {"sample": 499, "step_s": 0.0}),
    "wrong period": (
        lambda: Record(0.002, U, Y, t=T),
        "sample_time_differs",
        {"sample_time_s": pytest.approx(0.001)},
    ),
    "no period": (
        lambda: Record(0.0, U, Y),
        "sample_time_out_of_bounds",
        {"period_s": 0.0, "minimum_s": 1e-7, "maximum_s": 1e3},
    ),
    "saturated output": (
        lambda: Record(PERIOD_S, SINE, clipped(late_sine())),
        "output_is_saturated",
        {"maximum_percent": 2.0},
    ),
    "matrix": (
        lambda: Record(PERIOD_S, np.ones((N, 2)), Y),
        "signal_is_not_one_column",
        {"name": "u", "dimensions": 2},
    ),
}


@pytest.mark.parametrize(("make", "code", "values"), REFUSED.values(), ids=REFUSED)
def test_bad_records_are_refused(make: Callable[[], Record], code: str, values: dict[str, object]) -> None:
    with refused(RecordError, code, **values):
        make()


@pytest.mark.parametrize(
    ("u", "y"),
    [
        pytest.param(U, Y, id="binary input"),
        pytest.param(U, np.round(Y, 2), id="coarse output"),
        pytest.param(SINE, Y, id="continuous input"),
        pytest.param(clipped(SINE), Y, id="controller output at its limit"),
        pytest.param(np.repeat(RANDOM.integers(0, 30, N // 20).astype(float), 20), Y, id="staircase input"),
    ],
)
def test_good_records_pass(u: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    Record(PERIOD_S, u, y, t=T)


def test_the_signals_of_a_record_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Record(PERIOD_S, U, Y).u[0] = 5.0


def test_the_columns_of_a_part_are_aligned() -> None:
    part = Record(PERIOD_S, U, Y, r=2 * U, t=T).part(100, 400)
    assert part.r is not None
    np.testing.assert_array_equal(part.r, 2 * part.u)
    np.testing.assert_array_equal(part.y, Y[100:400])


def test_two_samples_suffice_for_a_sample_time() -> None:
    assert mean_period(np.array([2.0, 2.5])) == 0.5
    with refused(RecordError, "time_does_not_increase", duration_s=0.0):
        mean_period(np.array([2.0, 2.0]))


@pytest.mark.parametrize(("low", "high", "limit"), [(-0.7, 0.9, -0.7), (-0.9, 0.7, 0.7)])
def test_the_longer_rest_at_a_limit_is_found_with_its_share_of_the_record(
    low: float, high: float, limit: float
) -> None:
    y = np.clip(SINE, low, high)
    found = rest_at_limit(SINE, y)
    assert found is not None
    assert found.limit == limit
    assert found.share_percent == pytest.approx(100.0 * np.mean(y == limit))
    assert 0.0 < found.moving_percent <= found.share_percent
    assert found.abrupt
