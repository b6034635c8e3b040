"""What the excitation of an actuator identification shows of the rig, told before it starts (method section 4). Pure.

How far the joint goes on the whole way is ``forecast``.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control.decoupler import decoupler_for, equilibrium
from backend.experiments.plans.plan import ActuatorIdentificationPlan
from backend.identification.validation import MIN_COUNTS
from plant.dynamics import elongation, tension
from plant.interface import T_s
from plant.parameters import PlantParameters

_COUNTS_WHERE_EXACT = 4000
"""Joint counts per turn of the paper's encoder, for parameter sets with ideal sensors."""


@dataclass(frozen=True)
class PredictedMotion:
    """Joint motion by the excitation, peak to peak in counts, largest voltage, least tension; any ``problem``."""

    q_counts: float
    u_peak_V: float
    F_min_N: float
    problem: str

    @property
    def good(self) -> bool:
        """Whether the run is worth starting: motion enough, nothing slack, nothing saturated."""
        return not self.problem

    @property
    def message(self) -> str:
        """The problem, or what to expect."""
        return self.problem or f"the excitation alone moves it by {self.q_counts:.0f} encoder counts, peak to peak"


def predict(plan: ActuatorIdentificationPlan, parameters: PlantParameters, lam_motor: float) -> PredictedMotion:
    """Send the excitation through the inner loop's four lags of ``lam_motor`` [s] and take the joint at equilibrium.

    With theta_B = 0 the joint rests where both tendons pull alike: for like springs q = r_m theta_A / (2 r_j) (equation
    15). The voltage is what moves the motor (equation 17) against tendon and friction.
    """
    g, m, known, d = (
        parameters.geometry,
        parameters.motor_of("A"),
        parameters.identified_of("A"),
        decoupler_for(parameters),
    )
    spring_A, spring_B = parameters.identified_spring("A"), parameters.identified_spring("B")
    wound = (elongation(spring_A, plan.tension_N) + elongation(spring_B, plan.tension_N)) / g.r_m
    moved, speed, acceleration = _through_four_lags(_excitation(plan), lam_motor)
    theta_A = wound + moved
    q = np.array([equilibrium(d, angle, 0.0) for angle in theta_A[::10]])
    F = np.array([tension(spring_A, x) for x in g.r_m * theta_A[::10] - g.r_j * q])
    resistance = g.r_m * F + (m.c0 + m.c1 * g.r_m * F) * np.tanh(speed[::10] / m.omega_smooth)
    u = (known.T_m * acceleration[::10] + speed[::10]) / known.K_m + resistance / m.K_t
    counts_per_turn = parameters.sensors.joint_counts or _COUNTS_WHERE_EXACT
    q_counts = float(np.ptp(q)) * counts_per_turn / (2.0 * math.pi)
    u_peak, F_min = float(np.abs(u).max()), float(F.min())
    return PredictedMotion(q_counts, u_peak, F_min, _problem(q_counts, u_peak, F_min, m.u_max))


def _excitation(plan: ActuatorIdentificationPlan) -> NDArray[np.float64]:
    excitation = plan.excitation()
    levels = np.array([1.0 if level == "+" else -1.0 for level in excitation.levels * excitation.periods])
    return excitation.amplitude_rad * np.repeat(levels, max(round(excitation.chip_s / T_s), 1))


def _through_four_lags(
    u: NDArray[np.float64], lam: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Response of 1/(λ s + 1)^4 with its first two derivatives, from the differences between the lags."""
    from scipy.signal import lfilter

    pole = math.exp(-T_s / lam)
    lags = [u]
    for _ in range(4):
        lags.append(lfilter([0.0, 1.0 - pole], [1.0, -pole], lags[-1]))
    return lags[4], (lags[3] - lags[4]) / lam, (lags[2] - 2.0 * lags[3] + lags[4]) / lam**2


def _problem(q_counts: float, u_peak: float, F_min: float, u_max: float) -> str:
    if F_min <= 0.0:
        return "a tendon would go slack: use a smaller amplitude or a higher tension"
    if u_peak > u_max:
        return f"the motors would need {u_peak:.1f} V of {u_max:g} V: use a smaller amplitude or a longer chip"
    if q_counts < MIN_COUNTS:
        return (
            f"not enough motion: {q_counts:.1f} encoder counts expected, {MIN_COUNTS:g} needed: "
            "use a longer chip or a larger amplitude"
        )
    return ""
