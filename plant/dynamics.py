"""Ordinary differential equation of the plant and its Runge-Kutta integration."""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from plant import messages
from plant.compilation import compiled
from plant.interface import NO_LOAD, PlantError, ShaftLoad
from plant.mechanisms import Mechanism, elastic_torques

# Friction ------------------------------------------------------------------------------------------
# Friction at the gearbox output, growing with the tendon load: smoothed Coulomb friction, or the LuGre model with
# static friction.
#
# LuGre: Canudas de Wit, Olsson, Åström, Lischinsky, "A new model for control of systems with friction" (IEEE TAC 1995).
# The surfaces touch through bristles of mean deflection z that bend before they slip:
#
#     z' = ω − σ_0 |ω| z / g(ω),   τ = σ_0 z + σ_1 z',   g(ω) = F_c + (F_s − F_c) e^(−(ω/ω_s)²),   F_c = c0 + c1 r_m F
#
# Viscous friction is in the motor's B_m. Whether ``lugre`` is None is known at compile time, so smoothed friction runs
# without bristles.


_NO_TURN = 1e-200
"""Rotation [rad] below which bristles do not change; the quotient of two such rotations would be NaN."""


class LuGre(NamedTuple):
    """Bristles: ``sigma_0`` [N·m/rad], ``sigma_1`` [N·m·s/rad], F_s/F_c, ``omega_s``.

    ``stiction_ratio`` is F_s/F_c [1], ``omega_s`` the Stribeck speed [rad/s]. The bristles turn with the outlet: z is
    in rad, σ_0 z in N·m.
    """

    sigma_0: float
    sigma_1: float
    stiction_ratio: float
    omega_s: float


class Friction(NamedTuple):
    """Coulomb friction c0 + c1 r_m F: ``c0`` [N·m], ``c1`` [1] times the load torque.

    Without ``lugre`` it is smoothed over ``omega_smooth`` [rad/s], with it the LuGre model applies.
    """

    c0: float
    c1: float
    omega_smooth: float
    lugre: LuGre | None


@compiled
def coulomb_torque(friction: Friction, load: float) -> float:
    """Return F_c [N·m] at load torque [N·m], r_m F of a tendon, of either sign."""
    return friction.c0 + friction.c1 * abs(load)


@compiled
def friction_torque(friction: Friction, omega: float, load: float, z: float) -> float:
    """Return the friction torque [N·m] at outlet speed omega [rad/s].

    ``load`` [N·m] is the load torque r_m F, ``z`` [rad] the bristle deflection.
    """
    return _torque(friction.lugre, friction.omega_smooth, omega, coulomb_torque(friction, load), z)


@compiled
def bristle_rate(friction: Friction, omega: float, load: float, z: float) -> float:
    """Return z' [rad/s], 0 without bristles."""
    return _rate(friction.lugre, omega, coulomb_torque(friction, load), z)


@compiled
def bristle_after(
    friction: Friction, z: float, turned: float, duration_s: float, load: float, load_after: float
) -> float:
    """Return the deflection [rad] after the outlet has turned by ``turned`` [rad].

    The rotation takes ``duration_s`` [s], under a load that changes from ``load`` to ``load_after`` [N·m]. The result
    is exact at constant speed and load. It is computed from the rotation, not from speed and time: bristles that do not
    slip bend by exactly the rotation. They hold at most F_s of the load at the end.
    """
    F_c = coulomb_torque(friction, load)
    return _advance_bristles(
        lugre=friction.lugre,
        z=z,
        travel=turned,
        duration_s=duration_s,
        F_c=F_c,
        F_c_after=coulomb_torque(friction, load_after),
    )


@compiled
def _level(lugre: LuGre, omega: float, F_c: float) -> float:
    """Return g(ω) [N·m]: friction at constant speed, the Stribeck curve."""
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
def _advance_bristles(
    lugre: LuGre | None, z: float, travel: float, duration_s: float, F_c: float, F_c_after: float
) -> float:
    if lugre is None:
        return z
    z_next = z
    if abs(travel) > _NO_TURN:
        speed, deflection = travel / duration_s, math.copysign(1.0 / lugre.sigma_0, travel)
        level, level_after = _level(lugre, speed, F_c), _level(lugre, speed, F_c_after)
        slip = lugre.sigma_0 * abs(travel) / (0.5 * (level + level_after))
        decay = math.expm1(-slip)
        # The second term: slipping bristles follow a changing level; without it friction is off by some percent.
        z_next = z + (z - deflection * level) * decay + deflection * (level_after - level) * (slip + decay) / slip
    # A tendon that goes slack unloads bristles faster than they slip; left bent they would drive the motor by σ_1 z'.
    z_max = lugre.stiction_ratio * F_c_after / lugre.sigma_0
    return min(max(z_next, -z_max), z_max)


