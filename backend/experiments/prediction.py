"""Predictions for an identification before it starts: motion, voltage, and problems."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import build_decoupler, equilibrium, stiffness
from backend.experiments import messages
from backend.experiments.plans import ActuatorIdentificationPlan, MotorIdentificationPlan, SpringIdentificationPlan
from backend.identification import MIN_COUNTS, turn_from_rest
from plant import (
    SIDES,
    PlantParameters,
    T_s,
    spring_elongation,
    tendon_tension,
)

# Actuator identification ---------------------------------------------------------------------------
# The response to the excitation (method section 4). ``forecast_identifications`` predicts the range
# of the joint during the whole run.


_COUNTS_WHERE_EXACT = 4000
"""Joint counts per turn of the paper's encoder, used for parameter sets with ideal sensors."""


@dataclass(frozen=True)
class PredictedMotion:
    """Predicted motion of the joint [counts, peak to peak], largest voltage, least tension, and any problem."""

    q_counts: float
    u_peak_V: float
    F_min_N: float
    problem: str

    @property
    def is_feasible(self) -> bool:
        """Whether the excitation suffices without slack tendons and without saturation."""
        return not self.problem

    @property
    def message(self) -> str:
        """The problem, or the expected motion."""
        return self.problem or messages.excitation_moves_joint(counts=self.q_counts)


def predict_excitation(
    plan: ActuatorIdentificationPlan, parameters: PlantParameters, lam_motor: float
) -> PredictedMotion:
    """Simulate the excitation through the four lags of the motor loop, with the joint at equilibrium.

    With theta_B = 0 the joint rests where both tensions are equal: for equal springs q = r_m theta_A / (2 r_j)
    (equation 15). The voltage accelerates the motor (equation 17) against tension and friction. ``lam_motor`` in s.
    """
    g, m, known, d = (
        parameters.geometry,
        parameters.select_motor("A"),
        parameters.select_identified("A"),
        build_decoupler(parameters),
    )
    spring_A, spring_B = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    wound = (spring_elongation(spring_A, plan.tension_N) + spring_elongation(spring_B, plan.tension_N)) / g.r_m
    moved, speed, acceleration = _filter_four_lags(_sample_excitation(plan), lam_motor)
    theta_A = wound + moved
    q = np.array([equilibrium(d, angle, 0.0) for angle in theta_A[::10]])
    F = np.array([tendon_tension(spring_A, x) for x in g.r_m * theta_A[::10] - g.r_j * q])
    resistance = g.r_m * F + (m.c0 + m.c1 * g.r_m * F) * np.tanh(speed[::10] / m.omega_smooth)
    u = (known.T_m * acceleration[::10] + speed[::10]) / known.K_m + resistance / m.K_t
    counts_per_turn = parameters.sensors.joint_counts or _COUNTS_WHERE_EXACT
    q_counts = float(np.ptp(q)) * counts_per_turn / (2.0 * math.pi)
    u_peak, F_min = float(np.abs(u).max()), float(F.min())
    return PredictedMotion(q_counts, u_peak, F_min, _find_problem(q_counts, u_peak, F_min, m.u_max))


def _sample_excitation(plan: ActuatorIdentificationPlan) -> NDArray[np.float64]:
    excitation = plan.excitation()
    levels = np.array([1.0 if level == "+" else -1.0 for level in excitation.levels * excitation.periods])
    return excitation.amplitude_rad * np.repeat(levels, max(round(excitation.chip_s / T_s), 1))


