"""Identification of a 2 x 2 model from one run, against simulated plants with known parameters."""

import json
from dataclasses import replace
from functools import cache

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, freqs, tf2ss

from backend.identification import (
    Grade,
    Method,
    OutputStructure,
    RecordError,
    StructureError,
    TwoChannelIdentification,
    TwoChannelRecord,
    build_mls_pair,
    build_multisine_pair,
    identify_two_channels,
    select_structure,
)
from backend.identification.two_channel_models import compute_frequency_matrix
from backend.identification.two_input_fit import differentiated_responses
from tests.identification.two_channel_plants import (
    Array,
    LeverActuator,
    make_noise,
    quantize,
    respond_matrix,
)
from tests.refusals import refused

# Plants --------------------------------------------------------------------------------------------

FINE_S, COARSE_S = 1e-3, 5e-3
COUNTS = np.array([2.0 * np.pi / 4000, 5e-4])
Q_LAGS = [0.3 * 0.02**2, 0.3 * 0.016 + 0.02**2, 0.3 + 0.016, 1.0]
S_LAGS = [0.2 * 0.05, 0.25, 1.0]
NUMERATORS = [[[0.9], [0.01, 0.02]], [[0.5, 0.0], [1.1]]]
"""Couplings: from S_c to q with a zero, from q_c to S without static gain."""
STRUCTURES = OutputStructure("order:3", (0, 1)), OutputStructure("order:2", (1, 0))
TRUTH = (
    {"b1_0": 0.9, "b2_0": 0.02, "b2_1": 0.01, "a1": 0.316, "a2": 0.0052, "a3": 1.2e-4},
    {"b1_0": 0.0, "b1_1": 0.5, "b2_0": 1.1, "a1": 0.25, "a2": 0.01},
)
GAINS = np.array([[0.9, 0.02], [0.0, 1.1]])

MONTE_CARLO_S = OutputStructure("order:2", (0, 1)), OutputStructure("first", (0, 0))
MONTE_CARLO_DENOMINATORS = [[0.01, 0.25, 1.0], [0.3, 1.0]]
MONTE_CARLO_NUMERATORS = [[[0.9], [0.02, 0.1]], [[0.3], [1.1]]]
MONTE_CARLO_TRUTH = np.array([0.9, 0.1, 0.02, 0.25, 0.01, 0.3, 1.1, 0.3])
"""In the order of the covariance of both rows."""


def excite_coarsely() -> Array:
    return build_mls_pair(6, 16, 3)


@cache
def coarse_motion() -> Array:
    return respond_matrix(MONTE_CARLO_NUMERATORS, MONTE_CARLO_DENOMINATORS, excite_coarsely(), COARSE_S)


def coarse_record(seed: int, *, correlated: bool = False) -> TwoChannelRecord:
    """Return a record with coloured noise, of about a twentieth of the motion, and quantization."""
    random = np.random.default_rng(seed)
    u = excite_coarsely()
    noise = np.column_stack([make_noise(random, u.shape[0], 0.04, pole) for pole in (0.8, 0.5)])
    if correlated:
        noise[:, 1] = noise[:, 0] * 1.5
    return TwoChannelRecord(COARSE_S, u, quantize(coarse_motion() + noise, 0.005), memory_s=2.0)


@cache
def estimates() -> tuple[TwoChannelIdentification, ...]:
    return tuple(identify_two_channels(coarse_record(seed), MONTE_CARLO_S, Method.RIVC) for seed in range(40))


def vector_of(found: TwoChannelIdentification) -> Array:
    return np.concatenate([row.vector for row in found.model.rows])


@cache
def fine() -> TwoChannelIdentification:
    """Return the model from 20 s at 1 kHz, with encoder counts and coloured noise."""
    u = build_mls_pair(7, 80, 2, (0.1, 1.0), memory_samples=2500)
    y = respond_matrix(NUMERATORS, [Q_LAGS, S_LAGS], u, FINE_S)
    random = np.random.default_rng(0)
    y += np.column_stack([make_noise(random, len(u), 1e-3, 0.98), make_noise(random, len(u), 2e-3, 0.98)])
    record = TwoChannelRecord(FINE_S, u, quantize(y, COUNTS))
    return identify_two_channels(record, STRUCTURES, y_resolution=(COUNTS[0], COUNTS[1]))


