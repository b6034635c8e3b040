"""Simulated actuators with two inputs and two outputs, by SciPy and by integration of the equations of motion."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import cont2discrete, dlsim, lfilter, tf2ss

Array = NDArray[np.float64]
Polynomial = list[float]
Random = np.random.Generator


def respond(numerator: Polynomial, denominator: Polynomial, u: Array, period_s: float) -> Array:
    """Return the response from rest to a held input; polynomials in descending powers of s."""
    system = cont2discrete(tf2ss(numerator, denominator), period_s)
    return np.asarray(dlsim(system, u)[1][:, 0])


def respond_matrix(
    numerators: list[list[Polynomial]], denominators: list[Polynomial], u: Array, period_s: float
) -> Array:
    """Return both outputs (n, 2) of rows with common denominators; a numerator of 0 has no effect."""
    return np.column_stack(
        [
            sum(respond(row[j], denominator, u[:, j], period_s) for j in (0, 1) if any(row[j]))
            for row, denominator in zip(numerators, denominators, strict=True)
        ]
    )


def make_noise(random: Random, count: int, std: float, pole: float) -> Array:
    """Return first-order autoregressive noise (n,) of this standard deviation."""
    settled = 2000
    white = random.standard_normal(count + settled) * np.sqrt(1.0 - pole**2)
    return np.asarray(std * lfilter([1.0], [1.0, -pole], white)[settled:])


def quantize(y: Array, count: Array | float) -> Array:
    return np.asarray(np.round(y / count) * count)


@dataclass(frozen=True)
class LeverActuator:
    """Lever arm with a movable pivot (AwAS-II, Jafari 2014) under a constant load.

    ``theta_1`` [rad] turns the lever, ``pivot`` [m] sets the stiffness: the torque is -K α² sin 2δ with δ = q - theta_1
    and α = (L / r) y / (L - y), see the published constants. Both motor loops are 1/(lam s + 1)^4.
    """

    pivot_m: float = 0.01
    load_Nm: float = -1.5
    lam_s: float = 0.0854
    J: float = 5.2e-4
    B: float = 0.046
    K: float = 10.0
    length_m: float = 0.05
    radius_m: float = 0.015

    def torque(self, delta: float, pivot_m: float) -> float:
        return -self.K * self._ratio(pivot_m) ** 2 * math.sin(2.0 * delta)

    def stiffness(self, delta: float, pivot_m: float) -> float:
        return 2.0 * self.K * self._ratio(pivot_m) ** 2 * math.cos(2.0 * delta)

    def _ratio(self, pivot_m: float) -> float:
        return self.length_m / self.radius_m * pivot_m / (self.length_m - pivot_m)

    def rest(self, theta_1: float, pivot_m: float) -> tuple[float, float]:
        """Return joint angle and stiffness at rest, by a search for the zero of the torque."""
        delta = float(brentq(lambda d: self.torque(d, pivot_m) + self.load_Nm, -0.7, 0.7, xtol=1e-14))
        return theta_1 + delta, self.stiffness(delta, pivot_m)

    def jacobian(self) -> Array:
        """Differentiate joint angle and stiffness at rest by both motors, (2, 2)."""
        columns = []
        for moved, step in ((0, 1e-5), (1, 1e-7)):
            up, down = (np.array([0.0, self.pivot_m]) for _ in range(2))
            up[moved] += step
            down[moved] -= step
            columns.append((np.array(self.rest(*up)) - np.array(self.rest(*down))) / (2.0 * step))
        return np.column_stack(columns)

    def closed_form(self) -> Array:
        """Return the static gains [[1, tau_2 / S], [0, sigma_2 + sigma_delta tau_2 / S]], (2, 2)."""
        delta, S = self.rest(0.0, self.pivot_m)
        alpha = self._ratio(self.pivot_m)
        slope = self.length_m / self.radius_m * self.length_m / (self.length_m - self.pivot_m) ** 2
        tau_2 = -2.0 * self.K * alpha * slope * np.sin(2.0 * delta)
        sigma_2 = 4.0 * self.K * alpha * slope * np.cos(2.0 * delta)
        sigma_delta = -4.0 * self.K * alpha**2 * np.sin(2.0 * delta)
        return np.array([[1.0, tau_2 / S], [0.0, sigma_2 + sigma_delta * tau_2 / S]])

    def simulate(self, references: Array, period_s: float) -> Array:
        """Return deviations of joint angle and stiffness (n, 2) for deviations of both references (n, 2).

        The motion is integrated by the method of Runge and Kutta with the full equations.
        """
        lags = np.asarray(np.poly1d([self.lam_s, 1.0]) ** 4).ravel().tolist()
        motors = np.column_stack([respond([1.0], lags, r, period_s) for r in references.T])
        q_0, S_0 = self.rest(0.0, self.pivot_m)

        def accelerate(theta_1: float, pivot_m: float, state: Array) -> Array:
            force = self.torque(state[0] - theta_1, pivot_m) + self.load_Nm - self.B * state[1]
            return np.array([state[1], force / self.J])

        state, found = np.array([q_0, 0.0]), np.empty_like(references)
        for k, (turned, shifted) in enumerate(motors):
            pivot_m = self.pivot_m + shifted
            found[k] = state[0] - q_0, self.stiffness(state[0] - turned, pivot_m) - S_0
            state = _integrate(partial(accelerate, turned, pivot_m), state, period_s)
        return found


def _integrate(slope: Callable[[Array], Array], state: Array, period_s: float) -> Array:
    first = slope(state)
    second = slope(state + 0.5 * period_s * first)
    third = slope(state + 0.5 * period_s * second)
    fourth = slope(state + period_s * third)
    return np.asarray(state + period_s / 6.0 * (first + 2.0 * second + 2.0 * third + fourth))