def _filter_four_lags(
    u: NDArray[np.float64], lam: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the response of 1/(λ s + 1)^4 and its first two derivatives."""
    from scipy.signal import lfilter

    pole = math.exp(-T_s / lam)
    lags = [u]
    for _ in range(4):
        lags.append(lfilter([0.0, 1.0 - pole], [1.0, -pole], lags[-1]))
    return lags[4], (lags[3] - lags[4]) / lam, (lags[2] - 2.0 * lags[3] + lags[4]) / lam**2


def _find_problem(q_counts: float, u_peak: float, F_min: float, u_max: float) -> str:
    if F_min <= 0.0:
        return messages.excitation_slackens_tendon()
    if u_peak > u_max:
        return messages.excitation_saturates(u=u_peak, u_max=u_max)
    if q_counts < MIN_COUNTS:
        return messages.excitation_moves_too_little(counts=q_counts, minimum=MIN_COUNTS)
    return ""


# Motor and spring identification -------------------------------------------------------------------


LAGS_NEEDED = 3.0
"""Least duration of a voltage step, in units of T_m; a shorter one does not reach its steady speed."""

_TRIP_MARGIN_N = 2.0


@dataclass(frozen=True)
class Expectation:
    """An expected value with label and unit."""

    name: str
    label: str
    value: float
    unit: str


@dataclass(frozen=True)
class PredictedRun:
    """Expected values, and whether the run is feasible, with the reason in ``message``."""

    figures: tuple[Expectation, ...]
    is_feasible: bool
    message: str


def predict_motor(plan: MotorIdentificationPlan, parameters: PlantParameters) -> PredictedRun:
    """Predict speed, angle and duration of the voltage steps with the current motor model (equation 17)."""
    known = [parameters.select_identified(side) for side in SIDES]
    K_m, T_m = max(item.K_m for item in known), max(item.T_m for item in known)
    lengths = [_step_length(plan, K_m * u, T_m) for u in plan.voltages()]
    program = plan.program()
    speed = K_m * plan.u_high * -np.expm1(-lengths[-1] / T_m)
    turn = max(abs(step.theta_start) for step in program.steps)
    u_max = min(parameters.select_motor(side).u_max for side in SIDES)
    figures = (
        Expectation("omega_max", messages.fastest_speed(), float(speed), "rad/s"),
        Expectation("theta_max", messages.largest_rotation(), turn, "rad"),
        Expectation("u_peak_V", messages.largest_step(u_max=u_max), plan.u_high, "V"),
        Expectation("step_min_s", messages.shortest_step(), min(lengths), "s"),
    )
    problem = ""
    if plan.u_high >= u_max:
        problem = messages.steps_saturate(u_high=plan.u_high, u_max=u_max)
    elif min(lengths) < LAGS_NEEDED * T_m:
        problem = messages.step_too_short(u_high=plan.u_high, duration_s=min(lengths), lags=LAGS_NEEDED, T_m=T_m)
    message = messages.motors_will_turn(speed=speed, travel_rad=plan.travel_rad)
    return PredictedRun(figures, not problem, problem or message)


def predict_spring(plan: SpringIdentificationPlan, parameters: PlantParameters) -> PredictedRun:
    """Predict elongation, stiffness and rate of tension with the current spring model."""
    springs = [parameters.make_identified_spring(side) for side in SIDES]
    low = [spring_elongation(spring, plan.F_low) for spring in springs]
    high = [spring_elongation(spring, plan.F_high) for spring in springs]
    r_m = parameters.geometry.r_m
    S = stiffness(build_decoupler(parameters), *(x / r_m for x in high))
    rate = (plan.F_high - plan.F_low) / plan.sweep_s
    F_max = parameters.safety.F_max
    figures = (
        Expectation("x_min", messages.smallest_elongation(), min(low), "m"),
        Expectation("x_max", messages.largest_elongation(), max(high), "m"),
        Expectation("S_max", messages.largest_stiffness(), S, "N·m/rad"),
        Expectation("F_rate", messages.mean_rate_of_tension(), rate, "N/s"),
    )
    problem = ""
    if plan.F_high > F_max - _TRIP_MARGIN_N:
        problem = messages.sweep_close_to_trip(F_high=plan.F_high, margin_N=_TRIP_MARGIN_N, F_max=F_max)
    message = messages.tensions_will_sweep(F_low=plan.F_low, F_high=plan.F_high, cycles=plan.cycles)
    return PredictedRun(figures, not problem, problem or message)


def _step_length(plan: MotorIdentificationPlan, speed: float, T_m: float) -> float:
    """Return the time [s] until a motor of steady ``speed`` [rad/s] has turned by the travel, at most ``step_s``."""
    from scipy.optimize import brentq

    def compute_remaining_turn(t: float) -> float:
        return float(turn_from_rest(t, speed, T_m)) - plan.travel_rad

    return (
        plan.step_s
        if compute_remaining_turn(plan.step_s) <= 0.0
        else float(brentq(compute_remaining_turn, 0.0, plan.step_s))
    )
