"""What an identification of motors or springs will do to the rig, told before it starts. Pure."""

from dataclasses import dataclass

import numpy as np

from backend.control.decoupler import decoupler_for, stiffness
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.identification.motor import turn_from_rest
from plant.dynamics import elongation
from plant.parameters import SIDES, PlantParameters

LAGS_NEEDED = 3.0
"""A step shorter than this many T_m has not shown its steady speed."""

_TRIP_MARGIN_N = 2.0


@dataclass(frozen=True)
class Expectation:
    """One expected number with its label and unit."""

    name: str
    label: str
    value: float
    unit: str


@dataclass(frozen=True)
class PredictedRun:
    """Expected numbers, and whether the run is worth starting; ``message`` says why."""

    figures: tuple[Expectation, ...]
    good: bool
    message: str


def predict_motor(plan: MotorIdentificationPlan, parameters: PlantParameters) -> PredictedRun:
    """Step the motors known so far (equation 17): speed, turn, and how long each step lasts."""
    known = [parameters.identified_of(side) for side in SIDES]
    K_m, T_m = max(item.K_m for item in known), max(item.T_m for item in known)
    lengths = [_step_length(plan, K_m * u, T_m) for u in plan.voltages()]
    program = plan.program()
    speed = K_m * plan.u_high * -np.expm1(-lengths[-1] / T_m)
    turn = max(abs(step.theta_start) for step in program.steps)
    u_max = min(parameters.motor_of(side).u_max for side in SIDES)
    figures = (
        Expectation("omega_max", "Fastest speed", float(speed), "rad/s"),
        Expectation("theta_max", "Largest turn, slack side", turn, "rad"),
        Expectation("u_peak_V", f"Largest step, of {u_max:g} V", plan.u_high, "V"),
        Expectation("step_min_s", "Shortest step", min(lengths), "s"),
    )
    problem = ""
    if plan.u_high >= u_max:
        problem = f"steps to {plan.u_high:g} V saturate at {u_max:g} V: lower u_high"
    elif min(lengths) < LAGS_NEEDED * T_m:
        problem = (
            f"the step to {plan.u_high:g} V ends after {min(lengths):.2f} s, before its speed is steady "
            f"({LAGS_NEEDED:g} T_m = {LAGS_NEEDED * T_m:.2f} s): lower u_high, or raise travel_rad and step_s"
        )
    message = f"both motors will reach {speed:.4g} rad/s with slack tendons, turning by {plan.travel_rad:g} rad a step"
    return PredictedRun(figures, not problem, problem or message)


def predict_spring(plan: SpringIdentificationPlan, parameters: PlantParameters) -> PredictedRun:
    """Wind the springs known so far: elongation, stiffness on the way, and what the load cells' delay will show."""
    springs = [parameters.identified_spring(side) for side in SIDES]
    low = [elongation(spring, plan.F_low) for spring in springs]
    high = [elongation(spring, plan.F_high) for spring in springs]
    r_m = parameters.geometry.r_m
    S = stiffness(decoupler_for(parameters), *(x / r_m for x in high))
    rate = (plan.F_high - plan.F_low) / plan.sweep_s
    F_max = parameters.safety.F_max
    figures = (
        Expectation("x_min", "Smallest elongation", min(low), "m"),
        Expectation("x_max", "Largest elongation", max(high), "m"),
        Expectation("S_max", "Largest stiffness", S, "N·m/rad"),
        Expectation("F_rate", "Mean rate of tension", rate, "N/s"),
    )
    problem = ""
    if plan.F_high > F_max - _TRIP_MARGIN_N:
        problem = f"F_high = {plan.F_high:g} N is within {_TRIP_MARGIN_N:g} N of the trip at {F_max:g} N: lower it"
    message = f"both tendons will go from {plan.F_low:g} to {plan.F_high:g} N and back, {plan.cycles} times"
    return PredictedRun(figures, not problem, problem or message)


def _step_length(plan: MotorIdentificationPlan, speed: float, T_m: float) -> float:
    """Time [s] in which a motor of steady ``speed`` [rad/s] turns by the plan's travel, at most ``step_s``."""
    from scipy.optimize import brentq

    def left(t: float) -> float:
        return float(turn_from_rest(t, speed, T_m)) - plan.travel_rad

    return plan.step_s if left(plan.step_s) <= 0.0 else float(brentq(left, 0.0, plan.step_s))
