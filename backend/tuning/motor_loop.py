"""The motor loop as it runs: sampled each period, with the motor's electrical lag (erratum E5).

On the bare K_m/(s (T_m s + 1)) of table 2 the loop looks more robust than it is, the more so the smaller λ is.
"""

from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from backend.control import pid
from backend.tuning.formulas import TuningError, motor_gains
from backend.tuning.models import MotorModel
from backend.tuning.remembered import remembered
from backend.tuning.robustness import M_S_MAX, Robustness, peak, robustness_of
from plant.interface import T_s

if TYPE_CHECKING:
    import control

LAM_MOTOR_MIN = 0.05
"""Least λ offered [s]. The loop then needs a 25th of its gain to be stable; with less λ it needs more, and a voltage
limit takes gain away."""

LAM_MOTOR_MAX = 0.2
"""Largest λ offered [s]; for the paper's motor M_s falls with λ up to here (erratum E5)."""

_OMEGA = np.geomspace(1e-2, np.pi / T_s, 900)
_Z = np.exp(1j * _OMEGA * T_s)
_LAMBDAS = 25


def motor_robustness(motor: MotorModel, gains: pid.IPDGains) -> Robustness:
    """Robustness of the sampled loop of an unloaded motor; tendons change M_s by less than half a per cent."""
    import control

    loop = _sampled(motor) * _law(gains)
    return robustness_of(control.tf2ss(loop), loop(_Z), _OMEGA)


def motor_range(motor: MotorModel) -> tuple[float, float]:
    """Smallest and largest λ [s] offered: M_s stays at or below M_S_MAX, λ well below 4 T_m. Raises TuningError."""
    low, _, high = _range(motor)
    return low, high


def common_range(motors: Iterable[MotorModel]) -> tuple[float, float]:
    """Smallest and largest λ [s] offered for all of these motors. Raises TuningError."""
    ranges = [motor_range(motor) for motor in motors]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low > high:
        raise TuningError(
            f"no λ_motor is robust for both motors: one needs {low:.3g} s at least, one {high:.3g} s at most"
        )
    return low, high


def motor_lambda(motor: MotorModel, M_s: float) -> float:
    """λ [s] for a wanted M_s where it falls with λ, within what is offered. Raises TuningError with the span."""
    from scipy.optimize import brentq

    low, end, _ = _range(motor)
    highest, lowest = _peak(motor, low), _peak(motor, end)
    if not lowest <= M_s <= highest:
        raise TuningError(
            f"M_s = {M_s:g} is out of reach of the motor loop: choose {lowest:.3f} (λ = {end:.3g} s) "
            f"to {highest:.3f} (λ = {low:.3g} s)"
        )
    return float(brentq(lambda lam: _peak(motor, lam) - M_s, low, end, xtol=1e-7))


def _range(motor: MotorModel) -> tuple[float, float, float]:
    """Least λ [s] offered, the one to which M_s falls from there, and the largest."""
    low, end, high = remembered(("motor range", motor), 3, lambda: _computed_range(motor))
    return low, end, high


def _computed_range(motor: MotorModel) -> tuple[float, float, float]:
    from scipy.optimize import brentq

    high = min(LAM_MOTOR_MAX, 3.8 * motor.T_m)
    if high <= LAM_MOTOR_MIN:
        raise TuningError(
            f"T_m = {motor.T_m:g} s leaves no λ_motor from {LAM_MOTOR_MIN:g} s on: it must stay below 4 T_m"
        )
    lambdas = np.geomspace(LAM_MOTOR_MIN, high, _LAMBDAS)
    peaks = np.array([_peak(motor, lam) for lam in lambdas])
    fragile = np.flatnonzero(peaks > M_S_MAX)
    if fragile.size == _LAMBDAS or (fragile.size and fragile[-1] == _LAMBDAS - 1):
        raise TuningError(f"no λ_motor up to {high:g} s keeps M_s of the motor loop at or below {M_S_MAX:g}")
    first = int(fragile[-1]) + 1 if fragile.size else 0
    low = float(lambdas[0])
    if fragile.size:
        low = float(brentq(lambda lam: _peak(motor, lam) - M_S_MAX, lambdas[first - 1], lambdas[first], xtol=1e-7))
    rising = np.flatnonzero(np.diff(peaks[first:]) > 0.0)
    end = float(lambdas[first + rising[0]]) if rising.size else high
    return low, end, high


def _peak(motor: MotorModel, lam: float) -> float:
    return peak((_sampled(motor) * _law(motor_gains(motor.K_m, motor.T_m, lam)))(_Z))


@cache
def _sampled(motor: MotorModel) -> "control.TransferFunction":
    """From the voltage, held over a period, to the position at its end."""
    import control

    s = control.tf("s")
    process = motor.K_m / (s * (motor.T_m * s + 1.0) * (motor.tau_e * s + 1.0))
    return control.sample_system(process, T_s, "zoh")


def _law(gains: pid.IPDGains) -> "control.TransferFunction":
    """From the position to the voltage, sign turned: ``i_pd.step`` as a difference equation."""
    import control

    kept = float(np.exp(-T_s / gains.t_f))
    proportional = (1.0 - kept) * gains.k_p * np.array([1.0, -1.0, 0.0])
    integral = (1.0 - kept) * T_s * gains.k_i * np.array([0.0, 1.0, 0.0])
    derivative = kept * gains.k_d / gains.t_f * np.array([1.0, -2.0, 1.0])
    return control.tf(proportional + integral + derivative, np.polymul([1.0, -kept], [1.0, -1.0]), T_s)
