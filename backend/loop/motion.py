"""What the loop does with the motors in each mode: one small class a motion, one ``step`` a tick.

Every motion hands the state of the motor loops on to the next one, so that no change of mode makes the voltages jump.
"""

import math
from typing import NamedTuple, Protocol

from backend.controllers import brake, cascade, force_hold, motors, pretension
from backend.faults import Limit
from backend.loop.causes import Cause, Why
from backend.loop.player import ExcitationPlayer, Target
from backend.loop.program import Program
from plant.interface import Measurement, T_s

TRAVEL_SPEED = 3.0
"""Speed of the motor references between modes [rad/s]: 0.3 rad/s at the joint, 3 V of 10 V."""

PRETENSION_N = 10.0
"""Tension that pretension winds up to (method section 7)."""

SOFT_STOP_S = 0.5
"""Length of a soft stop [s]: the joint stands after 0.15 s, the rest lets it settle before the outputs go to zero."""


class Carry(NamedTuple):
    """Motor loops as one motion leaves them and the next takes them over: state, gains, references [rad]."""

    state: motors.State
    gains: motors.Gains
    theta_A_ref: float
    theta_B_ref: float


class Decision(NamedTuple):
    """What a motion decided in one tick; without ``pushes`` the plant's push is left alone."""

    u_A: float
    u_B: float
    theta_A_ref: float
    theta_B_ref: float
    target: Target
    q_ref_gov: float
    S_ref_gov: float
    bank_entry: float
    limits: Limit
    pushes: bool = False


NO_REFERENCE = Target(math.nan, math.nan, 0.0)
AT_REST = Decision(0.0, 0.0, math.nan, math.nan, NO_REFERENCE, math.nan, math.nan, math.nan, Limit(0))
"""Zero volts, and nothing that is followed."""


class Motion(Protocol):
    """One way of moving. ``done`` tells that it has reached its end; it goes on holding there."""

    done: bool

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick: measurement to voltages."""
        ...

    def carry(self) -> Carry:
        """Return the motor loops for the next motion."""
        ...


class MotorPositions:
    """Common to the motions below the cascade: the pair of inner loops following motor references."""

    done = False

    def __init__(self, carry: Carry, target: Target) -> None:
        self._carry = carry
        self.target = target

    def carry(self) -> Carry:
        """Return the motor loops for the next motion."""
        return self._carry

    def follow(self, tuning: cascade.Tuning, m: Measurement, theta_A_ref: float, theta_B_ref: float) -> Decision:
        """One tick of both motor loops towards motor references [rad]."""
        state = self._carry.state
        if tuning.motors != self._carry.gains:
            state = motors.bumpless(self._carry.gains, tuning.motors, state, m.theta_A, m.theta_B)
        y, state = motors.step(tuning.motors, state, theta_A_ref, theta_B_ref, m.theta_A, m.theta_B, tuning.u_max)
        self._carry = Carry(state, tuning.motors, theta_A_ref, theta_B_ref)
        limits = clipped(y.excess_A != 0.0, y.excess_B != 0.0)
        q_ref, S_ref = self.target.q_ref, self.target.S_ref
        return Decision(y.u_A, y.u_B, theta_A_ref, theta_B_ref, self.target, q_ref, S_ref, 0.0, limits)


class Trial(MotorPositions):
    """What the bring-up plays, from OFF to OFF: never braked, as nothing is proven yet, but ended at zero volts.

    ``cause`` says how it ended.
    """

    cause: Why = Cause.ASKED_FOR


class Winding(MotorPositions):
    """Pretension from slack: both motors wind until both load cells read the pretension."""

    def __init__(self, carry: Carry, target: Target) -> None:
        super().__init__(carry, target)
        self._state = pretension.State(0.0, 0.0, carry.theta_A_ref, carry.theta_B_ref, 0.0)

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of winding."""
        self._state = pretension.step(self._state, PRETENSION_N, m.F_A, m.F_B)
        self.done = self._state.steady_s >= pretension.STANDSTILL_S
        return self.follow(tuning, m, self._state.theta_A_ref, self._state.theta_B_ref)

    @property
    def tensions(self) -> tuple[float, float]:
        """Filtered load cell readings [N]."""
        return self._state.F_A, self._state.F_B


