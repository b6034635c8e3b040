"""Dead times of whole and of broken samples behind every structure, against scipy on a finer grid."""

import numpy as np
import pytest
from scipy.signal import lsim

from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method
from backend.identification.models import Estimate, Grade, find_structure, simulate_response
from backend.identification.records import Controller, IdentificationError, NotConvergedError, Record, StructureError
from tests.identification.own_motor import Array, motor, noisy

PERIOD_S = 1e-3
FINER = 20
TRUTHS = {
    "first+delay": {"K": 2.86, "T": 0.22},
    "third+delay": {"K": 2.0, "T": 0.22, "a2": 4e-4, "a1": 0.01},
    "lags3+delay": {"K": 2.0, "tau": 0.06},
    "order:2+delay": {"b0": 2.86, "a1": 0.27, "a2": 0.011},
}


def chips(count: int = 5000, chip: int = 100, seed: int = 0) -> Array:
    return np.repeat(np.random.default_rng(seed).choice([-5.0, 5.0], count // chip), chip)


def delayed(name: str, u: Array, delay_s: float) -> Array:
    """Scipy's response from rest, on a grid of a twentieth of a sample."""
    truth = TRUTHS[name]
    shape = find_structure(name.removesuffix("+delay"))
    values = np.array(list(truth.values()))
    late = round(FINER * delay_s / PERIOD_S)
    held = np.concatenate((np.zeros(late), np.repeat(u, FINER)))[: FINER * u.size]
    t = np.arange(held.size) * PERIOD_S / FINER
    return np.asarray(lsim(([values[0]], shape.denominator(values)[::-1]), held, t, interp=False)[1][::FINER])


def errors(found: Estimate, truth: dict[str, float]) -> list[float]:
    return [abs(found.model.parameters[name] - value) / found.std_errors[name] for name, value in truth.items()]


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.003, 0.0371])
@pytest.mark.parametrize("name", TRUTHS)
def test_the_simulation_is_exact_between_samples(name: str, delay_s: float) -> None:
    u = chips(1000, 25)
    shape, values = find_structure(name), np.array([*TRUTHS[name].values(), delay_s])
    y = values[0] * simulate_response(shape.poles(values), PERIOD_S, u, dead_time_s=shape.dead_time(values))
    np.testing.assert_allclose(y, delayed(name, u, delay_s), atol=1e-7)


@pytest.mark.parametrize("delay_s", [0.003, 0.0371, 0.15])
@pytest.mark.parametrize("name", TRUTHS)
def test_a_dead_time_comes_back_with_the_rest(name: str, delay_s: float) -> None:
    u = chips()
    found = estimate_model(Record(PERIOD_S, u, noisy(delayed(name, u, delay_s), 0.005)), name)
    truth = {**TRUTHS[name], "t_d": delay_s}
    assert max(errors(found, truth)) < 4.0
    assert found.model.sum_of_lags == pytest.approx(found.first_order.T)
    if found.std_errors["t_d"] < 0.1 * delay_s:
        assert found.verdict.grade is Grade.USABLE
        assert found.residuals.whiteness.passed


def test_a_record_cut_out_of_a_longer_one_gives_the_same_dead_time() -> None:
    u = chips(6000)
    y = 40.0 + noisy(delayed("first+delay", u, 0.0371), 0.005)
    found = estimate_model(Record(PERIOD_S, u[1234:], y[1234:]), "first+delay")
    assert max(errors(found, {**TRUTHS["first+delay"], "t_d": 0.0371})) < 4.0
    assert found.verdict.grade is Grade.USABLE


def test_a_dead_time_that_is_not_there_is_not_usable() -> None:
    u = chips()
    record = Record(PERIOD_S, u, noisy(delayed("first+delay", u, 0.0), 0.01))
    try:
        found = estimate_model(record, "first+delay")
    except NotConvergedError:
        return
    assert found.verdict.grade is not Grade.USABLE
    assert "take a simpler structure" in found.verdict.sentence


@pytest.mark.parametrize("u_c", [0.2, 1.0])
def test_dry_friction_is_not_taken_for_a_dead_time(u_c: float) -> None:
    u = np.repeat(np.random.default_rng(3).uniform(-5.0, 5.0, 20), 300)
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u, u_c, 0.03)[0], 0.01)), "first+delay")
    friction = found.friction
    assert found.verdict.grade is not Grade.USABLE
    assert friction is not None
    assert friction.found
    assert abs(friction.u_c - u_c) < 4.0 * friction.u_c_std
    assert abs(friction.T - 0.22) < 4.0 * friction.T_std
    assert f"behind a dead time of {friction.t_d:.3g} s" in found.verdict.sentence


@pytest.mark.parametrize("name", ["first+delay", "third+delay", "order:4+delay"])
def test_a_record_that_holds_next_to_nothing_is_refused_in_words_or_not_usable(name: str) -> None:
    u = np.repeat(np.linspace(-2.0, 2.0, 9), 300)
    y = np.zeros(u.size)
    y[1000:1005] = -1.0
    try:
        found = estimate_model(Record(0.01, u, y), name)
    except IdentificationError:
        return
    assert found.verdict.grade is Grade.UNUSABLE


def test_what_knows_no_dead_time_refuses_it() -> None:
    u = chips()
    y = delayed("first+delay", u, 0.003)
    with pytest.raises(StructureError, match="use another method"):
        estimate_model(Record(PERIOD_S, u, y), "first+delay", Method.ARX)
    with pytest.raises(StructureError, match="--setpoint in place of --controller"):
        estimate_model(Record(PERIOD_S, u, y, controller=Controller(1.0, 1.0)), "first+delay")
    with pytest.raises(StructureError, match=r"each also with \+delay"):
        find_structure("first+delay+delay")
