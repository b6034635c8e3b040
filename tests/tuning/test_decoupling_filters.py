"""Sampled filters of the dynamic decoupler: transfer functions, closed loops without coupling, and schedules."""

import math

import numpy as np
import pytest
from scipy import signal

from backend.control import dynamic_decoupler, pid
from backend.control.dynamic_decoupler import (
    NO_FILTER,
    STATIC_ONLY,
    DynamicDecoupler,
    HighPassSection,
    ResidualFilter,
    SecondOrderSection,
    StaticPart,
    interpolate_decoupler,
)
from backend.tuning.coupled_model import CoupledModel
from backend.tuning.decoupling import design_decoupling
from backend.tuning.decoupling_filters import (
    build_schedule,
    largest_pole,
    make_residual_filter,
    make_state_space,
)
from backend.tuning.gains import TuningError, outer_gains
from plant.interface import T_s
from tests.refusals import refused

# Filters -------------------------------------------------------------------------------------------


def response(r: ResidualFilter, s: np.ndarray, period_s: float = T_s) -> np.ndarray:
    """Return the filter at points s of the bilinear transform."""
    delta = 2.0 * s * period_s / (2.0 - s * period_s)
    first = (r.first.b_0 * delta**2 + r.first.b_1 * delta) / (delta**2 + r.first.a_1 * delta + r.first.a_2)
    second = np.polyval(r.second[2:], delta) / (delta**2 + r.second.a_1 * delta + r.second.a_2)
    return np.asarray(first * second)


def poly(*roots: complex) -> np.ndarray:
    return np.atleast_1d(np.real(np.poly(roots)))


RATIOS = {
    "constant": (poly(), poly()),
    "lag": (0.3 * poly(), poly(-5.0)),
    "lead": (0.3 * poly(-1.0), poly(-5.0)),
    "pair": (0.3 * poly(-1.0, 4.0), poly(-5.0 + 20.0j, -5.0 - 20.0j)),
    "two lags": (0.3 * poly(0.0, 0.0), poly(-5.0, -50.0)),
    "three": (poly(-3.0 + 4.0j, -3.0 - 4.0j), poly(-2.0, -8.0, -30.0)),
    "pair and lag": (poly(-3.0 + 9.0j, -3.0 - 9.0j, -1.0), poly(-4.0 + 9.0j, -4.0 - 9.0j, -30.0)),
    "four equal": (0.03 * poly(*[-16.0] * 4), poly(*[-9.0] * 4)),
    "slow pair and two": (poly(-2.0, -300.0, 5.0), poly(-1.0 + 2.0j, -1.0 - 2.0j, -70.0, -200.0)),
    "slow two and pair": (poly(-2.0), poly(-40.0 + 2.0j, -40.0 - 2.0j, -7.0, -9.0)),
    "two pairs": (poly(-1.0 + 1.0j, -1.0 - 1.0j), poly(-3.0 + 4.0j, -3.0 - 4.0j, -4.0 + 3.0j, -4.0 - 3.0j)),
    "zeros at 0": (poly(0.0, 0.0, 0.0, 0.0), poly(-3.0 + 4.0j, -3.0 - 4.0j, -4.0, -9.0)),
    "slow": (poly(-0.01, -0.02, -0.5), poly(-0.011, -0.03, -0.4, -1500.0)),
}


@pytest.mark.parametrize("name", RATIOS)
def test_a_residual_filter_is_the_ratio_without_its_static_gain(name: str) -> None:
    coupling, diagonal = RATIOS[name]
    r = make_residual_filter(coupling, diagonal)
    s = 1j * np.geomspace(1e-3, 1e4, 300)
    static = coupling[-1] / diagonal[-1]
    expected = static - np.polyval(coupling, s) / np.polyval(diagonal, s)
    assert np.max(np.abs(response(r, s) - expected)) < 1e-9 * max(1.0, float(np.max(np.abs(expected))))


@pytest.mark.parametrize("name", RATIOS)
def test_a_residual_filter_is_zero_at_zero_frequency_and_stable(name: str) -> None:
    d = DynamicDecoupler(make_residual_filter(*RATIOS[name]), NO_FILTER, STATIC_ONLY.static)
    static = make_state_space(d).response(np.array([1.0 + 0j]))[0]
    assert np.max(np.abs(static - np.eye(2))) == 0.0
    assert largest_pole(d) < 1.0


def test_states_remain_in_the_unit_of_the_output() -> None:
    """A unit step gives states of the size of the ratio's gain, also for four slow poles."""
    d = DynamicDecoupler(make_residual_filter(*RATIOS["four equal"]), NO_FILTER, STATIC_ONLY.static)
    state, largest = dynamic_decoupler.at_rest(0.0, 0.0), 0.0
    for _ in range(2000):
        _, _, state = dynamic_decoupler.step(d, state, 0.0, 1.0)
        largest = max(largest, *(abs(x) for x in state.r_12))
    assert largest < 2.0 * 0.03 * (16.0 / 9.0) ** 4


