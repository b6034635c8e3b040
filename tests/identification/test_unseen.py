"""What a model says of data it has not seen, against SciPy's own simulation and plain least squares."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lsim, tf2ss

from backend.identification.estimation import ModelComparison, validate_held_out, validate_on_record
from backend.identification.fitting import Method, fit_parameters
from backend.identification.models import Model, find_structure
from backend.identification.motor import VoltageStepRecord, validate_motor_step
from backend.identification.records import IdentificationError, Record, Signal

PERIOD_S = 1e-3
K, T, A2, A1 = 0.05, 0.3, 0.004, 0.05
TRUE = ([K], np.polymul([T, 1.0], [A2, A1, 1.0]).astype(np.float64))


def excitation(count: int, seed: int) -> Signal:
    return np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], count // 80 + 1), 80)[:count]


def by_scipy(system: tuple[list[float], Signal], u: Signal) -> Signal:
    """Response from rest to an input that is held between samples."""
    return np.asarray(dlsim(cont2discrete(tf2ss(*system), PERIOD_S, method="zoh"), u)[1][:, 0])


def test_the_true_model_explains_a_cut_record_with_an_offset_whole() -> None:
    u = excitation(12_000, 1)
    y = 0.3 + by_scipy(TRUE, u)
    found = validate_on_record(
        Model("third", {"K": K, "T": T, "a2": A2, "a1": A1}), Record(PERIOD_S, u[5_000:], y[5_000:])
    )
    assert found.measured == pytest.approx(y[5_000:])
    assert found.predicted == pytest.approx(y[5_000:], abs=1e-7)
    assert found.fit_percent == pytest.approx(100.0, abs=1e-3)


def test_fit_and_residual_of_another_model_are_those_of_a_simulation_by_scipy() -> None:
    """From rest the simulation is SciPy's; what no model tells is fitted to the difference by plain least squares."""
    other = Model("first", {"K": 0.9 * K, "T": 0.35})
    u, noise = excitation(9_000, 2), np.random.default_rng(3).normal(0.0, 1e-3, 9_000)
    y = by_scipy(TRUE, u) + noise
    simulated = by_scipy(([0.9 * K], np.array([0.35, 1.0])), u)
    t = np.arange(9_000) * PERIOD_S
    unknown = np.column_stack((np.exp(-t / 0.35), np.ones(9_000), t))
    error = y - simulated
    error = error - unknown @ np.linalg.lstsq(unknown, error, rcond=None)[0]

    found = validate_on_record(other, Record(PERIOD_S, u, y))

    assert found.measured - found.predicted == pytest.approx(error, abs=1e-9)
    assert found.rms == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=1e-9)
    assert found.fit_percent == pytest.approx(100.0 * (1.0 - np.std(error) / np.std(y)), abs=1e-6)
    assert 20.0 < found.fit_percent < 80.0


def test_what_is_held_out_has_no_part_in_its_prediction() -> None:
    """The end of the record is spoiled: its prediction is that of a model which was given the beginning only."""
    u, noise = excitation(9_000, 4), np.random.default_rng(5).normal(0.0, 1e-3, 9_000)
    y = by_scipy(TRUE, u) + noise
    spoiled = np.concatenate((y[:6_000], 3.0 * y[6_000:]))
    shape = find_structure("first")
    trained = fit_parameters(Record(PERIOD_S, u[:6_000], y[:6_000]), shape, Method.OUTPUT_ERROR).parameters
    alone = validate_on_record(
        Model("first", dict(zip(shape.names, trained, strict=True))), Record(PERIOD_S, u, spoiled).part(6_000, 9_000)
    )
    found = validate_held_out(fit_parameters(Record(PERIOD_S, u, spoiled), shape, Method.OUTPUT_ERROR))
    assert found.measured == pytest.approx(spoiled[6_000:])
    assert found.predicted == pytest.approx(alone.predicted, abs=2e-5)
    assert found.fit_percent == pytest.approx(alone.fit_percent, abs=0.1)
    assert found.fit_percent < 50.0


def test_a_step_of_a_motor_is_predicted_as_scipy_integrates_it() -> None:
    K_m, T_m, u_c, voltage = 2.86, 0.22, 0.07, -4.0
    t = np.arange(1_200) * PERIOD_S
    drive = voltage + u_c
    _, turn, _ = lsim(([K_m], [T_m, 1.0, 0.0]), np.full(t.size, drive), t)
    u = np.concatenate((np.zeros(50), np.full(t.size, voltage)))
    theta = np.concatenate((np.full(50, 0.7), 0.7 + turn))
    found = validate_motor_step(VoltageStepRecord(PERIOD_S, u, theta, 10.0, 2.0 * np.pi / 8000), K_m, T_m, u_c)
    assert (found.first, found.measured.size) == (50, t.size)
    assert found.predicted == pytest.approx(0.7 + turn, abs=1e-9)
    slower = validate_motor_step(VoltageStepRecord(PERIOD_S, u, theta, 10.0, 2.0 * np.pi / 8000), 0.9 * K_m, T_m, u_c)
    left = 0.1 * (turn - np.mean(turn))
    assert slower.measured - slower.predicted == pytest.approx(left, abs=1e-9)
    assert slower.fit_percent == pytest.approx(90.0, abs=1e-6)


def test_where_nothing_moved_there_is_nothing_to_explain() -> None:
    stuck = ModelComparison(0, np.full(50, 0.25), np.full(50, 0.26))
    assert stuck.rms == pytest.approx(0.01)
    with pytest.raises(IdentificationError, match="nothing moved"):
        _ = stuck.fit_percent
