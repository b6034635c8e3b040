"""Where an identification takes the joint and the tendons, told before it starts and from where the joint is. Pure.

The references go the way that the loop will play (``way``), the motors follow through the four lags of their loops, and
the joint rests where both tendons pull alike (equation 15). The force loop may trim motor A by ``force_hold.TRIM_MAX``:
what is announced holds for any trim.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import pid
from backend.control.decoupler import bounds_for, decoupler_for, equilibrium, stiffness
from backend.errors import OutOfRangeError
from backend.experiments.forecasts.timetable import Timetable, of_way
from backend.experiments.forecasts.way import Start, Way
from backend.experiments.plans.plan import IdentificationPlan, Plan
from backend.realtime.program import IDENTIFYING, Law
from plant.dynamics import tension
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]

STEP_TICKS = 10
"""Joint and tendons are computed every so many ticks: the motors' lags are ten times longer."""

ASIDE_RAD = 0.02
"""What the joint may swing beside its rest [rad]: dry friction, unlike motors, a swing that the start interrupts."""

ASIDE_N = 0.5
"""What the load cells may read beside the tension at rest [N]: noise, and the motors' dry friction."""

PATH_POINTS = 240


@dataclass(frozen=True)
class Forecast:
    """What runs in turn will do, the way there and back to pretension included.

    The joint stays within ``q_low`` .. ``q_high`` [rad], the tendons, once wound up, within ``F_low`` ..
    ``F_high`` [N]; ``q_path`` [rad] and ``S_path`` [N·m/rad] are where it is expected while the tendons are taut.
    ``duration_s`` is the whole, ``ends_s`` when each run is over. ``let_slack``: the tendons are let go on purpose.
    """

    duration_s: float
    ends_s: tuple[float, ...]
    q_start: float
    q_low: float
    q_high: float
    F_low: float
    F_high: float
    q_path: Array
    S_path: Array
    let_slack: bool

    @property
    def message(self) -> str:
        """Where the joint goes, in words."""
        at, low, high = (math.degrees(q) for q in (self.q_start, self.q_low, self.q_high))
        within = f"{math.floor(low)} to {math.ceil(high)}°".replace("-", "−")
        words = f"the joint is at {at:.0f}° and will move within {within}, then back to 0°".replace("-", "−")
        return words + ("; nothing holds it while the tendons are slack" if self.let_slack else "")

    def require_within_range(self, parameters: PlantParameters) -> None:
        """Raise OutOfRangeError where the joint or a tendon would leave its range."""
        bounds = bounds_for(parameters)
        remedy = "take a lower tension or a smaller amplitude"
        # A start beyond the range is no reason to stay there: only what the run itself does is refused.
        reach = max(self.q_high, -self.q_low, key=abs)
        if reach > bounds.q_trip and reach > abs(self.q_start) + ASIDE_RAD:
            raise OutOfRangeError("joint position on the way", reach, -bounds.q_trip, bounds.q_trip, "rad", remedy)
        if self.F_high > bounds.F_max:
            raise OutOfRangeError("tension on the way", self.F_high, None, bounds.F_max, "N", remedy)
        if self.F_low < bounds.F_slack and not self.let_slack:
            remedy = "take a higher tension or a smaller amplitude: a tendon would go slack"
            raise OutOfRangeError("tension on the way", self.F_low, bounds.F_slack, None, "N", remedy)


def forecast(
    plans: Sequence[IdentificationPlan], parameters: PlantParameters, start: Start, lam_motor: float
) -> Forecast:
    """Follow ``plans`` in turn from ``start``, with motor loops of ``lam_motor`` [s]."""
    way = Way(parameters, start)
    begins, ends = [], []
    for plan in plans:
        program = plan.program()
        way.to_where_it_can_start(program.law)
        begins.append(way.duration_s)
        way.play(program)
        ends.append(way.duration_s)
        way.home()
    asked_A, asked_B, trimmed = way.references()
    theta_A, theta_B = (
        _through_four_lags(asked, at, lam_motor)[::STEP_TICKS]
        for asked, at in zip((asked_A, asked_B), start.theta, strict=True)
    )
    d, g = decoupler_for(parameters), parameters.geometry
    q = np.array([equilibrium(d, A, B) for A, B in zip(theta_A, theta_B, strict=True)])
    spring_A, spring_B = parameters.identified_spring("A"), parameters.identified_spring("B")
    F_A = np.array([tension(spring_A, x) for x in g.r_m * theta_A - g.r_j * q])
    F_B = np.array([tension(spring_B, x) for x in g.r_m * theta_B + g.r_j * q])
    taut = np.minimum(F_A, F_B) > 0.0
    held = slice(round(begins[0] / T_s) // STEP_TICKS, None)
    let_slack = any(plan.program().law is Law.MOTOR_STEPS for plan in plans)
    q_expected = [start.q, *q[taut]]
    q_low, q_high = min(q_expected) - ASIDE_RAD, max(q_expected) + ASIDE_RAD
    for at in np.flatnonzero(trimmed[::STEP_TICKS]):
        q_low = min(q_low, equilibrium(d, theta_A[at] - pid.TRIM_MAX, theta_B[at]))
        q_high = max(q_high, equilibrium(d, theta_A[at] + pid.TRIM_MAX, theta_B[at]))
    shown = np.flatnonzero(taut)
    shown = shown[:: max(shown.size // PATH_POINTS, 1)]
    return Forecast(
        duration_s=way.duration_s,
        ends_s=tuple(ends),
        q_start=start.q,
        q_low=q_low,
        q_high=q_high,
        F_low=0.0 if let_slack else float(min(F_A[held].min(), F_B[held].min())) - ASIDE_N,
        F_high=float(max(F_A.max(), F_B.max())) + ASIDE_N,
        q_path=q[shown],
        S_path=np.array([stiffness(d, theta_A[i], theta_B[i]) for i in shown]),
        let_slack=let_slack,
    )


@dataclass(frozen=True)
class Expected:
    """How long a run takes [s] from its order to where its program begins, and from there to its end.

    An identification has its ``timetable``; the way there is as long as the actuator takes for it.
    """

    before_s: float
    program_s: float
    timetable: Timetable | None = None

    @property
    def duration_s(self) -> float:
        """The whole [s]."""
        return self.before_s + self.program_s


def expected(plan: Plan, parameters: PlantParameters, start: Start) -> Expected:
    """Tell how long a run takes from its order to its end, the way to where it can start included."""
    program = plan.program()
    way = Way(parameters, start)
    way.to_where_it_can_start(program.law)
    before_s = way.duration_s
    if program.law not in IDENTIFYING:
        return Expected(before_s, program.duration_s)
    way.play(program)
    told = of_way(way, program, parameters)
    return Expected(before_s, told.duration_s, told)


def _through_four_lags(asked: Array, at: float, lam: float) -> Array:
    """Response of a motor at rest in ``at`` [rad] to its reference: 1/(λ s + 1)^4."""
    from scipy.signal import lfilter

    pole = math.exp(-T_s / lam)
    moved = asked - at
    for _ in range(4):
        moved = lfilter([0.0, 1.0 - pole], [1.0, -pole], moved)
    return at + moved
