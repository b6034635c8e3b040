"""Sensitivity of both outer loops together against numpy.linalg, python-control and single loops."""

import math

import control
import numpy as np
import pytest

from backend.control import pid
from backend.control.dynamic_decoupler import STATIC_ONLY, DynamicDecoupler
from backend.tuning.coupled_model import CoupledModel
from backend.tuning.coupled_robustness import CoupledLoops, OutputScales, largest_singular_values, scale_outputs
from backend.tuning.decoupling import design_decoupling
from backend.tuning.gains import TuningError, outer_gains
from backend.tuning.robustness import OuterProcess
from plant.interface import T_s
from tests.refusals import refused

Q, S = outer_gains(1.0, 0.34, 0.36), outer_gains(1.0, 0.42, 0.4)
EQUAL = OutputScales(1.0, 1.0)


def times(*factors: list[float]) -> tuple[float, ...]:
    """Return a product of polynomials in ascending powers."""
    product = np.ones(1)
    for factor in factors:
        product = np.convolve(product, factor)
    return tuple(product)


def coupled(c_12: float, c_21: float) -> CoupledModel:
    """Return four and three lags with couplings that vanish at rest."""
    A_1, A_2 = times(*[[1.0, 0.0854]] * 4), times(*[[1.0, 0.14]] * 3)
    row_1, row_2 = ((1.0, 0.02), (0.0, c_12)), ((0.0, c_21), (1.0, 0.03))
    return CoupledModel((A_1, A_2), (row_1, row_2))


COUPLED = coupled(0.015, -0.02)


def decoupler_of(model: CoupledModel) -> DynamicDecoupler:
    design = design_decoupling(model)
    assert design.decoupler is not None, design.describe()
    return design.decoupler


def laws() -> control.TransferFunction:
    """Return both I-P laws as executed, from −y to v."""

    def law(gains: pid.IPGains) -> control.TransferFunction:
        return control.tf([gains.k_p, gains.k_i * T_s - gains.k_p], [1.0, -1.0], T_s)

    return control.append(control.ss(law(Q)), control.ss(law(S)))


# Singular values -----------------------------------------------------------------------------------


def test_largest_singular_values_match_numpy() -> None:
    rng = np.random.default_rng(21)
    matrices = rng.standard_normal((500, 2, 2)) + 1j * rng.standard_normal((500, 2, 2))
    matrices[:100, 1] = matrices[:100, 0] * (1.0 + 1e-9)
    matrices[100] = 0.0
    matrices[101] = np.eye(2)
    expected = np.linalg.svd(matrices, compute_uv=False)[:, 0]
    assert np.max(np.abs(largest_singular_values(matrices) - expected)) < 1e-13 * np.max(expected)


def test_the_state_space_of_a_model_has_its_response() -> None:
    system, s = COUPLED.make_state_space(), (1j * np.geomspace(0.01, 1000.0, 60)).astype(np.complex128)
    found = np.array([system(point) for point in s])
    assert np.max(np.abs(found - COUPLED.response(s))) < 1e-12


def test_the_sensitivity_matrix_matches_python_control() -> None:
    for decoupler in (STATIC_ONLY, decoupler_of(COUPLED)):
        loops = CoupledLoops(COUPLED.make_state_space(), Q, S, decoupler)
        some = slice(0, 900, 60)
        z = np.exp(1j * loops.OMEGA[some] * T_s)
        process = control.c2d(COUPLED.make_state_space(), T_s, "zoh")
        G, C = (np.array([system(point) for point in z]) for system in (process, laws()))
        s = (2.0 / T_s * (z - 1.0) / (z + 1.0)).astype(np.complex128)
        ratio = COUPLED.response(s)
        D = np.zeros_like(ratio)
        if decoupler is not STATIC_ONLY:
            D[:, 0, 1], D[:, 1, 0] = -ratio[:, 0, 1] / ratio[:, 0, 0], -ratio[:, 1, 0] / ratio[:, 1, 1]
        expected = np.linalg.inv(np.eye(2) + G @ np.linalg.inv(np.eye(2) - D) @ C)
        assert np.max(np.abs(loops.sensitivity()[some] - expected)) < 1e-8


# Robustness ----------------------------------------------------------------------------------------