# Responses -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("lags", [[0.3, 1.0], [0.01, 0.25, 1.0], [0.01, 0.05, 1.0], Q_LAGS, np.poly([-10.0] * 4) / 1e4])
def test_the_response_with_zeros_is_that_of_scipy(lags: list[float]) -> None:
    u = np.random.default_rng(2).standard_normal(400)
    found = differentiated_responses(np.roots(lags).astype(complex), 2e-3, u, len(lags) - 2)
    for k in range(len(lags) - 1):
        system = cont2discrete(tf2ss([1.0, *[0.0] * k], lags), 2e-3)
        expected = dlsim(system, u)[1][:, 0]
        assert found[:, k] == pytest.approx(expected, abs=1e-8 * np.max(np.abs(expected)))


def test_without_noise_the_estimate_equals_the_truth() -> None:
    u = build_multisine_pair(60, 2000, 2, (0.1, 1.0))
    y = respond_matrix(NUMERATORS, [Q_LAGS, S_LAGS], u, 5e-3)
    found = identify_two_channels(TwoChannelRecord(5e-3, u, y), STRUCTURES)
    for row, truth in zip(found.model.rows, TRUTH, strict=True):
        assert row.parameters == pytest.approx(truth, rel=1e-5, abs=1e-7)
    assert found.model.simulate(u, 5e-3) == pytest.approx(y, abs=1e-6)


def test_the_frequency_response_is_that_of_scipy_and_of_python_control() -> None:
    model = fine().model
    omega = np.geomspace(0.1, 300.0, 30)
    G = model.response(omega)
    systems = []
    for i, row in enumerate(model.rows):
        for j in (0, 1):
            numerator, denominator = row.numerator(j)[::-1], row.denominator[::-1]
            assert G[:, i, j] == pytest.approx(freqs(numerator, denominator, omega)[1])
            systems.append(control.tf(numerator, denominator))
    assert G[:, 0, 1] == pytest.approx(systems[1](1j * omega))
    assert model.gains.ravel() == pytest.approx([system.dcgain() for system in systems])


# Known plant ---------------------------------------------------------------------------------------


def test_a_plant_in_quantized_coloured_noise_is_found_within_three_standard_errors() -> None:
    found = fine()
    for row, quality, truth in zip(found.model.rows, found.outputs, TRUTH, strict=True):
        for name, value in truth.items():
            assert abs(row.parameters[name] - value) < 3.0 * quality.std_errors[name], name
        assert quality.whiteness.passed
        assert all(test.passed for test in quality.input_correlations)
        assert quality.fit_percent == pytest.approx(quality.fit_all_percent, abs=1.0)
        assert quality.fit_percent > 97.0
    assert found.gains == pytest.approx(GAINS, abs=0.02)
    assert abs(found.relative_gain.value - 1.0) < 3.0 * found.relative_gain.std
    assert found.verdict.grade is Grade.USABLE


def test_a_coupling_without_static_gain_differs_from_zero_by_its_dynamics() -> None:
    entry = fine().entries[1][0]
    assert (entry.input, entry.output, entry.is_zero) == ("q_c", "S", False)
    assert abs(entry.gain) < 3.0 * entry.gain_std
    assert entry.first_order is None
    assert entry.motion_percent > 10.0


def test_first_order_has_the_static_gain_and_the_sum_of_lags_of_each_entry() -> None:
    direct, coupling = fine().entries[0]
    assert direct.first_order is not None
    assert coupling.first_order is not None
    for found, (K, T) in ((direct.first_order, (0.9, 0.316)), (coupling.first_order, (0.02, 0.316 - 0.5))):
        K_std, T_std = found.deviations
        assert abs(found.K - K) < 3.0 * K_std
        assert abs(found.T - T) < 3.0 * T_std


