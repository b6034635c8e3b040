"""Robustness metrics of a row against an independently derived frequency response of the drawn plant."""

import math

import numpy as np
import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.services.studies import Studies
from backend.storage import studies
from backend.storage.database import Database, open_database
from backend.studies.design import Design
from backend.studies.point import LOOP_METRICS, compute_loop_metrics, plan_point, run_point
from backend.studies.stored import parse_design
from backend.tuning.gains import MotorModel, motor_gains
from backend.tuning.robustness import motor_robustness
from plant.parameters import load_parameters

K_m, T_m, K_t, TAU_E = 2.86, 0.22, 0.3, 2e-3
R_m, R_j, J_j, B_j, SLOPE = 7.5e-3, 75e-3, 5.2e-4, 0.046, 10.55 / (2.0 * 75e-3**2)
LAM, LAM_S = 0.0854, 0.42
OMEGA = np.geomspace(0.05, 300.0, 40_000)
HEAD = "format: 1\nname: a\ntitle: A\nexperiment: tracking\n"
GRID = HEAD + (
    "axes:\n  - {over: lam_q, values: [0.36, 0.4]}\n"
    f"  - {{over: motor.K_m, values: [{0.9 * K_m}, {K_m}, {1.1 * K_m}]}}\n"
    f"  - {{over: motor.T_m, values: [{0.8 * T_m}, {T_m}, {1.2 * T_m}]}}\n"
)
DRAWN = HEAD + (
    "settings: {lam_q: 0.4}\ndraws: 12\nseed: 3\n"
    "spread: [{of: motor.K_m, relative: 0.1}, {of: motor.T_m, relative: 0.2}]\n"
)
SHORT = "settings: {q_duration_s: 0.5, S_duration_s: 0.5, S_high: 12.0}\n"


@pytest.fixture
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return open_database(tmp_path_factory.mktemp("data"))


def build_design(database: Database, text: str) -> Design:
    begun = Studies(database).create(text, "Ana", load_parameters("ideal"), TuningSettings().to_document())
    with database.reading() as session:
        return parse_design(studies.get(session, begun.id))


def figures_of(design: Design, number: int) -> dict[str, float | None]:
    parameters, _, loop = plan_point(design.base, design.point(number))
    return compute_loop_metrics(parameters, (), loop)


def loops(lam_q: float, own_K_m: float, own_T_m: float) -> dict[str, np.ndarray]:
    """Return the open loops of q and S from motor equations, springs and table 2, with the identified K_m and T_m."""
    s = 1j * OMEGA
    D = 4.0 * T_m - LAM
    k_p, k_i = 4.0 * T_m**2 / (K_m * LAM**2 * D), T_m**2 / (K_m * LAM**3 * D)
    k_d, t_f = (6.0 * T_m**2 - LAM * D) / (K_m * LAM * D), T_m * LAM / D
    damping = K_t / own_K_m
    drive = K_t / (TAU_E * s + 1.0) / (t_f * s + 1.0)
    shaft = damping * (own_T_m * s**2 + s) + drive * (k_i / s + k_p + k_d * s)
    # The differential mode turns the compliant joint; the common mode only elongates the springs.
    joint = 2.0 * R_j * R_m * SLOPE / (J_j * s**2 + B_j * s + 2.0 * R_j**2 * SLOPE)
    apart = drive * k_i / s / (shaft + R_m * SLOPE * (R_m - R_j * joint))
    together = drive * k_i / s / (shaft + R_m**2 * SLOPE)
    T = 4.0 * LAM

    def law(lam: float) -> np.ndarray:
        return np.asarray((2.0 * T - lam) / lam + T / lam**2 / s)

    return {"q": R_j / R_m * joint * apart * law(lam_q), "S": together * law(LAM_S)}


