"""Compute every figure of docs/explanation/errata.md from the paper, with numpy, SciPy and python-control only."""

import re
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.optimize import brentq

PAGE = (Path(__file__).parents[2] / "docs" / "explanation" / "errata.md").read_text(encoding="utf-8")

r_m, r_j = 7.5e-3, 75e-3
k_0, k_1, k_2 = -2.498, 331.49, 8543.8
K_m, T_m = 2.86, 0.22
LAM_MOTOR = 0.0854
T_s, L_OVER_R = 1e-3, 2e-3

# Table 1, one row per tension: stiffness, (K, T) of G_q, (K, T) of G_S, (a2, a1) of G_q in its third-order form.
TABLE_1 = {
    10: (8.24, (0.0498, 0.64), (1.17, 0.57), (7.329e-5, 0.05747)),
    20: (10.55, (0.0484, 0.78), (2.826, 1.19), (4.919e-5, 0.04688)),
    30: (12.43, (0.0495, 1.58), (1.821, 0.62), (3.475e-5, 0.03309)),
    40: (14.06, (0.0491, 2.98), (1.47, 0.43), (2.2e-6, 1.07e-2)),
}
FREQUENCIES = np.logspace(-2, 4, 40_001)
s = control.tf("s")


def section(name: str) -> str:
    """Return one erratum without line breaks."""
    found = re.search(rf"^## {name} .*?(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"docs/explanation/errata.md has no section {name}"
    return " ".join(found.group().split())


def outer_gains(K: float, T: float, lam: float) -> tuple[float, float]:
    return (2 * T - lam) / (K * lam), T / (K * lam**2)


def first_order_loop(K: float, T: float, k_p: float, k_i: float) -> control.TransferFunction:
    """Return the closed I-P loop from reference to output."""
    process = K / (T * s + 1)
    return control.minreal(control.feedback(k_i / s * control.feedback(process, k_p)), verbose=False)


def four_lag_poles(k_p: float, k_i: float) -> np.ndarray:
    """Return the poles of an I-P loop around four lags of the inner loop with static gain 1."""
    lags = np.poly1d([LAM_MOTOR, 1]) ** 4
    return (lags * np.poly1d([1, 0]) + np.poly1d([k_p, k_i])).roots


def max_sensitivity(loop: np.ndarray) -> float:
    return float(np.max(np.abs(1 / (1 + loop))))


def four_lag_sensitivity(lam: float) -> float:
    jw = 1j * FREQUENCIES
    k_p, k_i = outer_gains(1.0, 4 * LAM_MOTOR, lam)
    return max_sensitivity((k_p + k_i / jw) / (LAM_MOTOR * jw + 1) ** 4)


def inner_gains(lam: float) -> tuple[float, float, float, float]:
    """Return k_p, k_i, k_d, t_f of table 2."""
    D = 4 * T_m - lam
    return (
        4 * T_m**2 / (K_m * lam**2 * D),
        T_m**2 / (K_m * lam**3 * D),
        (6 * T_m**2 - lam * D) / (K_m * lam * D),
        T_m * lam / D,
    )


def inner_loop(lam: float, L_over_R: float) -> np.ndarray:
    jw = 1j * FREQUENCIES
    k_p, k_i, k_d, t_f = inner_gains(lam)
    return np.asarray((k_p + k_i / jw + k_d * jw) / (t_f * jw + 1) * K_m / (jw * (T_m * jw + 1) * (L_over_R * jw + 1)))


def sampled_inner_loop(lam: float) -> np.ndarray:
    """Return the loop at FREQUENCIES up to half the sampling rate: process with a hold, exact step of the lag."""
    below = np.searchsorted(FREQUENCIES, np.pi / T_s)
    z = np.exp(1j * FREQUENCIES[:below] * T_s)
    k_p, k_i, k_d, t_f = inner_gains(lam)
    lag = (1 - np.exp(-T_s / t_f)) / (1 - np.exp(-T_s / t_f) / z)
    process = control.sample_system(K_m / (s * (T_m * s + 1) * (L_OVER_R * s + 1)), T_s)
    return np.asarray(process(z) * (lag * (k_p + k_i * T_s / (z - 1)) + k_d / t_f * (1 - lag)))


def crossings(loop: np.ndarray) -> np.ndarray:
    """Return the gains that place the loop on −1, from the crossings of the negative real axis."""
    at = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0))
    share = loop.imag[at] / (loop.imag[at] - loop.imag[at + 1])
    return np.asarray(-1 / (loop.real[at] + share * (loop.real[at + 1] - loop.real[at])))