# Closed loops --------------------------------------------------------------------------------------


def times(*factors: np.ndarray) -> np.ndarray:
    product = np.ones(1)
    for factor in factors:
        product = np.convolve(product, factor)
    return product


def lever(lam_1: float, lam_2: float, tau_2: float, sigma: float, static: float = 0.0) -> CoupledModel:
    """Return a lever type away from rest with unlike motor loops, decoupled statically.

    q = P [E_1 u_1 + τ_2 (E_2 − E_1) u_2], S = P [σ (E_1 − E_2) u_1 + E_2 u_2] with P = 1/(J s²/S + B s/S + 1) and E_i =
    1/(λ_i s + 1)⁴; ``static`` adds a coupling at zero frequency.
    """
    P = np.array([4e-4, 5e-3, 1.0])
    lags_1, lags_2 = (times(*[np.array([lam, 1.0])] * 4) for lam in (lam_1, lam_2))
    A = tuple(times(P, lags_1, lags_2)[::-1])
    B_12 = tau_2 * (lags_1 - lags_2) + static * lags_1
    B_21 = sigma * (lags_2 - lags_1) + static * lags_2
    return CoupledModel((A, A), ((tuple(lags_2[::-1]), tuple(B_12[::-1])), (tuple(B_21[::-1]), tuple(lags_1[::-1]))))


class Process:
    """Process behind its hold, from g_ij one by one by SciPy: independent of the code under test."""

    def __init__(self, model: CoupledModel) -> None:
        self.parts = {}
        for i in (0, 1):
            for j in (0, 1):
                numerator = np.trim_zeros(np.array(model.numerators[i][j][::-1]), "f")
                if numerator.size:
                    zeros, poles, gain = signal.tf2zpk(numerator, model.denominators[i][::-1])
                    continuous = signal.zpk2ss(zeros, poles, gain)
                    A, B, C, _, _ = signal.cont2discrete(continuous, T_s, "zoh")
                    self.parts[i, j] = (A, B[:, 0], C[0], np.zeros(len(A)))

    def outputs(self) -> np.ndarray:
        y = np.zeros(2)
        for (i, _), (_, _, C, x) in self.parts.items():
            y[i] += C @ x
        return y

    def step(self, u: np.ndarray) -> None:
        for (i, j), (A, B, C, x) in self.parts.items():
            self.parts[i, j] = (A, B, C, A @ x + B * u[j])


def simulate(
    model: CoupledModel, decoupler: DynamicDecoupler, gains: list[pid.IPGains], r: tuple[float, float], ticks: int
) -> np.ndarray:
    process, state = Process(model), dynamic_decoupler.at_rest(0.0, 0.0)
    loops = [pid.at_rest_i_p(g, 0.0, 0.0, 0.0) for g in gains]
    M = np.array([[decoupler.static.q_q, decoupler.static.q_S], [decoupler.static.S_q, decoupler.static.S_S]])
    rows = np.empty((ticks, 2))
    for k in range(ticks):
        rows[k] = y = process.outputs()
        v_q, loops[0] = pid.step_i_p(gains[0], loops[0], r[0], y[0], 0.0)
        v_S, loops[1] = pid.step_i_p(gains[1], loops[1], r[1], y[1], 0.0)
        q_c, S_c, state = dynamic_decoupler.step(decoupler, state, v_q, v_S)
        process.step(M @ [q_c, S_c])
    return rows


GAINS = [outer_gains(1.0, 0.3, 0.5), outer_gains(1.0, 0.4, 0.45)]


@pytest.mark.parametrize("static", [0.0, 0.15], ids=["dynamic", "static too"])
@pytest.mark.parametrize("i", [0, 1], ids=["q step", "S step"])
def test_closed_loops_of_the_exact_model_are_single_loops(static: float, i: int) -> None:
    model = lever(0.05, 0.08, 0.4, 0.15, static)
    design = design_decoupling(model)
    assert design.decoupler is not None, design.describe()
    r = (1.0, 0.0) if i == 0 else (0.0, 1.0)
    decoupled = simulate(model, design.decoupler, GAINS, r, 3000)
    coupled = simulate(model, STATIC_ONLY._replace(static=design.decoupler.static), GAINS, r, 3000)
    (B_11, _), (_, B_22) = model.numerators
    diagonal = CoupledModel(model.denominators, ((B_11, (0.0,)), ((0.0,), B_22)))
    single = simulate(diagonal, STATIC_ONLY, GAINS, r, 3000)
    off, on = np.max(np.abs(decoupled[:, 1 - i])), np.max(np.abs(decoupled[:, i] - single[:, i]))
    before = np.max(np.abs(coupled[:, 1 - i]))
    assert before > 5e-3
    assert off < 2e-6
    assert off < 1e-3 * before
    assert on < 2e-6


