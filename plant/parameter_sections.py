"""The sections of a parameter file: frozen dataclasses, each entry with its unit and its bounds."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from plant.friction import Friction, LuGre
from plant.motor import Motor
from plant.parameter_entries import alternative, quantity, zero_if_left_out
from plant.spring import Spring, polynomial_spring
from plant.spring_table import tabulated_spring

Side = Literal["A", "B"]
SIDES: tuple[Side, ...] = get_args(Side)


@dataclass(frozen=True)
class Geometry:
    """Reel and pulley radii, joint inertia and damping, joint range (±)."""

    r_m: float = quantity("m", 1e-4, 1.0)
    r_j: float = quantity("m", 1e-3, 1.0)
    J_j: float = quantity("kg·m²", 1e-7, 10.0)
    B_j: float = quantity("N·m·s/rad", 0.0, 100.0)
    q_max: float = quantity("rad", 0.01, 10.0)


@dataclass(frozen=True)
class SpringParameters:
    """Force over elongation, as a polynomial (lowest power first) or as measured points, and where it turns solid."""

    k: tuple[float, ...] = alternative("N/m^i")
    points: tuple[tuple[float, ...], ...] = alternative("m, N", width=2)
    x_solid: float = quantity("m", 1e-3, 1.0)
    k_solid: float = quantity("N/m", 1.0, 1e6)

    def spring(self, factor: float = 1.0) -> Spring:
        """Spring with its force multiplied by ``factor``. Raises ValueError."""
        if self.points:
            x, F = np.array(self.points).T
            return tabulated_spring(x, factor * F, self.x_solid, self.k_solid)
        return polynomial_spring(tuple(factor * k for k in self.k), self.x_solid, self.k_solid)


@dataclass(frozen=True)
class MotorParameters:
    """Geared motor seen at the gearbox outlet (equations 8, 9, 17), Coulomb friction, output range (±).

    The last four make friction stick (LuGre); without ``sigma_0``, or where it is 0, it is smoothed.
    """

    K_m: float = quantity("rad/(V·s)", 1e-3, 1e3)
    T_m: float = quantity("s", 1e-3, 10.0)
    K_t: float = quantity("N·m/V", 1e-4, 1e3)
    tau_e: float = quantity("s", 1e-3, 0.1)
    c0: float = quantity("N·m", 0.0, 10.0)
    c1: float = quantity("1", 0.0, 0.9)
    omega_smooth: float = quantity("rad/s", 1e-3, 1.0)
    u_max: float = quantity("V", 0.1, 10.0)
    sigma_0: float = zero_if_left_out("N·m/rad", 0.0, 1e5)
    sigma_1: float = zero_if_left_out("N·m·s/rad", 0.0, 1e3)
    stiction_ratio: float = zero_if_left_out("1", 1.0, 10.0)
    omega_s: float = zero_if_left_out("rad/s", 1e-4, 10.0)

    def motor(self, factor: float = 1.0) -> Motor:
        """Motor with its torque constant multiplied by ``factor``."""
        B_m = self.K_t / self.K_m
        lugre = LuGre(self.sigma_0, self.sigma_1, self.stiction_ratio, self.omega_s) if self.sigma_0 > 0.0 else None
        friction = Friction(self.c0, self.c1, self.omega_smooth, lugre)
        return Motor(B_m * self.T_m, B_m, factor * self.K_t, self.tau_e, friction)

    @property
    def stiction(self) -> float:
        """Torque that breaks it away, per Coulomb friction [1]; 1 where friction is smoothed."""
        return self.stiction_ratio if self.sigma_0 > 0.0 else 1.0


@dataclass(frozen=True)
class Identified:
    """What the controller knows of the motor (equation 17) and of the spring: results of their identification."""

    K_m: float = quantity("rad/(V·s)", 1e-3, 1e3)
    T_m: float = quantity("s", 1e-3, 10.0)
    k: tuple[float, ...] = alternative("N/m^i")
    points: tuple[tuple[float, ...], ...] = alternative("m, N", width=2)


@dataclass(frozen=True)
class Asymmetry:
    """Factors on the force of each spring and on the torque constant of each motor."""

    spring_A: float = quantity("1", 0.5, 2.0)
    spring_B: float = quantity("1", 0.5, 2.0)
    motor_A: float = quantity("1", 0.5, 2.0)
    motor_B: float = quantity("1", 0.5, 2.0)


@dataclass(frozen=True)
class Sensors:
    """Encoder counts per revolution (0: exact), load cell delay and noise, converter resolution (0: exact)."""

    joint_counts: float = quantity("1/rev", 0.0, 1e7)
    motor_counts: float = quantity("1/rev", 0.0, 1e7)
    force_delay: float = quantity("s", 0.0, 0.060)
    force_noise: float = quantity("N", 0.0, 10.0)
    converter_bits: float = quantity("1", 0.0, 24.0)

    @property
    def joint_step(self) -> float:
        """One count of the joint encoder [rad], 0 where it is exact."""
        return 2.0 * math.pi / self.joint_counts if self.joint_counts else 0.0

    @property
    def motor_step(self) -> float:
        """One count of a motor encoder [rad], 0 where it is exact."""
        return 2.0 * math.pi / self.motor_counts if self.motor_counts else 0.0


@dataclass(frozen=True)
class Safety:
    """Bound of the independent safety module on tendon force; the joint's is ``Geometry.q_max``."""

    F_max: float = quantity("N", 1.0, 1e4)


SECTIONS: dict[str, type] = {
    "geometry": Geometry,
    "spring": SpringParameters,
    "motor": MotorParameters,
    "identified": Identified,
    "asymmetry": Asymmetry,
    "sensors": Sensors,
    "safety": Safety,
}
SIDED: dict[str, type] = {
    f"{name}_{side}": SECTIONS[name] for name in ("spring", "motor", "identified") for side in SIDES
}
