"""Simulated hand at a simulated rig."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from plant.dynamics import PlantState
from plant.interface import MotorCommand

_JOINT_N_PER_RAD, _JOINT_N_S_PER_RAD, _JOINT_MAX_N = 60.0, 0.3, 60.0
_MOTOR_V_PER_RAD, _MOTOR_V_S_PER_RAD, _MOTOR_MAX_V = 3.0, 0.3, 4.0


@dataclass(frozen=True)
class ManualInput:
    """Positions and forces of a simulated hand; None leaves a part free.

    ``q``, ``theta_A``, ``theta_B`` [rad]: positions to which joint and motors are moved. ``pull_A``, ``pull_B`` [N]:
    pull at the load cells, as by a hanging weight. ``F_limit`` [N]: tension at which the safety module trips, None for
    its own limit.
    """

    q: float | None = None
    theta_A: float | None = None
    theta_B: float | None = None
    pull_A: float = 0.0
    pull_B: float = 0.0
    F_limit: float | None = None

    def compute_push(self, x: PlantState) -> float:
        """Return the force on the joint [N]."""
        if self.q is None:
            return 0.0
        return _limit(_JOINT_N_PER_RAD * (self.q - x.q) - _JOINT_N_S_PER_RAD * x.q_dot, _JOINT_MAX_N)

    def compute_torques(self, x: PlantState) -> MotorCommand:
        """Return the torques on both motors, as the voltages that would produce them [V]."""
        return MotorCommand(
            _compute_motor_voltage(self.theta_A, x.theta_A, x.omega_A),
            _compute_motor_voltage(self.theta_B, x.theta_B, x.omega_B),
        )


NO_MANUAL_INPUT = ManualInput()


@runtime_checkable
class SupportsManualInput(Protocol):
    """Plant that a simulated hand can act on: its motion is computed."""

    def apply_manual_input(self, manual_input: ManualInput) -> None:
        """Apply ``manual_input`` from the next period on."""
        ...


def _compute_motor_voltage(theta_ref: float | None, theta: float, omega: float) -> float:
    if theta_ref is None:
        return 0.0
    return _limit(_MOTOR_V_PER_RAD * (theta_ref - theta) - _MOTOR_V_S_PER_RAD * omega, _MOTOR_MAX_V)


def _limit(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