def by_hand(loop: np.ndarray) -> tuple[float, float, float]:
    """Compute M_s, gain margin [1] and phase margin [rad] on a dense frequency grid."""
    crossing = np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[:-1] < 0.0))[0]
    unity = np.flatnonzero((np.abs(loop[:-1]) > 1.0) & (np.abs(loop[1:]) <= 1.0))[0]
    M_s = float(np.max(1.0 / np.abs(1.0 + loop)))
    return M_s, float(-1.0 / loop[crossing].real), math.pi + float(np.angle(loop[unity]))


@pytest.mark.parametrize("text", [GRID, DRAWN])
def test_each_row_has_the_margins_of_the_drawn_plant_and_of_the_model(database: Database, text: str) -> None:
    design = build_design(database, text)
    for number in range(len(design)):
        values = design.point(number)
        lam_q = float(values.settings.get("lam_q", 0.4))
        found = figures_of(design, number)
        for ending, constants in (("", (K_m, T_m)), ("_true", (values.plant["motor.K_m"], values.plant["motor.T_m"]))):
            for loop, response in loops(lam_q, *constants).items():
                M_s, gain_margin, phase_margin = by_hand(response)
                assert found[f"M_s_{loop}{ending}"] == pytest.approx(M_s, abs=5e-4)
                assert found[f"gain_margin_{loop}{ending}"] == pytest.approx(gain_margin, rel=1e-3)
                assert found[f"phase_margin_{loop}{ending}"] == pytest.approx(phase_margin, abs=1e-3)


def test_sensitivity_peaks_of_a_motor_grid_match_an_independent_analysis(database: Database) -> None:
    design = build_design(database, GRID)
    peaks = {}
    for number in range(len(design)):
        point, found = design.point(number), figures_of(design, number)
        lam_q, factors = point.settings["lam_q"], (point.plant["motor.K_m"] / K_m, point.plant["motor.T_m"] / T_m)
        peaks[lam_q, round(factors[0], 3), round(factors[1], 3)] = found["M_s_q_true"]
        assert found["M_s_q"] == pytest.approx(1.486 if lam_q == 0.4 else 1.667, abs=0.001)
    for index, M_s in (
        ((0.4, 1.1, 1.0), 1.446),
        ((0.4, 1.0, 1.0), 1.486),
        ((0.4, 0.9, 1.0), 1.539),
        ((0.4, 1.0, 0.8), 1.416),
        ((0.4, 1.0, 1.2), 1.583),
        ((0.36, 0.9, 1.2), 1.97),
    ):
        assert peaks[index] == pytest.approx(M_s, abs=0.005)


def test_asymmetric_motors_and_springs_have_separate_loops(database: Database) -> None:
    axes = "axes: [{over: asymmetry.spring_A, values: [1.0, 1.3]}, {over: asymmetry.motor_B, values: [1.0, 1.2]}]"
    design = build_design(database, HEAD + axes)
    alike, motor, spring, _ = (figures_of(design, number) for number in range(4))
    assert {alike[name] for name in LOOP_METRICS if name.startswith("M_s_q")} == {alike["M_s_q"]}
    assert spring["M_s_q"] == motor["M_s_q"] == alike["M_s_q"]
    # A motor with more torque behaves as one with a higher K_m; the row has the worse of both motors.
    K_t_more = motor_robustness(MotorModel(1.2 * K_m, T_m, TAU_E), motor_gains(K_m, T_m, LAM)).M_s
    assert motor["M_s_motor_true"] == pytest.approx(K_t_more, rel=1e-9)
    assert spring["M_s_motor_true"] == alike["M_s_motor_true"] != pytest.approx(K_t_more, rel=1e-3)
    assert spring["M_s_q_true"] != pytest.approx(alike["M_s_q_true"], abs=1e-4)


def test_a_simulated_row_has_robustness_metrics(database: Database) -> None:
    design = build_design(database, HEAD + SHORT + f"axes: [{{over: motor.K_m, values: [{0.9 * K_m}]}}]")
    row = run_point(design.base, design.point(0))
    assert row.state == "completed"
    assert row.figures["rmse_q"] is not None
    assert {name: row.figures[name] for name in LOOP_METRICS} == figures_of(design, 0)