# Monte Carlo ---------------------------------------------------------------------------------------


def test_estimates_are_unbiased_over_the_seeds() -> None:
    found = np.array([vector_of(one) for one in estimates()])
    error = np.mean(found, axis=0) - MONTE_CARLO_TRUTH
    assert np.all(np.abs(error) < 3.5 * np.std(found, axis=0, ddof=1) / np.sqrt(len(found)))


def test_standard_errors_cover_the_truth_as_often_as_they_state() -> None:
    deviations = np.array(
        [(vector_of(one) - MONTE_CARLO_TRUTH) / np.sqrt(np.diag(one.covariance)) for one in estimates()]
    )
    assert 0.90 < np.mean(np.abs(deviations) < 1.96) < 0.99
    assert 0.85 < np.sqrt(np.mean(deviations**2)) < 1.2
    # The joint region of all parameters: chi-squared with 8 degrees of freedom has the mean 8.
    distances = [
        (vector_of(one) - MONTE_CARLO_TRUTH) @ np.linalg.solve(one.covariance, vector_of(one) - MONTE_CARLO_TRUTH)
        for one in estimates()
    ]
    assert 6.0 < np.mean(distances) < 11.0


def test_the_standard_error_of_the_relative_gain_is_the_spread_over_the_seeds() -> None:
    truth = 0.9 * 1.1 / (0.9 * 1.1 - 0.1 * 0.3)
    values = np.array([one.relative_gain.value for one in estimates()])
    typical = np.sqrt(np.mean([one.relative_gain.std**2 for one in estimates()]))
    assert typical == pytest.approx(np.std(values, ddof=1), rel=0.35)
    assert abs(np.mean(values) - truth) < 3.5 * typical / np.sqrt(values.size)


def test_the_standard_errors_of_the_frequency_response_are_those_of_drawn_models() -> None:
    one = estimates()[0]
    omega = np.array([0.3, 3.0, 20.0])
    found = compute_frequency_matrix(one.model, one.covariance, omega)
    random = np.random.default_rng(4)
    drawn = []
    for vector in random.multivariate_normal(vector_of(one), one.covariance, 4000):
        rows, start = [], 0
        for row in one.model.rows:
            names = row.structure.names
            part = vector[start : start + len(names)]
            rows.append(replace(row, parameters=dict(zip(names, part.tolist(), strict=True))))
            start += len(names)
        drawn.append(replace(one.model, rows=(rows[0], rows[1])).response(omega))
    G, centre = np.array(drawn), one.model.response(omega)
    for i in (0, 1):
        for j in (0, 1):
            ratio = G[:, :, i, j] / centre[:, i, j]
            assert found.magnitude_std[i][j] == pytest.approx(np.std(np.abs(G[:, :, i, j]), axis=0), rel=0.08)
            assert found.phase_std_deg[i][j] == pytest.approx(np.degrees(np.std(np.angle(ratio), axis=0)), rel=0.08)
            assert found.std[i][j] == pytest.approx(np.std(G[:, :, i, j], axis=0), rel=0.08)
    r = G[..., 0, 0] * G[..., 1, 1] / np.linalg.det(G)
    assert found.rga_std == pytest.approx(np.std(r, axis=0), rel=0.1)


def test_noise_common_to_both_outputs_correlates_their_gains() -> None:
    found = [
        identify_two_channels(coarse_record(seed, correlated=True), MONTE_CARLO_S, Method.RIVC) for seed in range(20)
    ]
    gains = np.array([np.ravel(one.gains) for one in found])
    stated = np.mean([one.gain_covariance for one in found], axis=0)
    size = np.sqrt(np.diag(stated))
    correlation = stated / np.outer(size, size)
    assert correlation[0, 2] > 0.7
    assert np.corrcoef(gains.T)[0, 2] == pytest.approx(correlation[0, 2], abs=0.35)


