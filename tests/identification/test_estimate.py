"""Estimates of records whose truth is known: consistent in closed loop, honest about their errors."""

from dataclasses import replace
from typing import Unpack

import numpy as np
import pytest

from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method, continuous_poles
from backend.identification.models import Estimate, Grade
from backend.identification.records import Controller, NotContinuousError, Record, StructureError
from tests.identification.closed_loop_records import (
    FIRST,
    K_I,
    K_P,
    ONE_HERTZ,
    PERIOD_S,
    THIRD,
    Disturbed,
    closed_loop_record,
    held_response,
)

CONTROLLER = Controller(K_P, K_I)
SUMMARY = [
    "parameters",
    "std_errors",
    "method",
    "fit_percent",
    "spread_percent",
    "friction",
    "input_offset",
    "hint",
    "grade",
    "verdict",
]
CASES = [pytest.param("first", FIRST, id="first"), pytest.param("third", THIRD, id="third")]


def record(truth: dict[str, float], snr_dB: float, seed: int, **options: Unpack[Disturbed]) -> Record:
    u, y, _ = closed_loop_record(truth, snr_dB, seed, **options)
    return Record(PERIOD_S, u, y, controller=CONTROLLER)


def errors_in_std(found: Estimate, truth: dict[str, float]) -> list[float]:
    return [(found.model.parameters[name] - truth[name]) / found.std_errors[name] for name in truth]


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_without_noise_the_truth_comes_back(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 300.0, 0), name)
    assert found.model.parameters == pytest.approx(truth, rel=1e-6)
    assert found.fit_percent > 99.99


@pytest.mark.parametrize("method", [Method.DEFAULT, Method.OUTPUT_ERROR, Method.SRIVC])
@pytest.mark.parametrize(("name", "truth"), CASES)
def test_white_noise_in_the_loop_is_within_its_standard_errors(
    name: str, truth: dict[str, float], method: Method
) -> None:
    found = estimate_model(record(truth, 20.0, 1), name, method)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert all(found.std_errors[key] < 0.006 * truth[key] for key in truth)
    assert found.residuals.whiteness.passed
    assert found.residuals.input_correlation.passed


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e6])
def test_a_light_resonance_in_noise_is_found_where_the_quick_starts_lead_nowhere(unit: float) -> None:
    """Few steps of a lag and a pair of poles of damping 0.1 at 200 rad/s: the noise hides the pair from least squares.

    What is found leaves no more over than the truth does, which SciPy has computed, and is within its errors of it,
    in whatever unit the output was recorded.
    """
    truth = {"K": unit, "T": 0.4, "a2": 2.5e-5, "a1": 1e-3}
    random = np.random.default_rng(174)
    u = np.repeat(random.choice([-1.0, 1.0], 6), 400)
    clean = held_response(truth, u)
    y = clean + 0.2 * np.std(clean) * random.standard_normal(u.size)
    found = estimate_model(Record(PERIOD_S, u, y), "third")
    left = np.linalg.norm(y - clean) / np.linalg.norm(y - np.mean(y))
    assert found.fit_all_percent >= 100.0 * (1.0 - left)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert found.residuals.whiteness.passed


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_the_fit_of_all_data_is_what_the_noise_leaves(name: str, truth: dict[str, float]) -> None:
    """Against the true system's own response to the input, which SciPy has computed."""
    u, y, _ = closed_loop_record(truth, 20.0, 1)
    left = np.linalg.norm(y - held_response(truth, u)) / np.linalg.norm(y - np.mean(y))
    found = estimate_model(Record(PERIOD_S, u, y, controller=CONTROLLER), name)
    assert left > 0.05
    assert found.fit_all_percent == pytest.approx(100.0 * (1.0 - left), abs=0.2)


def test_a_pair_of_poles_is_a_pair_however_near_to_the_real_axis() -> None:
    pair = np.array([-0.01 + 1e-9j, -0.01 - 1e-9j])
    np.testing.assert_allclose(np.exp(1e-3 * continuous_poles(pair, 1e-3)), pair, rtol=1e-12)
    with pytest.raises(NotContinuousError):
        continuous_poles(np.array([-0.01 + 0.0j]), 1e-3)


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_coloured_noise_is_modelled_and_does_not_bias(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 20.0, 2, pole=ONE_HERTZ), name)
    assert found.noise[0] == pytest.approx(-ONE_HERTZ, abs=0.01)
    assert "AR(" in found.method
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_offset_drift_and_a_cut_start_do_not_bias(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 40.0, 3, offset=2.0, drift=3.0, cut=777), name)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert found.model.parameters == pytest.approx(truth, rel=4e-3)


def test_instruments_from_a_known_set_point_serve_where_the_controller_is_unknown() -> None:
    u, y, excitation = closed_loop_record(FIRST, 10.0, 4, pole=ONE_HERTZ)
    found = estimate_model(Record(PERIOD_S, u, y, r=excitation), "first")
    assert found.method.startswith("closed-loop")
    assert np.max(np.abs(errors_in_std(found, FIRST))) < 4.0


def test_one_sample_of_misalignment_shows_in_fast_parameters() -> None:
    # Guards the convention that y[k] is taken when u[k] is applied: the other ones move a1 and a2 by per cents.
    whole = record(THIRD, 300.0, 0)
    late = replace(whole, u=whole.u[1:], y=whole.y[:-1], controller=None)
    found = estimate_model(late, "third", Method.OUTPUT_ERROR)
    assert abs(found.model.parameters["a1"] / THIRD["a1"] - 1.0) > 0.02


def test_scaling_input_and_output_scales_the_gain_only() -> None:
    u, y, _ = closed_loop_record(FIRST, 20.0, 5)
    plain = estimate_model(Record(PERIOD_S, u, y), "first", Method.OUTPUT_ERROR)
    scaled = estimate_model(Record(PERIOD_S, 10.0 * u + 3.0, -1e-3 * y + 7.0), "first", Method.OUTPUT_ERROR)
    assert scaled.model.parameters["T"] == pytest.approx(plain.model.parameters["T"], rel=1e-4)
    assert scaled.model.gain == pytest.approx(-1e-4 * plain.model.gain, rel=1e-4)
    assert scaled.std_errors["T"] == pytest.approx(plain.std_errors["T"], rel=1e-2)


def test_missing_dynamics_are_told_from_noise() -> None:
    found = estimate_model(record(THIRD, 60.0, 6), "first")
    assert found.noise == ()
    assert not found.residuals.input_correlation.passed


def test_the_summary_has_what_the_command_line_prints() -> None:
    found = estimate_model(record(THIRD, 30.0, 7), "third")
    summary = found.summary()
    assert list(summary) == SUMMARY
    assert set(summary["parameters"]) == {"K", "T", "a1", "a2"}
    assert found.verdict.grade is Grade.USABLE


def test_an_unknown_structure_is_refused_with_the_known_ones() -> None:
    with pytest.raises(StructureError, match=r"order:5.*first, third, lags2"):
        estimate_model(record(FIRST, 40.0, 0), "order:5")
