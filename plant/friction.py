"""Dry friction at the gearbox outlet, growing with the tendon load: smoothed Coulomb friction, or LuGre's, that sticks.

LuGre: Canudas de Wit, Olsson, Åström, Lischinsky, "A new model for control of systems with friction" (IEEE TAC 1995).
Surfaces meet as bristles of mean deflection z that bend before they slip:

    z' = ω − σ_0 |ω| z / g(ω),   τ = σ_0 z + σ_1 z',   g(ω) = F_c + (F_s − F_c) e^(−(ω/ω_s)²),   F_c = c0 + c1 r_m F

What is viscous is in the motor's B_m. Whether ``lugre`` is None is known to the compiler, so that the smoothed law runs
without the bristles.
"""

import math
from typing import NamedTuple

from plant.compiled import compiled

_NO_TURN = 1e-200
"""Turns [rad] below leave bristles as they are; the quotient of two such turns would not be a number."""


class LuGre(NamedTuple):
    """Bristles: ``sigma_0`` [N·m/rad] stiff, ``sigma_1`` [N·m·s/rad] damped; F_s/F_c [1]; Stribeck speed [rad/s].

    They turn with the outlet: z is in rad, σ_0 z in N·m.
    """

    sigma_0: float
    sigma_1: float
    stiction_ratio: float
    omega_s: float


class Friction(NamedTuple):
    """``c0`` [N·m] without load, ``c1`` [1] times the load torque r_m F, smoothed over ``omega_smooth`` [rad/s].

    With ``lugre`` it is not smoothed but sticks.
    """

    c0: float
    c1: float
    omega_smooth: float
    lugre: LuGre | None


@compiled
def coulomb_torque(friction: Friction, load: float) -> float:
    """F_c [N·m] under load torque r_m F [N·m]."""
    return friction.c0 + friction.c1 * load


@compiled
def friction_torque(friction: Friction, omega: float, load: float, z: float) -> float:
    """Torque [N·m] against the motion at outlet speed omega [rad/s], load torque r_m F [N·m], bristles at z [rad]."""
    return _torque(friction.lugre, friction.omega_smooth, omega, coulomb_torque(friction, load), z)


@compiled
def bristle_rate(friction: Friction, omega: float, load: float, z: float) -> float:
    """Z' [rad/s], 0 without bristles."""
    return _rate(friction.lugre, omega, coulomb_torque(friction, load), z)


@compiled
def bristle_after(
    friction: Friction, z: float, turned: float, duration_s: float, load: float, load_after: float
) -> float:
    """Deflection [rad] after a turn [rad] in ``duration_s`` [s], under a load [N·m] that grows to ``load_after``.

    Exact at constant speed and load. It is the turn that counts: where bristles only bend, they bend by it. They hold
    no more than F_s of the load at the end.
    """
    F_c = coulomb_torque(friction, load)
    return _after(friction.lugre, z, turned, duration_s, F_c, coulomb_torque(friction, load_after))


@compiled
def _level(lugre: LuGre, omega: float, F_c: float) -> float:
    """g(ω) [N·m]: friction at constant speed, Stribeck's curve."""
    return F_c * (1.0 + (lugre.stiction_ratio - 1.0) * math.exp(-((omega / lugre.omega_s) ** 2)))


@compiled
def _torque(lugre: LuGre | None, omega_smooth: float, omega: float, F_c: float, z: float) -> float:
    if lugre is None:
        return F_c * math.tanh(omega / omega_smooth)
    return lugre.sigma_0 * z + lugre.sigma_1 * _rate(lugre, omega, F_c, z)


@compiled
def _rate(lugre: LuGre | None, omega: float, F_c: float, z: float) -> float:
    if lugre is None:
        return 0.0
    return omega - lugre.sigma_0 * abs(omega) * z / _level(lugre, omega, F_c)


@compiled
def _after(lugre: LuGre | None, z: float, turned: float, duration_s: float, F_c: float, F_c_after: float) -> float:
    if lugre is None:
        return z
    after = z
    if abs(turned) > _NO_TURN:
        speed, way = turned / duration_s, math.copysign(1.0 / lugre.sigma_0, turned)
        level, level_after = _level(lugre, speed, F_c), _level(lugre, speed, F_c_after)
        slips = lugre.sigma_0 * abs(turned) / (0.5 * (level + level_after))
        forgets = math.expm1(-slips)
        # The second part: slipping bristles follow a level that changes; without it friction is off by per cents.
        after = z + (z - way * level) * forgets + way * (level_after - level) * (slips + forgets) / slips
    # A tendon that lets go relieves bristles faster than they slip; left bent they would drive the motor by σ_1 z'.
    most = lugre.stiction_ratio * F_c_after / lugre.sigma_0
    return min(max(after, -most), most)