# Couplings -----------------------------------------------------------------------------------------


def decoupled(seed: int) -> TwoChannelIdentification:
    u = excite_coarsely()
    y = respond_matrix([[[0.9], [0.0]], [[0.0], [1.1]]], MONTE_CARLO_DENOMINATORS, u, COARSE_S)
    random = np.random.default_rng(seed)
    y += np.column_stack([make_noise(random, len(u), 0.03, 0.9) for _ in (0, 1)])
    structures = OutputStructure("order:2", (0, 1)), OutputStructure("first", (0, 0))
    return identify_two_channels(TwoChannelRecord(COARSE_S, u, y, memory_s=2.0), structures)


def test_couplings_of_a_decoupled_plant_are_not_distinguishable_from_zero() -> None:
    found = [decoupled(seed) for seed in range(12)]
    zero = [entry.is_zero for one in found for entry in (one.entries[0][1], one.entries[1][0])]
    assert sum(zero) >= 23  # each is wrong with a probability of 1 %
    for one in found:
        assert not one.entries[0][0].is_zero
        assert not one.entries[1][1].is_zero
        assert abs(one.relative_gain.value - 1.0) < 4.0 * one.relative_gain.std
    entry = found[0].entries[0][1]
    assert entry.verdict.grade is Grade.USABLE
    (reason,) = entry.verdict.reasons
    assert reason.code == "entry_not_distinguishable_from_zero"
    assert reason.values["gain"] == entry.gain


def test_couplings_are_zero_without_noise_too() -> None:
    u = excite_coarsely()
    y = respond_matrix([[[0.9], [0.0]], [[0.0], [1.1]]], MONTE_CARLO_DENOMINATORS, u, COARSE_S)
    found = identify_two_channels(TwoChannelRecord(COARSE_S, u, y, memory_s=2.0), MONTE_CARLO_S)
    assert [[entry.is_zero for entry in row] for row in found.entries] == [[False, True], [True, False]]
    assert found.relative_gain.value == pytest.approx(1.0, abs=1e-9)


def test_the_structure_of_the_plant_is_selected() -> None:
    record = coarse_record(0)
    candidates = [
        OutputStructure(denominator, degrees)
        for denominator in ("first", "order:2", "order:3")
        for degrees in ((0, 0), (0, 1), (1, 0))
        if denominator != "first" or degrees == (0, 0)
    ]
    assert select_structure(record, 0, candidates) == MONTE_CARLO_S[0]
    assert select_structure(record, 1, candidates) == MONTE_CARLO_S[1]


def test_a_channel_that_does_not_move_its_output_is_not_usable() -> None:
    u = excite_coarsely()
    y = respond_matrix([[[0.0], [0.9]], [[1.1], [0.2]]], MONTE_CARLO_DENOMINATORS, u, COARSE_S)
    y += 0.02 * np.random.default_rng(1).standard_normal(y.shape)
    found = identify_two_channels(
        TwoChannelRecord(COARSE_S, u, y, memory_s=2.0), (OutputStructure("order:2"), OutputStructure("first"))
    )
    direct = found.entries[0][0].verdict
    assert direct.grade is Grade.UNUSABLE
    assert direct.reasons[0].code == "entry_not_distinguishable_from_zero"
    assert found.verdict.grade is Grade.UNUSABLE
    assert found.verdict.reasons[-1].code == "pairing_interacts"


def test_an_incomplete_structure_is_reported_by_its_residuals() -> None:
    u = excite_coarsely()
    y = respond_matrix(MONTE_CARLO_NUMERATORS, [[0.03, 0.25, 1.0], [0.3, 1.0]], u, COARSE_S)
    y += 0.002 * np.random.default_rng(1).standard_normal(y.shape)
    found = identify_two_channels(
        TwoChannelRecord(COARSE_S, u, y, memory_s=2.0), (OutputStructure("first"), OutputStructure("first"))
    )
    reasons = {reason.code for reason in found.entries[0][0].verdict.reasons}
    assert found.entries[0][0].verdict.grade is not Grade.USABLE
    assert reasons & {"motion_unexplained", "residuals_follow_input", "residuals_not_white"}


