"""What cannot be identified is refused with the quantity, its value, the bound, the unit and the remedy."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from backend.identification.records import Record, RecordError

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
    """Answer of a lag of 0.1 s to SINE, in the unit in which it is clipped."""
    late = lfilter([0.0, 0.01], [1.0, -0.99], SINE)
    return np.asarray(1.6 * late / np.max(late[N // 2 :]))


SINE = np.sin(2 * np.pi * 3.1 * T) + 0.01 * RANDOM.standard_normal(N)

REFUSED: list[tuple[str, Callable[[], Record], str]] = [
    ("constant input", lambda: Record(PERIOD_S, np.ones(N), Y), "peak-to-peak of u is 0"),
    ("constant output", lambda: Record(PERIOD_S, U, np.ones(N)), "peak-to-peak of y is 0"),
    ("nan", with_nan, r"samples of y that are not finite \(first at index 17\) is 1, must be at most 0"),
    ("short", lambda: Record(PERIOD_S, U[:100], Y[:100]), "length of the record is 100 samples, must be at least 200"),
    ("lengths", lambda: Record(PERIOD_S, U, Y[:-1]), "length of y is 999 samples"),
    ("gap", with_gap, r"gap after sample 399 is 0\.011 s"),
    ("time", with_time_running_back, "time step after sample 499 is 0 s"),
    ("wrong period", lambda: Record(0.002, U, Y, t=T), r"sample time of the time column is 0\.001 s"),
    ("no period", lambda: Record(0.0, U, Y), r"sample time is 0 s, must be at least 1e-07\ss and at most 1000 s"),
    ("saturated output", lambda: Record(PERIOD_S, SINE, clipped(late_sine())), "time with y at its limit of"),
    ("matrix", lambda: Record(PERIOD_S, np.ones((N, 2)), Y), "number of dimensions of u is 2"),
]


@pytest.mark.parametrize(("make", "message"), [case[1:] for case in REFUSED], ids=[case[0] for case in REFUSED])
def test_bad_records_are_refused(make: Callable[[], Record], message: str) -> None:
    with pytest.raises(RecordError, match=message) as refusal:
        make()
    assert refusal.value.remedy in str(refusal.value)


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


def test_a_record_keeps_its_signals_from_being_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Record(PERIOD_S, U, Y).u[0] = 5.0


def test_a_part_keeps_all_columns_aligned() -> None:
    part = Record(PERIOD_S, U, Y, r=2 * U, t=T).part(100, 400)
    assert part.r is not None
    np.testing.assert_array_equal(part.r, 2 * part.u)
    np.testing.assert_array_equal(part.y, Y[100:400])