def test_e1_printed_gain_rings_and_the_corrected_one_does_not() -> None:
    text = section("E1")
    lam = 0.2
    _, (K, T), _, _ = TABLE_1[40]
    printed = first_order_loop(K, T, 2 / (K * lam), T / (K * lam**2))
    assert f"a damping ratio of {printed.damp()[1].min():.2f} and" in text
    assert f"overshoots by {control.step_info(printed)['Overshoot']:.1f} %" in text
    _, (K, T), _, _ = TABLE_1[10]
    printed = first_order_loop(K, T, 2 / (K * lam), T / (K * lam**2))
    poles = f"lies at {printed.poles().real.max():.1f} s⁻¹ instead of {-1 / lam:.0f} s⁻¹"
    assert poles.replace("-", "−") in " ".join(text.split())
    for _, (K, T), _, _ in TABLE_1.values():
        assert first_order_loop(K, T, *outer_gains(K, T, lam)).poles() == pytest.approx(-1 / lam, rel=1e-5)


def test_e2_one_tenth_of_the_printed_coefficients_agrees_with_the_text() -> None:
    text = section("E2")
    S, factors = (np.array([row[column] for row in TABLE_1.values()]) for column in (0, 3))
    a2, a1 = factors.T
    damping = a1 / (2 * np.sqrt(a2))
    assert "damping ratios of {:.2f}, {:.2f} and {:.2f}:".format(*damping[:3]) in text
    assert "gives {:.2f}, {:.2f} and {:.2f}.".format(*damping[:3] / 10) in text
    assert "B_j = {:.3f}, {:.3f} and {:.3f} N".format(*(S * a1 / 10)[:3]) in text
    J_j = [f"{value:.1e}".replace("e-0", "e-") for value in S * a2]
    assert "J_j = {}, {} and {} kg".format(*J_j[:3]) in text
    assert f"40 N (J_j = {J_j[3]})" in text


def test_e3_loop_gains_through_the_decoupler_are_one() -> None:
    text = section("E3")
    K_q, K_S = r_m / (2 * r_j), 2 * r_j**2 * k_2 * r_m
    assert f"= {K_q:.2f} and" in text
    assert f"= {K_S:.3f}, both are 1" in text
    assert 2 * K_q * r_j / r_m == pytest.approx(1)
    assert 2 * K_S / (4 * k_2 * r_j**2 * r_m) == pytest.approx(1)


def test_e4_cubic_spring_off_equilibrium() -> None:
    text = section("E4")
    spring = np.polynomial.Polynomial([k_0, k_1, k_2, 1.0e5])
    theta, q = 4.73, 0.2
    x = r_m * theta
    by_equation_16 = (
        2 * r_j**2 * sum(i / 2 ** (i - 1) * k * (2 * x) ** (i - 1) for i, k in enumerate(spring.coef) if i > 0)
    )
    step = 1e-5

    def torque(angle: float) -> float:
        return float(r_j * (spring(x - r_j * angle) - spring(x + r_j * angle)))

    by_derivative = -(torque(q + step) - torque(q - step)) / (2 * step)
    assert f"motors at {theta} rad and the joint pushed to {q} rad" in text
    assert f"equation 16 gives {by_equation_16:.2f} N" in text
    assert f"derivative of the torque {by_derivative:.2f}." in text


def test_e5_sensitivity_of_the_inner_loop() -> None:
    text = section("E5")
    assert f"of table 2 it is {max_sensitivity(inner_loop(LAM_MOTOR, 0.0)):.3f}." in text
    assert f"it is {max_sensitivity(inner_loop(LAM_MOTOR, L_OVER_R)):.3f}, and" in text
    assert f"as well it is {max_sensitivity(sampled_inner_loop(LAM_MOTOR)):.3f}: the paper is right" in text
    rows = re.findall(r"\| (0\.\d{4}) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+)° \|", text)
    assert len(rows) == 4
    for lam, *shown in rows:
        loop = sampled_inner_loop(float(lam))
        gains = crossings(loop)
        turn = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1)))
        expected = (
            f"{max_sensitivity(inner_loop(float(lam), 0.0)):.3f}",
            f"{max_sensitivity(loop):.3f}",
            f"{gains[gains > 1].min():.1f}",
            f"{gains[gains < 1].max():.3f}" if np.any(gains < 1) else "0",
            f"{180 + np.degrees(np.angle(loop[turn])).min():.1f}",
        )
        assert tuple(shown) == expected, lam