# Lever ---------------------------------------------------------------------------------------------


def test_a_lever_actuator_has_the_static_gains_of_its_jacobian() -> None:
    actuator = LeverActuator()
    u = build_mls_pair(7, 80, 2, (0.02, 1e-4), memory_samples=2500)
    y = quantize(actuator.simulate(u, FINE_S), np.array([2.0 * np.pi / 40000, 1e-3]))
    random = np.random.default_rng(6)
    y += np.column_stack([make_noise(random, len(u), 1e-4, 0.9), make_noise(random, len(u), 5e-3, 0.9)])
    record = TwoChannelRecord(FINE_S, u, y, inputs=("theta_1", "pivot"))
    found = identify_two_channels(record, (OutputStructure("order:4"), OutputStructure("order:4", (1, 0))))
    expected = actuator.jacobian()
    assert expected == pytest.approx(actuator.closed_form(), rel=1e-5, abs=1e-5)
    motion = np.std(u, axis=0)
    error = np.abs(np.array(found.gains) - expected) * motion
    for row in (0, 1):
        assert np.max(error[row]) < 0.03 * np.max(np.abs(expected[row]) * motion)
    assert found.gains[0][0] == pytest.approx(expected[0, 0], rel=0.03)
    assert found.gains[0][1] == pytest.approx(expected[0, 1], rel=0.03)
    assert found.gains[1][1] == pytest.approx(expected[1, 1], rel=0.03)


# Closed loop ---------------------------------------------------------------------------------------


def closed_loop(seed: int) -> TwoChannelRecord:
    """Return a record of two proportional-integral loops with coloured noise of the outputs."""
    random = np.random.default_rng(seed)
    r = build_mls_pair(6, 16, 3)
    n = r.shape[0]
    noise = np.column_stack([make_noise(random, n, 0.3, 0.97) for _ in (0, 1)])
    decay = np.exp(-COARSE_S / np.array([0.3, 0.2]))
    gain = np.array([[0.9, 0.2], [0.3, 1.1]])
    x, integral, u, y = np.zeros(2), np.zeros(2), np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        y[k] = x + noise[k]
        integral += COARSE_S * 8.0 * (r[k] - y[k])
        u[k] = integral + 3.0 * (r[k] - y[k])
        x = decay * x + (1.0 - decay) * (gain @ u[k])
    return TwoChannelRecord(COARSE_S, u, y, r, memory_s=2.0)


def test_refined_iv_is_unbiased_in_closed_loop_where_output_error_is_not() -> None:
    truth = np.array([0.9, 0.2, 0.3, 0.3, 1.1, 0.2])
    structures = OutputStructure("first"), OutputStructure("first")
    deviations: dict[Method, Array] = {}
    for method in (Method.DEFAULT, Method.OUTPUT_ERROR):
        found = [identify_two_channels(closed_loop(seed), structures, method) for seed in range(16)]
        errors = np.array([vector_of(one) - truth for one in found])
        deviations[method] = np.abs(np.mean(errors, axis=0)) / (np.std(errors, axis=0, ddof=1) / 4.0)
    assert np.max(deviations[Method.DEFAULT]) < 3.0
    assert np.max(deviations[Method.OUTPUT_ERROR]) > 5.0


def test_a_loop_without_its_setpoints_is_reported() -> None:
    record = replace(closed_loop(0), r=None)
    found = identify_two_channels(record, (OutputStructure("first"), OutputStructure("first")))
    for entry in (found.entries[0][0], found.entries[1][1]):
        assert entry.verdict.grade is not Grade.USABLE
        assert "noise_fed_back_to_input" in {reason.code for reason in entry.verdict.reasons}


# Result and refusals -------------------------------------------------------------------------------


