"""Unloaded voltage steps: tendons let slack, each step from rest, braked before the motors run out of room."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import brake, cascade
from backend.tick.decision import Carry, Decision, Target, driven, follow, walk
from plant.compiled import compiled
from plant.interface import Measurement, T_s

ZERO_VOLTS_S = 0.2
"""How long both motors stand at zero volts before a voltage step [s], so that the step starts from rest."""

STEP_BRAKING_S = 0.5
"""Length of braking after a voltage step [s]: full speed takes 0.3 s."""

_ZERO_TICKS = round(ZERO_VOLTS_S / T_s)
_BRAKING_TICKS = round(STEP_BRAKING_S / T_s)
_START, _VOLTS, _TICKS, _TRAVEL = range(4)
CENTRED, _POSITIONED, _STANDING, _DRIVEN, _BRAKED = range(5)


class Room(NamedTuple):
    """What the steps are kept within.

    The way to the first leads through ``centre_A``, ``centre_B`` [rad], which hold the joint at q = 0: a joint let
    loose elsewhere would leave one of the tendons taut. A step ends early where a tendon pulls by more than ``F_slack``
    [N] or a motor is beyond ``theta_max`` [rad].
    """

    centre_A: float
    centre_B: float
    F_slack: float
    theta_max: float


class State(NamedTuple):
    """``steps`` (n, 4): start [rad], volts, ticks, travel [rad]; the one that is made, its stage, and since when."""

    room: Room
    steps: NDArray[np.float64]
    settle_ticks: int
    step: int
    stage: int
    ticks: int
    began_A: float
    began_B: float
    brake: brake.State


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of the stage in progress: walk to where the step starts, stand, zero volts, step, brake, and so on."""
    room, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking = state
    ticks += 1
    u, done = 0.0, False
    if stage in (CENTRED, _POSITIONED):
        goal_A, goal_B = (room.centre_A, room.centre_B) if stage == CENTRED else (steps[at, _START], steps[at, _START])
        theta_A, theta_B = walk(carry.theta_A_ref, carry.theta_B_ref, goal_A, goal_B)
        if theta_A != goal_A or theta_B != goal_B:
            ticks = 0
        elif ticks >= settle_ticks:
            stage, ticks = stage + 1, 0
        decision, carry = follow(tuning, carry, target, theta_A, theta_B, m, done)
        return decision, carry, State(room, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking)
    if stage == _STANDING:
        if ticks >= _ZERO_TICKS:
            stage, ticks, began_A, began_B = _DRIVEN, 0, m.theta_A, m.theta_B
        decision, carry = driven(tuning, target, 0.0, 0.0, m, done)
        return decision, carry, State(room, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking)
    if stage == _DRIVEN:
        turned = max(abs(m.theta_A - began_A), abs(m.theta_B - began_B))
        out_of_room = turned >= steps[at, _TRAVEL] or max(abs(m.theta_A), abs(m.theta_B)) > room.theta_max
        if ticks > steps[at, _TICKS] or out_of_room or max(m.F_A, m.F_B) > room.F_slack:
            stage, ticks, braking = _BRAKED, 0, brake.State(m.theta_A, m.theta_B, 0.0, 0.0)
        else:
            u = steps[at, _VOLTS]
            decision, carry = driven(tuning, target, u, u, m, done)
            return decision, carry, State(room, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking)
    u_A, u_B, braking = brake.step(braking, m.theta_A, m.theta_B, tuning.u_max)
    if ticks >= _BRAKING_TICKS:
        at += 1
        done = at == steps.shape[0]
        if not done:
            stage, ticks = _POSITIONED, 0
    decision, carry = driven(tuning, target, u_A, u_B, m, done)
    return decision, carry, State(room, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking)
