"""Metrics of the compliance experiment: does the joint feel as stiff as it was told to be? Pure.

The force that the hand exerts is F_ext = F_A − F_B (equation 22, a reaction); geometry and the commanded stiffness
expect F_expected = −S_ref q/r_j (equation 25).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.metrics import NoSamplesError, figure, rms
from plant.interface import T_s

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

REST_S = 1.0
"""Stretch before the first push that forces are counted from [s]."""

MAX_DELAY_S = 0.040
"""Longest delay of the load cells that is looked for [s]; the paper's have 10-15 ms."""

BOUND_ALIGNED_N = 0.5

LEAST_PUSH_N = 5.0 * BOUND_ALIGNED_N
"""Strongest push below which the forces agree to the bound whatever the stiffness: nothing is measured then [N]."""


@dataclass(frozen=True)
class ComplianceFigures:
    """Figures of one compliance run, over the time from the first push on.

    ``reasons`` tells by name which could not be measured and why.
    """

    rmse_raw_N: float = figure("N", "RMSE, raw", "F_A − F_B against −S_ref q/r_j as measured; the paper: 2.239 N")
    rmse_aligned_N: float | None = figure(
        "N", "RMSE, aligned", "the same without sensor delay, each minus its mean before"
    )
    rmse_estimated_N: float | None = figure(
        "N", "RMSE, estimated", "F_ext_hat against F_B − F_A, aligned, each minus its mean before"
    )
    delay_s: float | None = figure("s", "Sensor delay", "of the load cells behind the encoder, that which aligns best")
    stiffness_felt: float | None = figure("N·m/rad", "Stiffness felt", "slope of −r_j (F_A − F_B) over q, aligned")
    largest_push_N: float = figure("N", "Strongest push", "largest |F_A − F_B|, aligned")
    deviation_S: float = figure("N·m/rad", "Stiffness deviation", "max |S − S_ref| while pushed")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")
    reasons: Mapping[str, str] = field(default_factory=dict)


def compliance_figures(columns: Columns, r_j: float, first_push_s: float) -> ComplianceFigures:
    """Compare measured and expected force. ``columns`` holds q, S, S_ref, F_A, F_B, u_A, u_B, one sample a millisecond.

    With F_ext_hat in it, the estimate is compared with what the load cells say. ``r_j`` [m] is the joint pulley's
    radius. Raises NoSamplesError when the run ended before its first push, or when there was no rest before it to
    count from.
    """
    pushed = round(first_push_s / T_s)
    if pushed < round(REST_S / T_s):
        raise NoSamplesError(
            f"the first push begins at {first_push_s:g} s: forces are counted from {REST_S:g} s of rest before it"
        )
    longest = round(MAX_DELAY_S / T_s)
    if columns["q"].size < pushed + 10 * longest:
        raise NoSamplesError(f"the run ended before the pushes began at {first_push_s:g} s")
    measured = columns["F_A"] - columns["F_B"]
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = slice(pushed - round(REST_S / T_s), pushed)
    F = measured - measured[rest].mean()
    F_expected = expected - expected[rest].mean()
    errors = [rms(F[pushed + delay :] - F_expected[pushed : F.size - delay]) for delay in range(longest + 1)]
    delay = int(np.argmin(errors))
    felt, q = F[pushed + delay :], columns["q"][pushed : F.size - delay]
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    largest_push_N = float(np.abs(felt).max())
    reasons = _why_not(largest_push_N, delay == longest)
    estimated = _estimated(columns, rest, slice(pushed, F.size - delay))
    if estimated is None:
        reasons["rmse_estimated_N"] = "this recording has no estimate of the outside force"
    return ComplianceFigures(
        rmse_raw_N=rms(measured[pushed:] - expected[pushed:]),
        rmse_aligned_N=None if "rmse_aligned_N" in reasons else errors[delay],
        rmse_estimated_N=None if estimated is None or "rmse_estimated_N" in reasons else rms(estimated + felt),
        delay_s=None if "delay_s" in reasons else delay * T_s,
        stiffness_felt=None if "stiffness_felt" in reasons else _slope(q, -r_j * felt),
        largest_push_N=largest_push_N,
        deviation_S=float(np.abs(columns["S"] - columns["S_ref"])[pushed:].max()),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
        reasons=reasons,
    )


def _estimated(columns: Columns, rest: slice, pushed: slice) -> Array | None:
    """Outside force [N] while pushed, from its mean at rest; None where it was not recorded as a number throughout."""
    F_ext_hat = columns.get("F_ext_hat")
    if F_ext_hat is None or not np.all(np.isfinite(F_ext_hat[rest.start :])):
        return None
    estimated: Array = F_ext_hat[pushed] - F_ext_hat[rest].mean()
    return estimated


def _why_not(largest_push_N: float, delay_at_end: bool) -> dict[str, str]:
    if largest_push_N < LEAST_PUSH_N:
        reason = (
            f"the strongest push was {largest_push_N:.1f} N: below {LEAST_PUSH_N:g} N any stiffness keeps the bound of "
            f"{BOUND_ALIGNED_N:g} N"
        )
        return dict.fromkeys(("rmse_aligned_N", "rmse_estimated_N", "delay_s", "stiffness_felt"), reason)
    if delay_at_end:
        return {"delay_s": f"the forces agree best at {1000 * MAX_DELAY_S:.0f} ms, where the search ends"}
    return {}


def _slope(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    spread = float(x @ x)
    return float(x @ y) / spread if spread > 0.0 else float("nan")