# Motor ---------------------------------------------------------------------------------------------
# The geared DC motor: equations 6-9 at the gearbox output.


class Motor(NamedTuple):
    """Constants of a motor at the gearbox output.

    ``J_m`` [kg·m²], ``B_m`` [N·m·s/rad] including the back-EMF, ``K_t`` [N·m/V] = μ N K_mu / R, ``tau_e`` [s] = L/R,
    and the friction.
    """

    J_m: float
    B_m: float
    K_t: float
    tau_e: float
    friction: Friction


@compiled
def motor_torque_rate(motor: Motor, tau: float, u: float) -> float:
    """Return d(tau_m)/dt [N·m/s]: tau_m = K_t/(L/R s + 1) u (equations 8, 9)."""
    return (motor.K_t * u - tau) / motor.tau_e


@compiled
def motor_acceleration(motor: Motor, omega: float, tau: float, load: float, z: float) -> float:
    """Return theta'' [rad/s²]: J_m theta'' + B_m theta' + r_m F + friction = tau_m.

    Equations 6 and 7; ``z`` [rad] is the bristle deflection.
    """
    return (tau - motor.B_m * omega - load - friction_torque(motor.friction, omega, load, z)) / motor.J_m


# Root ----------------------------------------------------------------------------------------------
# Roots of rising functions without SciPy: the control step must not import it, and importing it takes longer than most
# runs.


def find_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of a function that rises between low and high, by bisection.

    The root is exact to the last bit.
    """
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if function(middle) < 0.0 else (low, middle)
    return high


# Spring --------------------------------------------------------------------------------------------
# The non-linear tendon spring: tension over elongation (equations 3-4), zero when slack, steep when solid.
#
# A spring is a polynomial or, if ``pieces`` is given, a table joined by cubics. Whether ``pieces`` is None is known at
# compile time, so the polynomial runs without the search in the table.


class Spring(NamedTuple):
    """Spring for the compiled functions.

    ``polynomial_spring`` and ``tabulated_spring`` create it. ``k`` [N/m^i]: coefficients, lowest power first.
    ``pieces`` (n, 5): start of each piece [m], then its polynomial in the elongation from there. ``x_slack`` [m]: root
    of zero force. ``x_solid`` [m]: elongation at which the coils touch, with force ``F_solid`` [N]; ``k_solid`` [N/m]
    is the slope beyond.
    """

    k: tuple[float, ...]
    pieces: NDArray[np.float64] | None
    x_slack: float
    x_solid: float
    F_solid: float
    k_solid: float


@compiled
def _derivative(k: tuple[float, ...], s: float, order: int) -> float:
    """Return the derivative of order 0 to 2 of a polynomial at s, by Horner's rule."""
    total = 0.0
    for power in range(len(k) - 1, order - 1, -1):
        factor = 1.0
        for down in range(order):
            factor *= power - down
        total = total * s + factor * k[power]
    return total


@compiled
def _curve(k: tuple[float, ...], pieces: NDArray[np.float64] | None, x: float, order: int) -> float:
    if pieces is None:
        return _derivative(k, x, order)
    low, high = 0, pieces.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if x < pieces[middle, 0]:
            high = middle
        else:
            low = middle
    piece = (pieces[low, 1], pieces[low, 2], pieces[low, 3], pieces[low, 4])
    return _derivative(piece, x - pieces[low, 0], order)


@compiled
def spring_polynomial(spring: Spring, x: float) -> float:
    """Return the force [N] of the fitted curve at elongation x [m], taut or not."""
    return _curve(spring.k, spring.pieces, x, 0)


@compiled
def spring_slope(spring: Spring, x: float) -> float:
    """Return F'(x) [N/m] of the fitted curve at elongation x [m], taut or not."""
    return _curve(spring.k, spring.pieces, x, 1)


@compiled
def spring_curvature(spring: Spring, x: float) -> float:
    """Return F''(x) [N/m²] of the fitted curve at elongation x [m], taut or not."""
    return _curve(spring.k, spring.pieces, x, 2)


