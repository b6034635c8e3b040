"""Static decoupler between joint position and stiffness and motor positions.

Equations 18-21. Two equal quadratic springs have the paper's closed form. Any other pair has a table of its equilibria:
both tendons then carry the same tension F, so S = r_j² (F_A' + F_B') and the sum of the motor angles depend on F alone,
not on q, even if the springs differ. The elongations for that F differ: an offset that turns one motor forward and the
other back. The table is read with the same linear pieces in both directions, so a conversion there and back is exact.

Any other mechanism has such a table too: at rest its motor angles are g q_e + n p, with a preset p that sets the
stiffness (``plant.mechanisms``). The preset of two tendons is θ_A + θ_B.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import pid
from plant import (
    SIDES,
    Mechanism,
    MechanismParameters,
    MotorAxes,
    PlantParameters,
    Spring,
    SpringParameters,
    T_s,
    compiled,
    compute_rest,
    elastic_torques,
    motor_axes,
    spring_polynomial,
    spring_slope,
)

# Equilibrium table ---------------------------------------------------------------------------------
# Equilibria of a pair of springs over the sum of the motor angles: the numerical part of the decoupler.


PRESET, STIFFNESS, OFFSET, TENSION = 0, 1, 2, 3
"""Columns of the table: preset [rad], S [N·m/rad], the joint angle by which the motors must turn beyond q_e [rad], and
the tension of both tendons [N], NaN for another mechanism. With tendons the preset is θ_A + θ_B, and the offset
(x_A − x_B)/(2 r_j)."""

ROWS = 1025
"""Rows of the table: with a cubic version of the paper's spring the error of S is below 1e-6 N·m/rad."""

_POINTS = 4001

Array = NDArray[np.float64]


def build_equilibrium_table(spring_A: Spring, spring_B: Spring, r_m: float, r_j: float) -> Array:
    """Return the equilibrium table, shape (ROWS, 4), evenly spaced in θ_A + θ_B.

    It ranges from slack to the elongation at which the first of the springs becomes solid. At equilibrium F_A(x_A) =
    F_B(x_B) = F, S = r_j² (F_A'(x_A) + F_B'(x_B)) (equation 14, erratum E4), and θ_A + θ_B = (x_A + x_B)/r_m by
    equations 1 and 2, independent of q. The springs must stiffen (``plant.dynamics.require_stiffening``), so that S
    rises from row to row.
    """
    x_A, F_A, slope_A = _sample_spring(spring_A)
    x_B, F_B, slope_B = _sample_spring(spring_B)
    if F_A[-1] > F_B[-1]:
        table = build_equilibrium_table(spring_B, spring_A, r_m, r_j)
        table[:, OFFSET] *= -1.0
        return table
    x_B_at_F_A = np.interp(F_A, F_B, x_B)
    angle_sum = (x_A + x_B_at_F_A) / r_m
    S = r_j**2 * (slope_A + np.interp(F_A, F_B, slope_B))
    offset = (x_A - x_B_at_F_A) / (2.0 * r_j)
    even = np.linspace(angle_sum[0], angle_sum[-1], ROWS)
    return np.column_stack([even, *(np.interp(even, angle_sum, column) for column in (S, offset, F_A))])


def build_preset_table(mechanism: Mechanism, preset_min: float, preset_max: float) -> Array:
    """Return the equilibrium table of a mechanism, shape (ROWS, 4).

    It is evenly spaced in the preset [rad]. The stiffness at rest rises from ``preset_min`` to ``preset_max``, which
    the parameters have checked.
    """
    presets = np.linspace(preset_min, preset_max, ROWS)
    rest = np.array([compute_rest(mechanism, preset) for preset in presets])
    return np.column_stack([presets, rest[:, 1], -rest[:, 0], np.full(ROWS, np.nan)])