class Travel(MotorPositions):
    """Walk the motor references along a straight line to (theta_A, theta_B) [rad] and hold there."""

    def __init__(self, carry: Carry, target: Target, theta_A: float, theta_B: float) -> None:
        super().__init__(carry, target)
        self._goal = theta_A, theta_B
        self._settled_s = 0.0

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of walking, or of holding the goal."""
        theta_A_ref, theta_B_ref = walk(self._carry.theta_A_ref, self._carry.theta_B_ref, *self._goal)
        if (theta_A_ref, theta_B_ref) == self._goal:
            self._settled_s += T_s
            self.done = self._settled_s >= pretension.STANDSTILL_S
        return self.follow(tuning, m, theta_A_ref, theta_B_ref)


class ForceHold(MotorPositions):
    """Actuator identification: theta_B_ref at zero, the tension held by motor A, the excitation on top (figure 5)."""

    def __init__(self, carry: Carry, target: Target, program: Program, theta_A: float) -> None:
        super().__init__(carry, target)
        if program.excitation is None:
            raise ValueError("a force-hold program needs an excitation")
        self._F_ref = program.tension_N
        self._settle_ticks = round(program.settle_s / T_s)
        self._player = ExcitationPlayer(program.excitation)
        self._base_A, self._base_B = carry.theta_A_ref, carry.theta_B_ref
        self._goal_A = theta_A
        self._state = force_hold.State(0.0)

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick: travel to the tension, settle, excite."""
        arrived = (self._base_A, self._base_B) == (self._goal_A, 0.0)
        offset = 0.0
        if not arrived:
            self._base_A, self._base_B = walk(self._base_A, self._base_B, self._goal_A, 0.0)
        elif self._settle_ticks > 0:
            self._settle_ticks -= 1
        else:
            excitation = self._player.step()
            self.done = excitation is None
            offset = excitation or 0.0
        trim, state = force_hold.step(self._state, self._F_ref, m.F_A, m.F_B)
        if arrived:
            self._state = state
        return self.follow(tuning, m, self._base_A + trim + offset, self._base_B)


class Braking(MotorPositions):
    """Soft stop: brake both motors and keep braking until the joint has come to rest under tension."""

    def __init__(self, carry: Carry, target: Target, m: Measurement) -> None:
        super().__init__(carry, target)
        self._brake = brake.State(m.theta_A, m.theta_B, 0.0, 0.0)
        self._elapsed_s = 0.0

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of braking."""
        u_A, u_B, self._brake = brake.step(self._brake, m.theta_A, m.theta_B, tuning.u_max)
        self._elapsed_s += T_s
        self.done = self._elapsed_s >= SOFT_STOP_S
        limits = clipped(abs(u_A) == tuning.u_max, abs(u_B) == tuning.u_max)
        nan = math.nan
        return Decision(u_A, u_B, nan, nan, self.target, nan, nan, nan, limits)


def clipped(A: bool, B: bool) -> Limit:
    """Limit flags of voltages that were clipped."""
    return (Limit.VOLTAGE_A if A else Limit(0)) | (Limit.VOLTAGE_B if B else Limit(0))


def walk(theta_A: float, theta_B: float, goal_A: float, goal_B: float) -> tuple[float, float]:
    """One tick along the straight line to the goal at TRAVEL_SPEED [rad/s]; exactly the goal at its end."""
    distance = max(abs(goal_A - theta_A), abs(goal_B - theta_B))
    reach = TRAVEL_SPEED * T_s
    if distance <= reach:
        return goal_A, goal_B
    share = reach / distance
    return theta_A + share * (goal_A - theta_A), theta_B + share * (goal_B - theta_B)