def test_the_coupling_that_remains_is_of_second_order_in_the_period() -> None:
    model = lever(0.05, 0.09, 0.4, 0.15)
    omega = np.array([1.0, 5.0, 20.0, 60.0])
    errors = []
    for period_s in (4e-3, 2e-3, 1e-3):
        design = design_decoupling(model, period_s)
        assert design.decoupler is not None
        K = make_state_space(design.decoupler).response(np.exp(1j * omega * period_s))
        G = model.response(1j * omega)
        coupling = G @ K
        errors.append(np.abs(coupling[:, 0, 1]) / np.abs(G[:, 0, 0]))
    assert errors[0] / errors[1] == pytest.approx([4.0] * 4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx([4.0] * 4, rel=0.05)


def test_connected_filters_equal_the_inverse_of_the_continuous_ones() -> None:
    """u = (I − D)⁻¹ v = M ((I − R M)⁻¹ v) at the frequencies of the bilinear transform."""
    model = lever(0.05, 0.08, 0.4, 0.15, static=0.2)
    design = design_decoupling(model)
    assert design.decoupler is not None
    omega = np.geomspace(0.1, 3000.0, 50)
    G = model.response(2.0 / T_s * 1j * np.tan(0.5 * omega * T_s))
    D = np.zeros_like(G)
    D[:, 0, 1], D[:, 1, 0] = -G[:, 0, 1] / G[:, 0, 0], -G[:, 1, 0] / G[:, 1, 1]
    static = design.decoupler.static
    M = np.array([[static.q_q, static.q_S], [static.S_q, static.S_S]])
    found = M @ make_state_space(design.decoupler).response(np.exp(1j * omega * T_s))
    assert np.max(np.abs(found - np.linalg.inv(np.eye(2) - D))) < 1e-9


# Schedule ------------------------------------------------------------------------------------------


def entry(lam_2: float) -> DynamicDecoupler:
    design = design_decoupling(lever(0.05, lam_2, 0.4, 0.15))
    assert design.decoupler is not None
    return design.decoupler


def test_a_schedule_has_the_filters_of_its_entries_and_is_stable_between_them() -> None:
    decouplers = [entry(lam) for lam in (0.06, 0.07, 0.09)]
    entries = build_schedule(decouplers)
    for k, d in enumerate(decouplers):
        assert interpolate_decoupler(entries, float(k)) == d
    for active in np.linspace(0.0, 2.0, 41):
        assert largest_pole(interpolate_decoupler(entries, float(active))) < 1.0


def test_filters_fade_out_towards_a_static_entry() -> None:
    entries = build_schedule([entry(0.09), None])
    z = np.exp(1j * np.array([3.0, 30.0]) * T_s)

    def coupling(active: float) -> np.ndarray:
        """Return −r_12 and −r_21: both connected filters are (I − R)⁻¹."""
        connected = make_state_space(interpolate_decoupler(entries, active)).response(z)
        return np.asarray(np.linalg.inv(connected)[:, [0, 1], [1, 0]])

    assert np.min(np.abs(coupling(0.0))) > 1e-3
    assert np.max(np.abs(coupling(1.0))) < 1e-14
    assert np.max(np.abs(coupling(0.25) - 0.75 * coupling(0.0))) < 1e-12
    assert np.array_equal(build_schedule([None]), build_schedule([STATIC_ONLY]))


def test_a_schedule_that_is_unstable_between_entries_is_refused() -> None:
    """Each entry has one strong filter; halfway both are, and their loop has a gain above 1."""
    strong = ResidualFilter(HighPassSection(1.01, 0.01, 9.0, 9.0), SecondOrderSection(2.0, 1.0, 1.0, 2.0, 1.0))
    ends = [
        DynamicDecoupler(strong, NO_FILTER, STATIC_ONLY.static),
        DynamicDecoupler(NO_FILTER, strong, STATIC_ONLY.static),
    ]
    assert all(largest_pole(d) < 1.0 for d in ends)
    with refused(TuningError, "unstable_schedule"):
        build_schedule(ends)
    with refused(TuningError, "unstable_schedule", active=1.0):
        build_schedule([DynamicDecoupler(strong, strong, STATIC_ONLY.static)])
    with refused(TuningError, "no_entries"):
        build_schedule([])
    with refused(TuningError, "filter_not_finite", entry=2):
        build_schedule([STATIC_ONLY, STATIC_ONLY._replace(static=StaticPart(1.0, math.nan, 0.0, 1.0))])


def test_switching_a_designed_schedule_at_rest_moves_nothing() -> None:
    entries = build_schedule([entry(0.06), None, entry(0.09)])
    state = dynamic_decoupler.at_rest(0.4, 11.0)
    for active in (0.0, 2.0, 0.3, 1.0, 1.7, math.nextafter(2.0, 0.0)):
        q_c, S_c, state = dynamic_decoupler.step(interpolate_decoupler(entries, active), state, 0.4, 11.0)
        assert (q_c, S_c) == (0.4, 11.0)