def _sample_spring(spring: Spring) -> tuple[Array, Array, Array]:
    """Return elongation, force and slope from slack to solid."""
    x = np.linspace(spring.x_slack, spring.x_solid, _POINTS)
    return x, np.array([spring_polynomial(spring, v) for v in x]), np.array([spring_slope(spring, v) for v in x])


# Decoupler -----------------------------------------------------------------------------------------


class Decoupler(NamedTuple):
    """Geometry and identified springs, or identified mechanism.

    ``r_m``, ``r_j`` [m]; ``k_0`` [N], ``k_1`` [N/m], ``k_2`` [N/m²] of two equal quadratic springs, for which ``table``
    is None. Any other pair has the ``table`` of ``build_equilibrium_table``, and k_0, k_1, k_2 are NaN. A ``mechanism``
    has the table of ``build_preset_table``, the directions ``axes`` of its motors, and r_m = r_j = 1: its motors bear
    torques, not forces.
    """

    r_m: float
    r_j: float
    k_0: float
    k_1: float
    k_2: float
    table: NDArray[np.float64] | None = None
    mechanism: Mechanism | None = None
    axes: MotorAxes | None = None


@compiled
def motor_positions(d: Decoupler, q_c: float, S_c: float) -> tuple[float, float]:
    """Return theta_A, theta_B [rad] for an equilibrium q_c [rad], S_c [N·m/rad].

    Equations 18, 19.
    """
    return _motor_positions(d, d.table, d.axes, q_c, S_c)