def test_the_result_is_plain_data() -> None:
    document = json.loads(json.dumps(fine().to_json(), allow_nan=False))
    assert document["model"]["inputs"] == ["q_c", "S_c"]
    assert document["model"]["rows"][0]["structure"] == {"denominator": "order:3", "degrees": [0, 1]}
    assert document["entries"][1][1]["gain"] == fine().gains[1][1]
    assert document["entries"][0][0]["verdict"]["sentence"].startswith("Usable for tuning")
    assert np.shape(document["covariance"]) == (11, 11)
    assert np.shape(document["gain_covariance"]) == (4, 4)
    assert np.shape(document["frequency"]["magnitude"]) == (2, 2, 60)
    assert document["relative_gain"]["array"][0][0] == fine().relative_gain.value


def good() -> tuple[Array, Array]:
    u = build_mls_pair(6, 16, 1)
    return u, respond_matrix(MONTE_CARLO_NUMERATORS, MONTE_CARLO_DENOMINATORS, u, COARSE_S)


def test_a_channel_without_excitation_is_rejected() -> None:
    u, y = good()
    u[:, 1] = 0.3
    with refused(RecordError, "signal_is_constant", name="S_c"):
        TwoChannelRecord(COARSE_S, u, y, memory_s=2.0)


@pytest.mark.parametrize(("shift", "sign"), [(0, 1.0), (0, -1.0), (40, 1.0), (-40, 1.0)])
def test_channels_that_repeat_each_other_are_rejected(shift: int, sign: float) -> None:
    u, y = good()
    u[:, 1] = sign * np.roll(u[:, 0], shift)
    with refused(RecordError, "inputs_correlated", first="q_c", second="S_c"):
        TwoChannelRecord(COARSE_S, u, y, memory_s=2.0)


def test_a_record_shorter_than_twice_the_memory_is_rejected() -> None:
    u, y = good()
    with refused(RecordError, "record_too_short", length=799, minimum=800):
        TwoChannelRecord(COARSE_S, u[:799], y[:799], memory_s=2.0)
    TwoChannelRecord(COARSE_S, u[:800], y[:800], memory_s=2.0)


@pytest.mark.parametrize(("field", "column", "name"), [("u", 0, "q_c"), ("y", 1, "S"), ("r", 1, "r of S_c")])
def test_samples_that_are_not_finite_are_rejected(field: str, column: int, name: str) -> None:
    u, y = good()
    signals = {"u": u, "y": y, "r": u.copy()}
    signals[field][17, column] = np.nan
    with refused(RecordError, "samples_not_finite", name=name, count=1, first=17):
        TwoChannelRecord(COARSE_S, signals["u"], signals["y"], signals["r"], memory_s=2.0)


def test_signals_of_a_wrong_shape_are_rejected() -> None:
    u, y = good()
    with refused(RecordError, "signal_is_not_two_columns", name="y", shape=(y.shape[0],)):
        TwoChannelRecord(COARSE_S, u, y[:, 0], memory_s=2.0)
    with refused(RecordError, "columns_of_unequal_length", name="y", length=900):
        TwoChannelRecord(COARSE_S, u, y[:900], memory_s=2.0)


@pytest.mark.parametrize("degrees", [(2, 0), (0, 2), (-1, 0)])
def test_numerators_that_are_not_strictly_proper_are_rejected(degrees: tuple[int, int]) -> None:
    with refused(StructureError, "numerator_degree_out_of_range", structure="order:2", maximum=1):
        OutputStructure("order:2", degrees)


def test_dead_times_and_methods_of_one_input_are_rejected() -> None:
    with refused(StructureError, "dead_time_with_two_inputs", structure="first+delay"):
        OutputStructure("first+delay")
    u, y = good()
    with refused(StructureError, "method_for_one_input_only", method="arx"):
        identify_two_channels(
            TwoChannelRecord(COARSE_S, u, y, memory_s=2.0),
            (OutputStructure("first"), OutputStructure("first")),
            Method.ARX,
        )