@compiled
def tendon_tension(spring: Spring, x: float) -> float:
    """Return the tension [N] at elongation x [m]: zero when slack, steep when solid."""
    if x <= spring.x_slack:
        return 0.0
    if x > spring.x_solid:
        return spring.F_solid + spring.k_solid * (x - spring.x_solid)
    return spring_polynomial(spring, x)


@compiled
def tendon_tension_slope(spring: Spring, x: float) -> float:
    """Return dF/dx [N/m] of ``tendon_tension``: 0 when slack, ``k_solid`` when solid."""
    if x <= spring.x_slack:
        return 0.0
    if x > spring.x_solid:
        return spring.k_solid
    return spring_slope(spring, x)


NO_SPRING = Spring(k=(0.0,), pieces=None, x_slack=math.inf, x_solid=math.inf, F_solid=0.0, k_solid=0.0)
"""Spring of an actuator without tendons: slack at any elongation."""


def polynomial_spring(coefficients: tuple[float, ...], x_solid: float, k_solid: float) -> Spring:
    """Return the spring F(x) = k0 + k1 x + k2 x² + … (lowest power first).

    Raises ValueError if the curve has no zero-force root below ``x_solid`` or does not rise from there to ``x_solid``.
    """
    curve = np.polynomial.Polynomial(coefficients)
    x = np.linspace(-x_solid, x_solid, 4001)
    negative = np.flatnonzero(curve(x) <= 0.0)
    if negative.size == 0 or negative[-1] == x.size - 1:
        raise ValueError(messages.spring_without_root(x_solid=x_solid))
    below = int(negative[-1])
    x_slack = find_root(lambda value: float(curve(value)), float(x[below]), float(x[below + 1]))
    falling = np.flatnonzero(curve.deriv()(x[below + 1 :]) <= 0.0)
    if falling.size:
        at = x[below + 1 + int(falling[0])]
        raise ValueError(messages.spring_falls(x_solid=x_solid, x=at))
    k = tuple(float(coefficient) for coefficient in coefficients)
    return Spring(k=k, pieces=None, x_slack=x_slack, x_solid=x_solid, F_solid=float(curve(x_solid)), k_solid=k_solid)


def require_stiffening(spring: Spring) -> None:
    """Raise ValueError unless F' rises from slack to solid.

    Otherwise tension could not set the stiffness.
    """
    x = np.linspace(spring.x_slack, spring.x_solid, 2001)[1:-1]
    slopes = np.array([spring_slope(spring, value) for value in x])
    flat = np.flatnonzero(np.diff(slopes) <= 1e-9 * slopes[-1])
    if flat.size:
        raise ValueError(messages.spring_does_not_stiffen(x=x[flat[0]]))


def spring_elongation(spring: Spring, F: float) -> float:
    """Return the elongation [m] of the taut spring at F [N].

    Raises ValueError unless 0 < F <= force at ``x_solid``.
    """
    if not 0.0 < F <= spring.F_solid:
        raise ValueError(messages.tension_outside_spring(F=F, F_solid=spring.F_solid))
    return find_root(lambda x: spring_polynomial(spring, x) - F, spring.x_slack, spring.x_solid)


# Joint ---------------------------------------------------------------------------------------------
# The joint: tendon elongations, torque balance, stiffness (equations 1, 2, 5, 13-16).


class Joint(NamedTuple):
    """Joint: ``r_m``, ``r_j`` [m], ``J_j`` [kg·m²], ``B_j`` [N·m·s/rad]."""

    r_m: float
    r_j: float
    J_j: float
    B_j: float


@compiled
def elongation_A(joint: Joint, theta_A: float, q: float) -> float:
    """Return the elongation of spring A [m] (equation 1)."""
    return joint.r_m * theta_A - joint.r_j * q


@compiled
def elongation_B(joint: Joint, theta_B: float, q: float) -> float:
    """Return the elongation of spring B [m] (equation 2)."""
    return joint.r_m * theta_B + joint.r_j * q


@compiled
def joint_acceleration(joint: Joint, q_dot: float, tau: float, tau_ext: float) -> float:
    """Return q'' [rad/s²]: J_j q'' + B_j q' = tau + tau_ext.

    Equations 5 and 13; the elastic torque tau [N·m] of two tendons is r_j (F_A − F_B).
    """
    return (tau + tau_ext - joint.B_j * q_dot) / joint.J_j


