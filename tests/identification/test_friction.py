"""Load-dependent Coulomb friction: closed forms, values of the simulator, and insufficient data."""

import numpy as np
import pytest

from backend.identification.friction import COLUMNS, LoadFrictionFit, TensionRun, estimate_load_friction
from backend.identification.messages import with_error
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.docs.figures.identification_page import default_plan
from tests.docs.figures.identification_runs import Bench

R_M = 0.0075
C0, C1, K_T, J, B, OFFSET_V = 0.031, 0.27, 0.42, 0.019, 0.08, 0.15


def computed(number: int, tension_N: float, *, delay: int = 0, speed: float = 1.0, samples: int = 12_000) -> TensionRun:
    """Return a motor on a path of two sines with the voltage by Newton's law, in closed form."""
    t = np.arange(samples + delay) * 1e-3
    path = ((0.8 * speed, 2.1, 0.0), (0.5 * speed, 5.3, 0.7))
    theta = 6.0 + sum(a * np.sin(w * t + phase) for a, w, phase in path)
    theta_d = sum(a * w * np.cos(w * t + phase) for a, w, phase in path)
    theta_dd = sum(-a * w * w * np.sin(w * t + phase) for a, w, phase in path)
    q = 0.05 * theta
    F = tension_N + 400.0 * (R_M * (theta - 6.0) - 0.075 * (q - 0.3)) + 3.0 * (theta - 6.0) ** 2
    friction = (C0 + C1 * R_M * F) * np.sign(theta_d)
    u = (J * theta_dd + B * theta_d + R_M * F + friction) / K_T + OFFSET_V
    late = {"u_A": u[delay:], "theta_A": theta[delay:], "q": q[delay:], "F_A": F[: F.size - delay]}
    return TensionRun(number, 1e-3, late)


def of_simulator(parameters: PlantParameters, seed: int, tensions: tuple[float, ...]) -> list[TensionRun]:
    bench = Bench(parameters, seed)
    played = ((tension, bench.play(default_plan(tension))) for tension in tensions)
    # Stored in single precision.
    return [
        TensionRun(round(tension), T_s, {name: columns[name].astype(np.float32).astype(float) for name in COLUMNS})
        for tension, columns in played
    ]


def measured(runs: list[TensionRun]) -> LoadFrictionFit:
    found = estimate_load_friction(runs, R_M)
    assert found.estimate is not None, found.problem
    assert found.left_out == ()
    return found.estimate


@pytest.mark.parametrize("delay", [0, 12])
def test_friction_and_torque_constant_of_a_closed_form_motor_are_found(delay: int) -> None:
    found = measured([computed(1, 12.0, delay=delay), computed(2, 31.0, delay=delay)])
    assert found.c0 == pytest.approx(C0, rel=0.01)
    assert found.c1 == pytest.approx(C1, rel=0.01)
    assert found.K_t == pytest.approx(K_T, rel=0.002)
    assert found.runs == (1, 2)


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_the_friction_of_the_simulator_is_found_from_two_tensions(name: str) -> None:
    """This applies to smooth and to static friction. The torque constant of motor A is 0.99 of 0.3 N·m/V."""
    parameters = load_parameters(name)
    found = measured(of_simulator(parameters, 0, (10.0, 40.0)))
    for value, std, truth in (
        (found.c0, found.c0_std, parameters.motor.c0),
        (found.c1, found.c1_std, parameters.motor.c1),
        (found.K_t, found.K_t_std, parameters.asymmetry.motor_A * parameters.motor.K_t),
    ):
        assert abs(value - truth) < 4.0 * std
        assert std < 0.02 * truth


def test_the_estimated_friction_of_a_frictionless_motor_is_zero() -> None:
    found = measured(of_simulator(load_parameters("ideal"), 0, (10.0, 40.0)))
    assert abs(found.c0) < 2e-4
    assert abs(found.c1) < 1e-3


def test_confidence_intervals_of_twenty_seeds_cover_the_truth() -> None:
    """For each estimate, fewer than 16 of 20 intervals of 95 % contain the truth in 1 of 400 trials."""
    lab = load_parameters("lab")
    found = [measured(of_simulator(lab, seed, (10.0, 20.0, 30.0, 40.0))) for seed in range(20)]
    assert np.mean([one.c0 for one in found]) == pytest.approx(lab.motor.c0, rel=0.02)
    assert np.mean([one.c1 for one in found]) == pytest.approx(lab.motor.c1, rel=0.005)
    assert sum(abs(one.c0 - lab.motor.c0) < 1.96 * one.c0_std for one in found) >= 16
    assert sum(abs(one.c1 - lab.motor.c1) < 1.96 * one.c1_std for one in found) >= 16


def test_one_tension_or_two_similar_tensions_give_no_estimate() -> None:
    for runs in ([], [computed(1, 20.0)], [computed(1, 20.0), computed(2, 24.0)]):
        found = estimate_load_friction(runs, R_M)
        assert found.estimate is None
        assert found.problem.code == "too_few_tensions"
        assert found.problem.values["tensions_N"] == pytest.approx([run.tension_N for run in runs])
        assert found.problem.values["minimum_distance_N"] == 5.0


def test_an_unusable_run_is_omitted_with_a_reason() -> None:
    whole, still, broken = computed(1, 12.0), computed(2, 31.0, speed=0.001), computed(3, 31.0)
    gap = np.array(broken.columns["F_A"])
    gap[700] = np.nan
    lacking = TensionRun(4, 1e-3, {name: column for name, column in broken.columns.items() if name != "u_A"})
    holes = TensionRun(3, 1e-3, {**broken.columns, "F_A": gap})
    found = estimate_load_friction([whole, still, holes, lacking, computed(5, 31.0)], R_M)
    assert found.estimate is not None
    assert found.estimate.runs == (1, 5)
    assert [reason.partition(":")[0] for reason in found.left_out] == ["run 2", "run 3", "run 4"]


def test_a_value_is_rounded_to_the_digits_of_its_error() -> None:
    assert with_error(0.0201131, 0.000121) == "0.02011 ± 0.00012"
    assert with_error(-0.00003, 0.4) == "−0.00 ± 0.40"