def test_without_coupling_the_peak_is_the_larger_M_s() -> None:
    model = coupled(0.0, 0.0)
    system = model.make_state_space()
    found = CoupledLoops(system, Q, S).robustness(EQUAL)
    assert found.stable
    assert found.sigma_max == pytest.approx(max(found.q.M_s, found.S.M_s), rel=1e-4)
    sensitivity = CoupledLoops(system, Q, S).sensitivity()
    diagonal = np.max(np.abs(sensitivity[:, [0, 1], [0, 1]]), axis=1)
    assert np.max(np.abs(largest_singular_values(sensitivity) - diagonal)) < 1e-14
    for i, gains, loop in ((0, Q, found.q), (1, S, found.S)):
        alone = OuterProcess(system[i, i]).robustness(gains)
        assert loop.M_s == pytest.approx(alone.M_s, abs=3.5e-3)  # sampling (erratum E5)
        assert loop.gain_margin == pytest.approx(alone.gain_margin, rel=0.04)  # the hold's delay of half a sample
        assert loop.phase_margin == pytest.approx(alone.phase_margin, abs=3e-3)


def test_the_decoupler_restores_the_robustness_of_the_single_loops() -> None:
    system = COUPLED.make_state_space()
    before = CoupledLoops(system, Q, S).robustness(EQUAL)
    after = CoupledLoops(system, Q, S, decoupler_of(COUPLED)).robustness(EQUAL)
    alone = CoupledLoops(coupled(0.0, 0.0).make_state_space(), Q, S).robustness(EQUAL)
    assert after.q.M_s == pytest.approx(alone.q.M_s, abs=1e-4)
    assert after.S.M_s == pytest.approx(alone.S.M_s, abs=1e-4)
    assert after.sigma_max == pytest.approx(alone.sigma_max, abs=1e-4)
    assert before.sigma_max > after.sigma_max + 0.02
    assert abs(before.q.M_s - alone.q.M_s) > 1e-3


def test_M_s_does_not_depend_on_the_scales_but_the_singular_value_does() -> None:
    loops = CoupledLoops(COUPLED.make_state_space(), Q, S)
    fine, coarse = loops.robustness(OutputScales(0.01, 1.0)), loops.robustness(OutputScales(1.0, 1.0))
    assert (fine.q, fine.S) == (coarse.q, coarse.S)
    assert fine.sigma_max > coarse.sigma_max
    scaled = scale_outputs(loops.sensitivity(), OutputScales(0.01, 2.0))
    W = np.diag([0.01, 2.0])
    assert np.max(np.abs(scaled - np.linalg.inv(W) @ loops.sensitivity() @ W)) < 1e-12


def test_stability_matches_the_poles_of_python_control() -> None:
    """The coupling of both loops makes them unstable, although each one is stable alone."""
    process = control.c2d(coupled(0.6, -0.6).make_state_space(), T_s, "zoh")
    poles = control.feedback(process * laws(), control.ss([], [], [], np.eye(2), T_s)).poles()
    assert np.max(np.abs(poles)) > 1.0
    found = CoupledLoops(coupled(0.6, -0.6).make_state_space(), Q, S).robustness(EQUAL)
    assert not found.stable
    assert (found.sigma_max, found.q.M_s, found.S.M_s) == (math.inf, math.inf, math.inf)
    for c in (0.0, 0.05, 0.1, 0.2, 0.4):
        process = control.c2d(coupled(c, -c).make_state_space(), T_s, "zoh")
        poles = control.feedback(process * laws(), control.ss([], [], [], np.eye(2), T_s)).poles()
        assert CoupledLoops(coupled(c, -c).make_state_space(), Q, S).is_stable() == bool(np.max(np.abs(poles)) < 1.0)


def test_a_mismatched_decoupler_is_judged_on_the_process_and_not_on_its_model() -> None:
    system = COUPLED.make_state_space()
    wrong = decoupler_of(coupled(-0.015, 0.02))
    worse = CoupledLoops(system, Q, S, wrong).robustness(EQUAL)
    none = CoupledLoops(system, Q, S).robustness(EQUAL)
    assert worse.sigma_max > none.sigma_max


def test_a_scale_that_is_not_positive_is_refused() -> None:
    loops = CoupledLoops(COUPLED.make_state_space(), Q, S)
    for scale in (0.0, math.nan, math.inf):
        with refused(TuningError, "output_scale_not_positive", symbol="S"):
            loops.robustness(OutputScales(1.0, scale))


def test_a_process_with_direct_feedthrough_is_refused() -> None:
    model = CoupledModel(((1.0, 1.0), (1.0, 1.0)), (((1.0,), (0.1, 0.5)), ((0.0,), (1.0,))))
    with refused(TuningError, "process_not_strictly_proper", name="B_12", order=1):
        model.make_state_space()