@compiled
def joint_stiffness(joint: Joint, spring_A: Spring, spring_B: Spring, x_A: float, x_B: float) -> float:
    """Return S = −∂φ/∂q = r_j² (F_A'(x_A) + F_B'(x_B)) [N·m/rad] (equation 14).

    The result is exact off equilibrium too (erratum E4).
    """
    return joint.r_j**2 * (tendon_tension_slope(spring_A, x_A) + tendon_tension_slope(spring_B, x_B))


# Obstacle ------------------------------------------------------------------------------------------
# An obstacle for the joint, which deforms like a spring with damping and never pulls.
#
# The contact law is that of Hunt and Crossley (1975), linear in the depth: F = k δ (1 + c δ') while δ > 0, and never
# below 0. Its force starts and ends at 0, whereas a spring with a parallel damper jumps at first contact and pulls at
# the end. The rebound speed w after an approach at speed v follows from c v − ln(1 + c v) = −c w − ln(1 − c w),
# independent of stiffness and mass.


class Obstacle(NamedTuple):
    """Obstacle that blocks the joint beyond ``q_wall`` [rad].

    It blocks positions above (``side`` 1) or below (-1); ``side`` 0 is no obstacle. ``k_wall`` [N/m] is its stiffness
    and ``c_wall`` [s/m] its damping, both tangential at r_j.
    """

    side: float
    q_wall: float
    k_wall: float
    c_wall: float


NO_OBSTACLE = Obstacle(0.0, 0.0, 0.0, 0.0)


