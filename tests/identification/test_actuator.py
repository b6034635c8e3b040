"""The default experiment on a linear system that is simulated by other means than the estimator's."""

import numpy as np
import pytest
from scipy.signal import lsim, max_len_seq

from backend.identification.actuator import ActuatorGeometry, ActuatorIdentification, identify_actuator
from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method
from backend.identification.models import Estimate, Grade
from backend.identification.records import Record

GEOMETRY = ActuatorGeometry(r_m=0.0075, r_j=0.075, k2=8543.8)
PERIOD_S = 1e-3
LAG_S = 0.0854
START = 1000


def test_a_count_is_a_turn_by_the_encoders_counts() -> None:
    assert 4000 * GEOMETRY.q_resolution == pytest.approx(2.0 * np.pi)
    # An eighth-thousandth of a turn at motor A stretches its spring by r_m of it, which stiffens the joint.
    assert 8000 * GEOMETRY.S_resolution == pytest.approx(2.0 * 0.075**2 * 8543.8 * 0.0075 * 2.0 * np.pi)


def default_experiment(amplitude_rad: float = 1.0, chip: int = 80) -> dict[str, np.ndarray]:
    chips = np.repeat(2.0 * max_len_seq(7)[0] - 1.0, chip)
    u = np.concatenate((np.zeros(START), amplitude_rad * np.tile(chips, 2)))
    t = np.arange(u.size) * PERIOD_S
    theta = lsim(([1.0], np.poly(np.full(4, -1.0 / LAG_S)) * LAG_S**4), u, t, interp=False)[1]
    count_q, count_theta = 2 * np.pi / 4000, 2 * np.pi / 8000
    q = np.round((0.4 + 0.05 * theta) / count_q) * count_q
    S = 8.24 + 0.721 * np.round(theta / count_theta) * count_theta
    return {"theta_A_ref": 8.0 + u, "q": q, "S": S}


@pytest.fixture(scope="module")
def found() -> ActuatorIdentification:
    return identify_actuator(default_experiment(), PERIOD_S, GEOMETRY, START)


def test_default_experiment_gives_gains_lags_and_rest_point(found: ActuatorIdentification) -> None:
    for reduced, gain in ((found.G_q.first_order, 0.05), (found.G_S.first_order, 0.721)):
        np.testing.assert_allclose((reduced.K, reduced.T), (gain, 4 * LAG_S), rtol=5e-3)
    assert found.S_nominal == pytest.approx(8.24, abs=1e-3)
    assert found.q_nominal == pytest.approx(0.4, abs=2e-3)
    assert found.verdict.grade is Grade.USABLE


@pytest.mark.parametrize("start", [0, 1, 7, 499, 501, 1000])
def test_the_nominal_point_is_the_mean_of_the_half_second_before_the_excitation(start: int) -> None:
    """From the very first sample on where there is less before it; that sample itself where there is nothing before."""
    samples = default_experiment()
    # Every sample tells that it was counted: the square of its number.
    samples["S"] = samples["S"] + 1e-9 * np.arange(samples["S"].size) ** 2
    found = identify_actuator(samples, PERIOD_S, GEOMETRY, start, ("first",))
    before = range(max(start - 500, 0), max(start, 1))
    assert found.S_nominal == pytest.approx(sum(samples["S"][k] for k in before) / len(before), rel=1e-12)
    assert found.q_nominal == pytest.approx(sum(samples["q"][k] for k in before) / len(before), rel=1e-12)


def test_the_papers_arx_is_there_beside_it_and_is_what_a_file_gives(found: ActuatorIdentification) -> None:
    samples = default_experiment()
    for by_arx, column in ((found.arx_q, "q"), (found.arx_S, "S")):
        assert isinstance(by_arx, Estimate)
        alone = estimate_model(
            Record(PERIOD_S, samples["theta_A_ref"][START:], samples[column][START:]), "first", Method.ARX
        )
        assert by_arx.method == alone.method == "ARX with low-pass prefilter"
        assert by_arx.first_order == alone.first_order


def test_too_little_motion_is_said_with_the_number_of_counts() -> None:
    found = identify_actuator(default_experiment(amplitude_rad=0.5, chip=5), PERIOD_S, GEOMETRY, START)
    assert found.verdict.grade is Grade.UNUSABLE
    assert "not enough motion" in found.verdict.sentence
    assert f"{found.motion_counts:.1f} counts" in found.verdict.sentence
