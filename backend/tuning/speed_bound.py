"""How fast a position step could be at all: what the motors' speed and acceleration allow, whatever the law."""

import math

from backend.tuning.models import motor_model
from plant.dynamics import root
from plant.parameters import SIDES, PlantParameters


def least_reach_time(parameters: PlantParameters, step: float, share: float = 0.9) -> float:
    """Time [s] in which the motors can turn the joint by ``share`` of a ``step`` [rad], unloaded at full voltage.

    A motor at rest under u_max turns by K_m u_max (t − T_m (1 − exp(−t/T_m))) (equation 17); the slower one counts,
    and it need not stop. Both reels turn r_j/r_m times as far as the joint (equations 18, 19).
    """
    g = parameters.geometry
    turn = share * abs(step) * g.r_j / g.r_m
    motors = [motor_model(parameters, side) for side in SIDES]
    return max(_time(turn, parameters.motor.u_max * motor.K_m, motor.T_m) for motor in motors)


def _time(turn: float, speed: float, T_m: float) -> float:
    if turn == 0.0:
        return 0.0

    def missing(t: float) -> float:
        return speed * (t - T_m * (1.0 - math.exp(-t / T_m))) - turn

    return root(missing, 0.0, turn / speed + T_m)