@runtime_checkable
class Obstructed(Protocol):
    """Plant with an obstacle that can be set (simulated plants)."""

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Set the obstacle from the next period on, None removes it.

        Raises PlantError for an impossible obstacle.
        """
        ...


K_LEAST = 100.0
"""Least stiffness of an obstacle [N/m]; a softer one would not stop the joint within its range."""

STEP_ANGLE = 0.15
"""Largest phase angle [rad] per integration step of the undamped joint at the obstacle: 21 steps in each contact."""


@compiled
def contact_force(obstacle: Obstacle, joint: Joint, q: float, q_dot: float) -> float:
    """Return the force [N] of the obstacle on the joint at r_j, positive to +q.

    0 without contact and without an obstacle.
    """
    depth = joint.r_j * obstacle.side * (q - obstacle.q_wall)
    if depth <= 0.0 or obstacle.side == 0.0:
        return 0.0
    pressed = obstacle.k_wall * depth * (1.0 + obstacle.c_wall * joint.r_j * obstacle.side * q_dot)
    return -obstacle.side * max(pressed, 0.0)


@compiled
def add_wall_torque(obstacle: Obstacle, joint: Joint, q: float, q_dot: float, tau_ext: float) -> float:
    """Return the external joint torque [N·m] plus the obstacle's.

    Without an obstacle the value is unchanged to the last bit.
    """
    if obstacle.side == 0.0:
        return tau_ext
    return tau_ext + joint.r_j * contact_force(obstacle, joint, q, q_dot)


def largest_wall_stiffness(joint: Joint, step_s: float) -> float:
    """Return the obstacle stiffness [N/m] with a phase of STEP_ANGLE per step.

    The joint with m = J_j/r_j² oscillates at √(k/m). The Runge-Kutta steps are stable up to an angle of 2.8, and their
    error is below a thousandth of the peak up to STEP_ANGLE.
    """
    return joint.J_j / joint.r_j**2 * (STEP_ANGLE / step_s) ** 2


def largest_wall_damping(joint: Joint, F_max: float, step_s: float) -> float:
    """Return the largest useful damping [s/m] of an obstacle: c F_max = m/h.

    It brakes the joint, pressed by F_max [N], with a time constant of one step.
    """
    return joint.J_j / (joint.r_j**2 * step_s * F_max)


def require_possible_wall(obstacle: Obstacle, joint: Joint, F_max: float, q_max: float, step_s: float) -> None:
    """Raise PlantError for an obstacle out of range or too stiff to integrate.

    The integration has steps of ``step_s`` [s].
    """
    if obstacle.side not in (-1.0, 1.0):
        raise PlantError(messages.obstacle_side_invalid(side=obstacle.side))
    k_max, c_max = largest_wall_stiffness(joint, step_s), largest_wall_damping(joint, F_max, step_s)
    if not -q_max <= obstacle.q_wall <= q_max:
        raise PlantError(messages.obstacle_angle_out_of_range(q_wall=obstacle.q_wall, minimum=-q_max, maximum=q_max))
    if not K_LEAST <= obstacle.k_wall <= k_max:
        raise PlantError(
            messages.obstacle_stiffness_out_of_range(k_wall=obstacle.k_wall, minimum=K_LEAST, maximum=k_max)
        )
    if not 0.0 <= obstacle.c_wall <= c_max:
        raise PlantError(messages.obstacle_damping_out_of_range(c_wall=obstacle.c_wall, minimum=0.0, maximum=c_max))


def require_free(obstacle: Obstacle, q: float) -> None:
    """Raise PlantError if the joint, at q [rad], is inside the obstacle.

    The obstacle would eject it.
    """
    if not obstacle.side * (q - obstacle.q_wall) <= 0.0:
        raise PlantError(messages.joint_inside_obstacle(q=q, q_wall=obstacle.q_wall, side=obstacle.side))


# Dynamics ------------------------------------------------------------------------------------------


SUBSTEPS = 4
"""Runge-Kutta steps per sampling period: 0.25 ms against a fastest time constant of 2 ms."""

_SUBNORMAL = 1e-200


class Dynamics(NamedTuple):
    """Constants of the plant for the compiled functions.

    Two tendons with ``spring_A`` and ``spring_B`` connect motors and joint, or else ``mechanism``. Whether it is None
    is known at compile time.
    """

    joint: Joint
    motor_A: Motor
    motor_B: Motor
    spring_A: Spring
    spring_B: Spring
    mechanism: Mechanism | None = None


class PlantState(NamedTuple):
    """State of the plant: joint, both motors at their outlets, and friction bristles.

    ``q`` [rad] and ``q_dot`` [rad/s] of the joint; angle ``theta`` [rad], speed ``omega`` [rad/s] and torque ``tau``
    [N·m] of each motor. ``z_A``, ``z_B`` [rad]: deflection of the friction's bristles, 0 and unused if friction is
    smoothed.
    """

    q: float
    q_dot: float
    theta_A: float
    omega_A: float
    tau_A: float
    theta_B: float
    omega_B: float
    tau_B: float
    z_A: float = 0.0
    z_B: float = 0.0


def smooth_friction(plant: Dynamics) -> Dynamics:
    """Return the plant with smoothed Coulomb friction in place of static friction."""
    A, B = (motor._replace(friction=motor.friction._replace(lugre=None)) for motor in (plant.motor_A, plant.motor_B))
    return plant._replace(motor_A=A, motor_B=B)


AT_REST = PlantState(q=0.0, q_dot=0.0, theta_A=0.0, omega_A=0.0, tau_A=0.0, theta_B=0.0, omega_B=0.0, tau_B=0.0)


@compiled
def compute_elastic_torques(plant: Dynamics, q: float, theta_A: float, theta_B: float) -> tuple[float, float, float]:
    """Return the elastic joint torque and the loads of motors A and B [N·m].

    Angles in rad. The load of a tendon is r_m F (equation 6).
    """
    return _elastic_torques(plant, plant.mechanism, q, theta_A, theta_B)


@compiled
def _elastic_torques(
    plant: Dynamics, mechanism: Mechanism | None, q: float, theta_A: float, theta_B: float
) -> tuple[float, float, float]:
    if mechanism is None:
        F_A = tendon_tension(plant.spring_A, elongation_A(plant.joint, theta_A, q))
        F_B = tendon_tension(plant.spring_B, elongation_B(plant.joint, theta_B, q))
        return plant.joint.r_j * (F_A - F_B), plant.joint.r_m * F_A, plant.joint.r_m * F_B
    tau, load_A, load_B, _ = elastic_torques(mechanism, q, theta_A, theta_B)
    return tau, load_A, load_B


@compiled
def compute_stiffness(plant: Dynamics, q: float, theta_A: float, theta_B: float) -> float:
    """Return S = −∂τ/∂q [N·m/rad] at joint and motor angles [rad]."""
    return _compute_stiffness(plant, plant.mechanism, q, theta_A, theta_B)


@compiled
def _compute_stiffness(plant: Dynamics, mechanism: Mechanism | None, q: float, theta_A: float, theta_B: float) -> float:
    if mechanism is None:
        x_A, x_B = elongation_A(plant.joint, theta_A, q), elongation_B(plant.joint, theta_B, q)
        return joint_stiffness(plant.joint, plant.spring_A, plant.spring_B, x_A, x_B)
    _, _, _, S = elastic_torques(mechanism, q, theta_A, theta_B)
    return S


@compiled
def state_derivative(
    plant: Dynamics,
    x: PlantState,
    u_A: float,
    u_B: float,
    tau_ext: float,
    load: ShaftLoad,
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """Return dx/dt (equations 1-13).

    Inputs are motor voltages [V], external joint torque [N·m], shaft loads [N·m] and an obstacle.
    """
    tau, load_A, load_B = compute_elastic_torques(plant, x.q, x.theta_A, x.theta_B)
    load_A, load_B = load_A + load.load_A, load_B + load.load_B
    return PlantState(
        q=x.q_dot,
        q_dot=joint_acceleration(
            plant.joint, x.q_dot, tau, add_wall_torque(obstacle, plant.joint, x.q, x.q_dot, tau_ext)
        ),
        theta_A=x.omega_A,
        omega_A=motor_acceleration(plant.motor_A, x.omega_A, x.tau_A, load_A, x.z_A),
        tau_A=motor_torque_rate(plant.motor_A, x.tau_A, u_A),
        theta_B=x.omega_B,
        omega_B=motor_acceleration(plant.motor_B, x.omega_B, x.tau_B, load_B, x.z_B),
        tau_B=motor_torque_rate(plant.motor_B, x.tau_B, u_B),
        z_A=bristle_rate(plant.motor_A.friction, x.omega_A, load_A, x.z_A),
        z_B=bristle_rate(plant.motor_B.friction, x.omega_B, load_B, x.z_B),
    )


@compiled
def _axpy(h: float, d: PlantState, x: PlantState) -> PlantState:
    return PlantState(
        q=x.q + h * d.q,
        q_dot=x.q_dot + h * d.q_dot,
        theta_A=x.theta_A + h * d.theta_A,
        omega_A=x.omega_A + h * d.omega_A,
        tau_A=x.tau_A + h * d.tau_A,
        theta_B=x.theta_B + h * d.theta_B,
        omega_B=x.omega_B + h * d.omega_B,
        tau_B=x.tau_B + h * d.tau_B,
        z_A=x.z_A,
        z_B=x.z_B,
    )


@compiled
def _loads(plant: Dynamics, x: PlantState, load: ShaftLoad) -> tuple[float, float]:
    """Return the load torques [N·m] at both outlets."""
    _, load_A, load_B = compute_elastic_torques(plant, x.q, x.theta_A, x.theta_B)
    return load_A + load.load_A, load_B + load.load_B


@compiled
def _bent(plant: Dynamics, x: PlantState, y: PlantState, h: float, load: ShaftLoad) -> PlantState:
    """Return state y, reached from x in h [s], with its bristles advanced.

    On a fast motor bristles slip within less than a Runge-Kutta step; the exact solution is used for them.
    """
    A, B = plant.motor_A.friction, plant.motor_B.friction
    if A.lugre is None and B.lugre is None:
        return y
    before_A, before_B = _loads(plant, x, load)
    load_A, load_B = _loads(plant, y, load)
    return PlantState(
        q=y.q,
        q_dot=y.q_dot,
        theta_A=y.theta_A,
        omega_A=y.omega_A,
        tau_A=y.tau_A,
        theta_B=y.theta_B,
        omega_B=y.omega_B,
        tau_B=y.tau_B,
        z_A=bristle_after(
            friction=A, z=x.z_A, turned=y.theta_A - x.theta_A, duration_s=h, load=before_A, load_after=load_A
        ),
        z_B=bristle_after(
            friction=B, z=x.z_B, turned=y.theta_B - x.theta_B, duration_s=h, load=before_B, load_after=load_B
        ),
    )


@compiled
def _flush(value: float) -> float:
    # A state that decays to a subnormal number makes each step many times slower.
    return value if abs(value) > _SUBNORMAL else 0.0


@compiled
def advance_state(
    plant: Dynamics,
    x: PlantState,
    u_A: float,
    u_B: float,
    tau_ext: float,
    duration_s: float,
    substeps: int,
    load: ShaftLoad = NO_LOAD,
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """Return the state after ``duration_s`` [s] under constant inputs.

    Integrates with ``substeps`` classical Runge-Kutta steps.
    """
    h = duration_s / substeps
    for _ in range(substeps):
        d1 = state_derivative(plant=plant, x=x, u_A=u_A, u_B=u_B, tau_ext=tau_ext, load=load, obstacle=obstacle)
        x2 = _bent(plant, x, _axpy(0.5 * h, d1, x), 0.5 * h, load)
        d2 = state_derivative(plant=plant, x=x2, u_A=u_A, u_B=u_B, tau_ext=tau_ext, load=load, obstacle=obstacle)
        x3 = _bent(plant, x, _axpy(0.5 * h, d2, x), 0.5 * h, load)
        d3 = state_derivative(plant=plant, x=x3, u_A=u_A, u_B=u_B, tau_ext=tau_ext, load=load, obstacle=obstacle)
        x4 = _bent(plant, x, _axpy(h, d3, x), h, load)
        d4 = state_derivative(plant=plant, x=x4, u_A=u_A, u_B=u_B, tau_ext=tau_ext, load=load, obstacle=obstacle)
        end = _axpy(h / 6.0, d1, _axpy(h / 3.0, d2, _axpy(h / 3.0, d3, _axpy(h / 6.0, d4, x))))
        x = _bent(plant, x, end, h, load)
    return PlantState(
        q=x.q,
        q_dot=_flush(x.q_dot),
        theta_A=x.theta_A,
        omega_A=_flush(x.omega_A),
        tau_A=_flush(x.tau_A),
        theta_B=x.theta_B,
        omega_B=_flush(x.omega_B),
        tau_B=_flush(x.tau_B),
        z_A=x.z_A,
        z_B=x.z_B,
    )


# Spring table --------------------------------------------------------------------------------------
# A spring from measured points, joined by a curve that rises wherever the points do.


Array = NDArray[np.float64]


def tabulated_spring(x: Array, F: Array, x_solid: float, k_solid: float) -> Spring:
    """Return a spring through measured points (elongation [m], force [N]).

    Interpolates by monotone cubics (Fritsch-Carlson). The first point is at zero force; ``x_solid``, at which the coils
    touch, lies inside the table. Raises ValueError for points that do not rise.
    """
    if x.ndim != 1 or x.shape != F.shape or x.size < 3:
        raise ValueError(messages.spring_table_of_wrong_shape(x=x.shape, F=F.shape))
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(F))):
        raise ValueError(messages.spring_table_not_finite())
    wrong = np.flatnonzero((np.diff(x) <= 0.0) | (np.diff(F) <= 0.0))
    if wrong.size:
        row = int(wrong[0])
        raise ValueError(messages.spring_table_falls(row=row + 1, x=x[row], F=F[row]))
    if abs(F[0]) > 1e-9:
        raise ValueError(messages.spring_table_not_from_zero(F=F[0]))
    if not x[0] < x_solid <= x[-1]:
        raise ValueError(messages.x_solid_outside_table(x_solid=x_solid, lowest=x[0], highest=x[-1]))
    h, secant = np.diff(x), np.diff(F) / np.diff(x)
    at_node = _monotone_slopes(h, secant)
    left, right = at_node[:-1], at_node[1:]
    pieces = np.column_stack(
        (x[:-1], F[:-1], left, (3.0 * secant - 2.0 * left - right) / h, (left + right - 2.0 * secant) / h**2)
    )
    no_polynomial = (0.0,)
    spring = Spring(k=no_polynomial, pieces=pieces, x_slack=float(x[0]), x_solid=x_solid, F_solid=0.0, k_solid=k_solid)
    return spring._replace(F_solid=spring_polynomial(spring, x_solid))


def _monotone_slopes(h: Array, secant: Array) -> Array:
    """Return the slopes at the nodes of a table.

    They are weighted harmonic means inside, and follow the limited three-point formula at the ends.
    """
    w_left, w_right = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    inner = (w_left + w_right) / (w_left / secant[:-1] + w_right / secant[1:])

    def end(h0: float, h1: float, s0: float, s1: float) -> float:
        return min(max(((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1), 0.0), 3.0 * s0)

    first = end(h[0], h[1], secant[0], secant[1])
    last = end(h[-1], h[-2], secant[-1], secant[-2])
    return np.concatenate(([first], inner, [last]))
