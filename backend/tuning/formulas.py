"""From a model and λ to gains: table 2, with erratum E1 corrected.

The closed loop of each formula is exact for its model: 1/(λ s + 1)^4 for the motor, 1/(λ s + 1)² for the outer loops.
"""

import math

from backend.control import pid


class TuningError(ValueError):
    """A tuning parameter or model is out of bounds; the message names quantity, value, bound and unit."""


def _positive(name: str, value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise TuningError(f"{name} = {value:g} {unit} must be finite and above 0 {unit}")


def motor_gains(K_m: float, T_m: float, lam: float) -> pid.IPDGains:
    """I-PD gains for K_m/(s (T_m s + 1)), 0 < λ < 4 T_m (table 2, first column). Raises TuningError."""
    _positive("K_m", K_m, "rad/(V·s)")
    _positive("T_m", T_m, "s")
    _positive("λ_motor", lam, "s")
    D = 4.0 * T_m - lam
    if D <= 0.0:
        raise TuningError(f"λ_motor = {lam:g} s must stay below 4 T_m = {4.0 * T_m:g} s")
    return pid.IPDGains(
        k_p=4.0 * T_m**2 / (K_m * lam**2 * D),
        k_i=T_m**2 / (K_m * lam**3 * D),
        k_d=(6.0 * T_m**2 - lam * D) / (K_m * lam * D),
        t_f=T_m * lam / D,
    )


def outer_gains(K: float, T: float, lam: float, b: float = 0.0) -> pid.IPGains:
    """I-P gains for K/(T s + 1); ``b`` in 0..1 weighs the reference in the proportional part.

    Up to λ = 2T the poles are both at −1/λ. Beyond, the formula would need a negative k_p: the loop becomes purely
    integral with k_i = 1/(2 K λ), continuous at λ = 2T, with the same sum of lags 2λ. Raises TuningError.
    """
    _positive("K", K, "1")
    _positive("T", T, "s")
    _positive("λ", lam, "s")
    if not 0.0 <= b <= 1.0:
        raise TuningError(f"b = {b:g} is outside 0 to 1")
    if lam > 2.0 * T:
        return pid.IPGains(k_p=0.0, k_i=1.0 / (2.0 * K * lam), k_r=0.0)
    k_p = (2.0 * T - lam) / (K * lam)
    return pid.IPGains(k_p=k_p, k_i=T / (K * lam**2), k_r=b * k_p)


def printed_outer_gains(K: float, T: float, lam: float) -> pid.IPGains:
    """I-P gains as table 2 prints them, k_p = 2/(K λ): wrong (erratum E1), for comparison only. Raises TuningError."""
    outer_gains(K, T, lam)  # refuses what has no gains
    return pid.IPGains(k_p=2.0 / (K * lam), k_i=T / (K * lam**2), k_r=0.0)


def position_loop_gain(K_q: float, r_m: float, r_j: float) -> float:
    """Return the static gain from q_c to q through the decoupler: 2 K_q r_j/r_m, about 1 (erratum E3)."""
    return 2.0 * K_q * r_j / r_m


def stiffness_loop_gain(K_S: float, slope: float) -> float:
    """Return the static gain from S_c to S through the decoupler: 2 K_S/(4 k2 r_j² r_m), about 1 (erratum E3).

    ``slope`` [N·m/rad per rad] is the decoupler's dS/dθ of one motor, 2 r_j² k2 r_m where springs are quadratic.
    """
    return K_S / slope
