"""What the loop is set to while an experiment runs: λ, bank, seed of the simulator."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TypeVar

from backend.experiments.settings import SettingError, boolean, describe, from_values, integer, number
from backend.tuning.models import LAM_MAX, LAM_MOTOR, LAM_Q, LAM_S, Lambdas
from backend.tuning.motor_loop import LAM_MOTOR_MAX, LAM_MOTOR_MIN

_LAM_LEAST = 0.01
_T = TypeVar("_T")


@dataclass(frozen=True)
class LoopSettings:
    """Tuning in force and seed. The bounds of λ here are coarse; the safe range follows from the models in use."""

    lam_q: float = number(LAM_Q, _LAM_LEAST, LAM_MAX, "s", "λ_q", "tuning parameter of the position loop")
    lam_S: float = number(LAM_S, _LAM_LEAST, LAM_MAX, "s", "λ_S", "tuning parameter of the stiffness loop")
    lam_motor: float = number(
        LAM_MOTOR, LAM_MOTOR_MIN, LAM_MOTOR_MAX, "s", "λ_motor", "tuning parameter of the motor loops"
    )
    bank: int = integer(0, 0, 2**53, "bank", "number of the controller bank, 0 for gains from geometry at 20 N")
    interpolate: bool = boolean(False, "interpolate", "gain scheduling between bank entries instead of switching")
    seed: int = integer(0, 0, 2**31 - 1, "seed", "seed of the simulator's noise")
    b: float = number(0.0, 0.0, 1.0, "1", "b", "weight of the reference in the outer loops' proportional part")

    @property
    def lambdas(self) -> Lambdas:
        """The tuning parameters and b alone."""
        return Lambdas(self.lam_q, self.lam_S, self.lam_motor, self.b)


def split_values(plan: type[_T], values: Mapping[str, object]) -> tuple[_T, LoopSettings]:
    """Build plan and loop settings from one set of named values. Raises SettingError, OutOfRangeError."""
    of_loop = {item.name for item in fields(LoopSettings)}
    of_plan = {setting.name for setting in describe(plan)}
    for name, value in values.items():
        if name not in of_loop | of_plan:
            legal = (*sorted(of_plan), *sorted(of_loop))
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return (
        from_values(plan, {name: value for name, value in values.items() if name in of_plan}),
        from_values(LoopSettings, {name: value for name, value in values.items() if name in of_loop}),
    )
