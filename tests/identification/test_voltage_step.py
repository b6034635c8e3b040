"""A run of the motor without load: refused with the reason where nothing can be learnt from it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.identification.motor import VoltageStepRecord
from backend.identification.records import RecordError

N = 400
PERIOD_S = 1e-3
COUNT_RAD = 2.0 * np.pi / 8000
U = np.where(np.arange(N) < 50, 0.0, 3.0)
THETA = np.maximum(np.arange(N) - 50, 0) * PERIOD_S * 8.0
GOOD = VoltageStepRecord(PERIOD_S, U, THETA, 10.0, COUNT_RAD, np.full(N, 0.2))


def with_nan(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    spoilt = signal.copy()
    spoilt[7] = np.nan
    return spoilt


def test_a_run_says_when_it_steps_and_how_high() -> None:
    assert (GOOD.first, GOOD.voltage) == (50, 3.0)
    assert (replace(GOOD, u=-U).first, replace(GOOD, u=-U).voltage) == (50, -3.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta": THETA[:-1]}, "give u and theta of one length"),
        ({"u": U[:-1]}, "give u and theta of one length"),
        ({"u": U.reshape(2, -1), "theta": THETA.reshape(2, -1)}, "give u and theta of one length"),
        ({"u": U[30:79], "theta": THETA[30:79]}, "length of the run is 49 samples, must be at least 50 samples"),
        ({"u": with_nan(U)}, "number of samples of u that are not finite is 1, must be at most 0"),
        ({"theta": with_nan(THETA)}, "number of samples of theta that are not finite is 1, must be at most 0"),
        ({"u_max": 3.0}, "voltage is 3 V, must be at most 3 V: the output saturates"),
        ({"u": 0.0 * U}, "change of voltage after the step is 0 V"),
        ({"u": U + 0.01 * (np.arange(N) > 300)}, "after the step is 0.01 V, must be at most 0.00301 V"),
        ({"tension_N": np.full(N, 0.6)}, "tendon force is 0.6 N, must be at most 0.5 N: the load touches"),
        ({"tension_N": np.full(N, -0.6)}, "tendon force is 0.6 N, must be at most 0.5 N: the load touches"),
        ({"theta": 0.05 * THETA}, "must be at least 200 counts: step higher or record for longer"),
    ],
)
def test_what_is_no_free_step_is_refused(change: dict[str, NDArray[np.float64]], message: str) -> None:
    with pytest.raises(RecordError) as refusal:
        replace(GOOD, **change)  # type: ignore[arg-type]  # which of the fields it is, the case says
    assert message in str(refusal.value)