@compiled
def stiffness(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """Return S [N·m/rad] at equilibrium from the motor positions [rad].

    2 r_j² (k1 + k2 r_m (θ_A + θ_B)) for order 2 (equation 16).
    """
    return _stiffness(d, d.table, _preset(d.axes, theta_A, theta_B))


@compiled
def measured_stiffness(d: Decoupler, q: float, theta_A: float, theta_B: float) -> float:
    """Return S [N·m/rad] from the measured angles [rad].

    The stiffness of two tendons is that at equilibrium; other mechanisms change their stiffness when they deflect.
    """
    return _measured_stiffness(d, d.mechanism, q, theta_A, theta_B)


@compiled
def equilibrium(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """Return q_e [rad], the equilibrium without load (equation 15)."""
    return _equilibrium(d, d.table, d.axes, theta_A, theta_B)


@compiled
def rates(d: Decoupler, theta_A: float, theta_B: float, rate_A: float, rate_B: float) -> tuple[float, float]:
    """Return q_e' [rad/s] and S' [N·m/(rad·s)] for motor speeds [rad/s].

    ``theta_A``, ``theta_B`` [rad] are the motor positions.
    """
    S_rate, offset_rate = _slopes(d, d.table, _preset(d.axes, theta_A, theta_B))
    preset_rate = _preset(d.axes, rate_A, rate_B)
    return _joint_angle(d, d.axes, rate_A, rate_B) - offset_rate * preset_rate, S_rate * preset_rate


@compiled
def stiffness_slope(d: Decoupler, S: float) -> float:
    """Return dS/dp [N·m/rad per rad] of the preset at stiffness S [N·m/rad].

    2 r_j² k2 r_m at any S for order 2: the slope of one motor, since the preset of tendons is θ_A + θ_B.
    """
    preset, _ = _preset_at(d, d.table, S)
    S_rate, _ = _slopes(d, d.table, preset)
    return S_rate


@compiled
def stiffness_under(d: Decoupler, F: float) -> float:
    """Return S [N·m/rad] at equilibrium with tension F [N] in both tendons.

    2 r_j² √(k1² + 4 k2 (F − k0)) for order 2.
    """
    return _stiffness_under(d, d.table, F)


@compiled
def tension_under(d: Decoupler, S: float) -> float:
    """Return the tension [N] of both tendons at equilibrium with S [N·m/rad].

    This is the inverse of ``stiffness_under``.
    """
    return _tension_under(d, d.table, S)


# Each function below is compiled for a table and for None; for None the compiler drops the table's code.


@compiled
def _motor_positions(
    d: Decoupler, table: NDArray[np.float64] | None, axes: MotorAxes | None, q_c: float, S_c: float
) -> tuple[float, float]:
    preset, offset = _preset_at(d, table, S_c)
    if axes is None:
        difference, common = d.r_j / d.r_m * (q_c + offset), 0.5 * preset
        return difference + common, -difference + common
    q = q_c + offset
    return axes.g_A * q + axes.n_A * preset, axes.g_B * q + axes.n_B * preset


@compiled
def _preset(axes: MotorAxes | None, theta_A: float, theta_B: float) -> float:
    """Return the preset of motor angles, or its rate from their speeds."""
    if axes is None:
        return theta_A + theta_B
    return axes.w_A * theta_A + axes.w_B * theta_B


@compiled
def _joint_angle(d: Decoupler, axes: MotorAxes | None, theta_A: float, theta_B: float) -> float:
    """Return the joint angle of motor angles without the offset of unequal springs."""
    if axes is None:
        return d.r_m * (theta_A - theta_B) / (2.0 * d.r_j)
    return axes.v_A * theta_A + axes.v_B * theta_B


@compiled
def _equilibrium(
    d: Decoupler, table: NDArray[np.float64] | None, axes: MotorAxes | None, theta_A: float, theta_B: float
) -> float:
    q_e = _joint_angle(d, axes, theta_A, theta_B)
    return q_e if table is None else q_e - _offset(table, _preset(axes, theta_A, theta_B))


@compiled
def _measured_stiffness(d: Decoupler, mechanism: Mechanism | None, q: float, theta_A: float, theta_B: float) -> float:
    if mechanism is None:
        return stiffness(d, theta_A, theta_B)
    _, _, _, S = elastic_torques(mechanism, q, theta_A, theta_B)
    return S


@compiled
def _preset_at(d: Decoupler, table: NDArray[np.float64] | None, S: float) -> tuple[float, float]:
    """Return the preset at stiffness S, and the offset of unequal springs [rad]."""
    if table is None:
        return 2.0 * ((S - 2.0 * d.k_1 * d.r_j**2) / (4.0 * d.k_2 * d.r_j**2 * d.r_m)), 0.0
    low, share = _row_below(table, STIFFNESS, S)
    return _between(table, low, share, PRESET), _between(table, low, share, OFFSET)


@compiled
def _stiffness_under(d: Decoupler, table: NDArray[np.float64] | None, F: float) -> float:
    if table is None:
        return 2.0 * d.r_j**2 * math.sqrt(max(d.k_1**2 + 4.0 * d.k_2 * (F - d.k_0), 0.0))
    low, share = _row_below(table, TENSION, F)
    return _between(table, low, share, STIFFNESS)


@compiled
def _tension_under(d: Decoupler, table: NDArray[np.float64] | None, S: float) -> float:
    if table is None:
        return d.k_0 + ((0.5 * S / d.r_j**2) ** 2 - d.k_1**2) / (4.0 * d.k_2)
    low, share = _row_below(table, STIFFNESS, S)
    return _between(table, low, share, TENSION)


@compiled
def _stiffness(d: Decoupler, table: NDArray[np.float64] | None, preset: float) -> float:
    """Return S at a preset."""
    if table is None:
        return 2.0 * d.r_j**2 * (d.k_1 + d.k_2 * d.r_m * preset)
    low, share = _place(table, preset)
    return _between(table, low, share, STIFFNESS)


@compiled
def _offset(table: NDArray[np.float64], preset: float) -> float:
    """Return the joint angle by which the motors are turned beyond q_e at a preset."""
    low, share = _place(table, preset)
    return _between(table, low, share, OFFSET)


@compiled
def _slopes(d: Decoupler, table: NDArray[np.float64] | None, preset: float) -> tuple[float, float]:
    """Differentiate ``_stiffness`` and ``_offset`` with respect to the preset."""
    if table is None:
        return 2.0 * d.r_j**2 * d.k_2 * d.r_m, 0.0
    low, _ = _place(table, preset)
    width = table[low + 1, PRESET] - table[low, PRESET]
    S_rate = (table[low + 1, STIFFNESS] - table[low, STIFFNESS]) / width
    return S_rate, (table[low + 1, OFFSET] - table[low, OFFSET]) / width


@compiled
def _place(table: NDArray[np.float64], preset: float) -> tuple[int, float]:
    """Return the row below the preset and the fraction towards the next row.

    Rows are evenly spaced in the preset.
    """
    place = (preset - table[0, PRESET]) / (table[1, PRESET] - table[0, PRESET])
    low = int(min(max(place, 0.0), table.shape[0] - 2.0))
    return low, place - low


@compiled
def _row_below(table: NDArray[np.float64], column: int, value: float) -> tuple[int, float]:
    """Return the row below ``value`` in a rising column and the fraction to the next."""
    low, high = 0, table.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, column] <= value:
            low = middle
        else:
            high = middle
    return low, (value - table[low, column]) / (table[high, column] - table[low, column])


@compiled
def _between(table: NDArray[np.float64], low: int, share: float, column: int) -> float:
    """Return the value between two rows, extrapolated beyond the table."""
    here, there = float(table[low, column]), float(table[low + 1, column])
    return here + share * (there - here)


def build_decoupler(parameters: PlantParameters) -> Decoupler:
    """Return the decoupler of a parameter set's identified springs or mechanism."""
    if parameters.mechanism is not None:
        mechanism, table = _mechanism_and_table(parameters.mechanism)
        unknown = np.nan
        return Decoupler(1.0, 1.0, unknown, unknown, unknown, table, mechanism, motor_axes(mechanism))
    r_m, r_j = parameters.geometry.r_m, parameters.geometry.r_j
    A, B = parameters.select_identified_spring("A"), parameters.select_identified_spring("B")
    if A.k == B.k and len(A.k) == 3:
        return Decoupler(r_m, r_j, *A.k)
    return Decoupler(r_m=r_m, r_j=r_j, k_0=np.nan, k_1=np.nan, k_2=np.nan, table=_table(A, B, r_m, r_j))


@lru_cache(maxsize=8)
def _table(A: SpringParameters, B: SpringParameters, r_m: float, r_j: float) -> NDArray[np.float64]:
    # Tuning requests the decoupler at every λ that it tries; the table takes 20 ms.
    return build_equilibrium_table(A.make_spring(), B.make_spring(), r_m, r_j)


@lru_cache(maxsize=8)
def _mechanism_and_table(parameters: MechanismParameters) -> tuple[Mechanism, NDArray[np.float64]]:
    mechanism = parameters.make_mechanism()
    return mechanism, build_preset_table(mechanism, parameters.preset_min, parameters.preset_max)


# Envelope ------------------------------------------------------------------------------------------
# Permitted equilibria: both tendons taut, both below their limit, the joint inside its range.
#
# The outer loops request an equilibrium (q_c, S_c). Both tendons then carry the tension of S_c, and an external push
# adds half of F_A − F_B to one and subtracts it from the other. The push that the load cells measure therefore raises
# the floor of S_c and lowers its ceiling. If they cross, the ceiling takes precedence, because a slack tendon can be
# tensioned again whereas a solid spring cannot be relieved.


FILTER_TIME_S = 0.05
"""Low-pass on F_A − F_B [s]: far above the load cells' noise and delay, far below the 0.34 s of the motor loops."""


class Envelope(NamedTuple):
    """Limits of the equilibrium.

    ``F_floor``, ``F_ceiling`` [N]: tension of each tendon. ``q_max`` [rad]: equilibrium position to either side.
    ``S_floor``, ``S_ceiling`` [N·m/rad]: stiffness of another mechanism, in place of the tensions.
    """

    F_floor: float
    F_ceiling: float
    q_max: float
    S_floor: float = -math.inf
    S_ceiling: float = math.inf


class EnvelopeState(NamedTuple):
    """State of the envelope: low-pass filtered ``force_difference`` F_A − F_B [N]."""

    force_difference: float


class EnvelopeOutput(NamedTuple):
    """Permitted equilibrium ``q_c`` [rad], ``S_c`` [N·m/rad], and the active bounds."""

    q_c: float
    S_c: float
    at_floor: bool
    at_ceiling: bool
    at_range: bool


@compiled
def step_envelope(
    envelope: Envelope, d: Decoupler, state: EnvelopeState, q_c: float, S_c: float, F_A: float, F_B: float
) -> tuple[EnvelopeOutput, EnvelopeState]:
    """Limit the equilibrium that the outer loops request, by the tensions [N]."""
    force_difference, lowest, highest = _stiffness_limits(envelope, d, d.mechanism, state, F_A, F_B)
    S_limited = min(max(S_c, lowest), highest)
    q_limited = min(max(q_c, -envelope.q_max), envelope.q_max)
    return EnvelopeOutput(q_limited, S_limited, S_limited > S_c, S_limited < S_c, q_limited != q_c), EnvelopeState(
        force_difference
    )


@compiled
def _stiffness_limits(
    envelope: Envelope, d: Decoupler, mechanism: Mechanism | None, state: EnvelopeState, F_A: float, F_B: float
) -> tuple[float, float, float]:
    """Return the filtered F_A − F_B [N], and the limits of S_c [N·m/rad]."""
    if mechanism is not None:
        return 0.0, envelope.S_floor, envelope.S_ceiling
    force_difference = state.force_difference + (1.0 - math.exp(-T_s / FILTER_TIME_S)) * (
        F_A - F_B - state.force_difference
    )
    share = 0.5 * abs(force_difference)
    lowest = stiffness_under(d, envelope.F_floor + share)
    highest = stiffness_under(d, envelope.F_ceiling - share)
    return force_difference, lowest, highest


# Limits --------------------------------------------------------------------------------------------
# Limits that operator, controller and plant share, defined once for loop, API and page.


class Bounds(NamedTuple):
    """Bounds of one plant; those of the tendons are NaN for another mechanism.

    ``q_min`` to ``q_max`` [rad] and ``S_min`` to ``S_max`` [N·m/rad] for references; ``F_slack``, ``F_max`` [N] for the
    tendons; ``q_trip`` [rad]: trip of the joint position; ``u_max`` [V]; ``omega_max`` [rad/s] for the motor
    references; ``envelope`` for the equilibrium that the outer loops request.
    """

    q_min: float
    q_max: float
    S_min: float
    S_max: float
    F_slack: float
    F_max: float
    q_trip: float
    u_max: float
    omega_max: float
    envelope: Envelope


REFERENCE_MARGIN_RAD = 0.17
"""Distance of the joint references from the trip [rad]: 10 degrees, an overshoot of 5 % of the full range."""

STIFFNESS_RANGE = (8.0, 15.0)
"""Range of the stiffness references [N·m/rad] (method section 1)."""

OMEGA_MAX = 20.0
"""Fastest motor reference [rad/s]; 10 V without load give 28.6 rad/s (method section 5)."""

SPEED_SHARE = 0.7
"""Fastest motor reference of another mechanism, as a fraction of its motors' speed without load; 20 of 28.6 rad/s."""

F_SLACK = 1.0
"""Tension below which a tendon counts as slack [N]: above the load cells' noise, below any reference."""


F_FLOOR = 4.0
"""Least tension that the controller keeps in each tendon under a measured push [N]: twice the required minimum."""

CEILING_MARGIN_N = 2.0
"""Distance of each tendon's tension from the trip [N]; the highest reference, 15 N·m/rad, takes 46.3 N."""


def compute_bounds(parameters: PlantParameters) -> Bounds:
    """Return the bounds of a parameter set."""
    q_trip, F_max = parameters.geometry.q_max, parameters.safety.F_max
    q_max = q_trip - REFERENCE_MARGIN_RAD
    u_max = parameters.motor.u_max
    # Against a push the equilibrium is beyond the reference; when the push ends, the joint must not hit its stop.
    q_e_max = q_trip - 0.5 * REFERENCE_MARGIN_RAD
    if parameters.mechanism is not None:
        table = build_decoupler(parameters).table
        assert table is not None
        S_floor, S_ceiling = map(float, table[[0, -1], STIFFNESS])
        envelope = Envelope(math.nan, math.nan, q_e_max, S_floor, S_ceiling)
        omega_max = SPEED_SHARE * u_max * min(parameters.select_identified(side).K_m for side in SIDES)
        return Bounds(
            q_min=-q_max,
            q_max=q_max,
            S_min=parameters.mechanism.S_min,
            S_max=parameters.mechanism.S_max,
            F_slack=math.nan,
            F_max=math.nan,
            q_trip=q_trip,
            u_max=u_max,
            omega_max=omega_max,
            envelope=envelope,
        )
    envelope = Envelope(F_FLOOR, F_max - CEILING_MARGIN_N, q_e_max)
    return Bounds(-q_max, q_max, *STIFFNESS_RANGE, F_SLACK, F_max, q_trip, u_max, OMEGA_MAX, envelope)


# Scheduling ----------------------------------------------------------------------------------------
# Active gains of the bank: switching with hysteresis, or interpolation between the two nearest entries.


HYSTERESIS = 0.2
"""Distance beyond the boundary of two entries at which the bank switches [N·m/rad]."""


class Schedule(NamedTuple):
    """Bank in the form of the control step.

    ``entries`` (n, 7), sorted by nominal stiffness: S_nominal, then k_p, k_i, k_r of the position loop and of the
    stiffness loop. ``interpolate``: interpolation instead of switching.
    """

    entries: NDArray[np.float64]
    interpolate: bool


@compiled
def select_entry(schedule: Schedule, active: float, S: float) -> float:
    """Return the active entry for stiffness S [N·m/rad].

    An index, fractional with interpolation; ``active`` < 0 at the start.
    """
    nominal = schedule.entries[:, 0]
    last = nominal.shape[0] - 1
    if schedule.interpolate or active < 0.0 or active > last or active != math.floor(active):
        position = 0.0
        for lower in range(last):
            if nominal[lower] <= S:
                position = lower + min((S - nominal[lower]) / (nominal[lower + 1] - nominal[lower]), 1.0)
        return position if schedule.interpolate else math.floor(position + 0.5)
    entry = int(active)
    while entry < last and 0.5 * (nominal[entry] + nominal[entry + 1]) + HYSTERESIS < S:
        entry += 1
    while entry > 0 and 0.5 * (nominal[entry - 1] + nominal[entry]) - HYSTERESIS > S:
        entry -= 1
    return float(entry)


@compiled
def interpolate_gains(schedule: Schedule, active: float) -> tuple[pid.IPGains, pid.IPGains]:
    """Return the gains of the position and the stiffness loop at ``active``."""
    lower = int(active)
    upper = min(lower + 1, schedule.entries.shape[0] - 1)
    share = active - lower
    low, high = schedule.entries[lower], schedule.entries[upper]
    return (
        pid.IPGains(_mix(low[1], high[1], share), _mix(low[2], high[2], share), _mix(low[3], high[3], share)),
        pid.IPGains(_mix(low[4], high[4], share), _mix(low[5], high[5], share), _mix(low[6], high[6], share)),
    )


@compiled
def _mix(low: float, high: float, share: float) -> float:
    return (1.0 - share) * low + share * high