def test_e5_conditional_stability_of_the_inner_loop_and_minimum_of_M_s() -> None:
    text = section("E5")
    lambdas = np.arange(0.0550, 0.0650, 0.0001)
    conditional = [lam for lam in lambdas if np.any(crossings(sampled_inner_loop(lam)) < 1)]
    assert f"conditionally stable below λ = {max(conditional) + 0.0001:.4f} s" in text
    peaks = {lam: max_sensitivity(sampled_inner_loop(lam)) for lam in np.arange(0.05, 0.41, 0.05)}
    lowest = min(peaks, key=lambda lam: peaks[lam])
    assert f"up to {lowest:.2f} s ({peaks[lowest]:.3f})" in text
    assert f"({max_sensitivity(sampled_inner_loop(0.4)):.3f} at 0.4 s)" in text


def test_e6_loops_tuned_on_table_1_are_unstable() -> None:
    decoupler_q, decoupler_S = r_j / r_m, 1 / (4 * r_j**2 * r_m * k_2)
    for _, (K_q, T_q), (K_S, T_S), _ in TABLE_1.values():
        for twice in (1, 2):
            assert four_lag_poles(*outer_gains(twice * K_q * decoupler_q, T_q, 0.2)).real.max() > 0
        assert four_lag_poles(*outer_gains(K_S * decoupler_S, T_S, 0.2)).real.max() > 0
        assert four_lag_poles(*outer_gains(2 * K_S * decoupler_S, T_S, 0.2)).real.max() < 0


def test_e6_sensitivity_peak_for_the_sum_of_lags() -> None:
    text = section("E6")
    assert f"T = {4 * LAM_MOTOR:.3f} s" in text
    quoted = "{:.2f} at λ = 0.342, {:.2f} at 0.41 and {:.2f} at 0.51 s".format(
        *map(four_lag_sensitivity, (0.342, 0.41, 0.51))
    )
    assert quoted in text
    edge = brentq(lambda lam: four_lag_poles(*outer_gains(1.0, 4 * LAM_MOTOR, lam)).real.max(), 0.15, 0.25)
    assert f"Below λ = {edge:.4f} s the loop is unstable" in text


def test_e8_minimum_stiffness_is_the_stiffness_at_zero_force() -> None:
    text = section("E8")
    x = float(np.max(np.polynomial.Polynomial([k_0, k_1, k_2]).roots()))
    assert f"2 k1 r_j² = {2 * k_1 * r_j**2:.2f} N" in text
    assert f"({1e3 * x:.2f} mm) the stiffness is {2 * r_j**2 * (k_1 + 2 * k_2 * x):.2f} N" in text


def test_e9_relative_degrees_sum_to_the_number_of_states() -> None:
    """Relative degrees of the linearized joint with its two motors: 4 for q, 2 for S, together all six states."""
    text = section("E9")
    J_j, B_j, S_0, stiffer = 5.2e-4, 0.046, 10.5, 2 * r_j**2 * k_2 * r_m
    A = np.zeros((6, 6))  # q, q', θ_A, θ_A', θ_B, θ_B'
    A[0, 1] = A[2, 3] = A[4, 5] = 1.0
    A[1] = np.array([-S_0, -B_j, S_0 * r_m / (2 * r_j), 0.0, -S_0 * r_m / (2 * r_j), 0.0]) / J_j
    A[3, 3] = A[5, 5] = -1 / T_m
    B = np.zeros((6, 2))
    B[3, 0] = B[5, 1] = K_m / T_m
    degrees = []
    for output in (np.eye(6)[0], np.array([0.0, 0.0, stiffer, 0.0, stiffer, 0.0])):
        sizes = [np.abs(output @ np.linalg.matrix_power(A, k) @ B).max() for k in range(6)]
        degrees.append(1 + int(np.argmax(np.array(sizes) > 1e-9)))
    assert f"q has relative degree {degrees[0]} and S has {degrees[1]}, together the six states" in text
    assert sum(degrees) == A.shape[0]
