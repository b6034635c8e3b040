"""A person's hand at a rig that is computed: it turns joint and motors, pulls at load cells, sets a limit."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from plant.dynamics import PlantState
from plant.interface import MotorCommand

_JOINT_N_PER_RAD, _JOINT_N_S_PER_RAD, _JOINT_MAX_N = 60.0, 0.3, 60.0
_MOTOR_V_PER_RAD, _MOTOR_V_S_PER_RAD, _MOTOR_MAX_V = 3.0, 0.3, 4.0


@dataclass(frozen=True)
class ManualInput:
    """What hands do from now on: joint and motors brought to where they are named [rad], None: let alone.

    ``pull_A``, ``pull_B`` [N] pull at the load cells, as a weight does that hangs there. ``F_limit`` [N] is the tension
    at which the safety module trips, None: its own.
    """

    q: float | None = None
    theta_A: float | None = None
    theta_B: float | None = None
    pull_A: float = 0.0
    pull_B: float = 0.0
    F_limit: float | None = None

    def compute_push(self, x: PlantState) -> float:
        """Return the force at the joint [N]."""
        if self.q is None:
            return 0.0
        return _limit(_JOINT_N_PER_RAD * (self.q - x.q) - _JOINT_N_S_PER_RAD * x.q_dot, _JOINT_MAX_N)

    def compute_torques(self, x: PlantState) -> MotorCommand:
        """Return the torques at both motors, as the voltages that would give them [V]."""
        return MotorCommand(
            _compute_motor_voltage(self.theta_A, x.theta_A, x.omega_A),
            _compute_motor_voltage(self.theta_B, x.theta_B, x.omega_B),
        )


NO_HAND = ManualInput()


@runtime_checkable
class Handled(Protocol):
    """A plant that hands of this program can reach: what moves is computed."""

    def by_hand(self, hand: ManualInput) -> None:
        """Let ``hand`` act from the next period on."""
        ...


def _compute_motor_voltage(theta_ref: float | None, theta: float, omega: float) -> float:
    if theta_ref is None:
        return 0.0
    return _limit(_MOTOR_V_PER_RAD * (theta_ref - theta) - _MOTOR_V_S_PER_RAD * omega, _MOTOR_MAX_V)


def _limit(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
