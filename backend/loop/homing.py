"""The joint driven to its end switch: slowly, with little voltage and little tension, and no further than it may.

Both tendons are wound to a low tension first; then one motor winds what the other lets out, so that the joint moves and
the tension stays. The switch is met twice, the second time slower, and the joint is brought back to its middle. Any
surprise ends it at zero volts, each with its name.
"""

import math
from collections.abc import Callable
from enum import Enum, auto

from backend.control import cascade, motion_primitives
from backend.control.motion_types import AT_REST, Carry, Decision, Target
from backend.loop.causes import HomingEnd
from backend.loop.motion import Trial
from plant.interface import Measurement, T_s

HOMING_MAX_V = 1.5
"""Largest voltage [V]; 0.9 V are enough for what is asked of the motors."""

FAST_RAD_PER_S, SLOW_RAD_PER_S = 0.15, 0.03
"""Speed of the joint on its way, and when it meets the switch again: a fiftieth of a count of its encoder a tick."""

TENSION_N = 4.0
TENSION_MAX_N = 10.0
SLACK_N = 1.0
"""Tension [N] in both tendons on the way; above the largest something holds the joint, below the least one is slack."""

SPARE_RAD = 0.3
"""The joint may go so much further than from its middle to the switch [rad]."""

BACK_OFF_RAD = 0.05
STUCK_RAD = 0.2
"""So far from the switch it is met again; so far on the way back it may stay closed [rad]."""

JOINT_OFF_RAD, MOTOR_OFF_RAD = 0.1, 1.0
"""So far may the joint be from where the motors bring it, and a motor from where it is sent [rad]."""

WOUND_MAX_RAD = 3.0
"""A tendon that is slack after so much winding [rad] is off its reel, or is not what the load cell is at."""

TIME_MAX_S = 60.0
_NEAR_N, _NEAR_S, _SLACK_S = 0.7, 0.2, 0.1


class _Phase(Enum):
    WINDING = auto()
    SEEKING = auto()
    LEAVING = auto()
    TOUCHING = auto()
    RETURNING = auto()


def travel_to(position: float) -> float:
    """Return how far the joint may be driven at most to a switch at ``position`` [rad]."""
    return abs(position) + SPARE_RAD


class Homing(Trial):
    """``position`` [rad] is where the switch holds the joint, ``ratio`` what a motor turns for a radian of the joint.

    ``at_end`` tells whether the switch was held in the newest reading.
    """

    def __init__(
        self, carry: Carry, target: Target, m: Measurement, position: float, ratio: float, at_end: Callable[[], bool]
    ) -> None:
        super().__init__(carry, target)
        self.end: HomingEnd | None = None
        self._position = position
        self._sign = 1.0 if position > 0.0 else -1.0
        self._travel = travel_to(position)
        self._ratio = ratio
        self._at_end = at_end
        self._phase = _Phase.WINDING
        self._winding = motion_primitives.PretensionState(m.F_A, m.F_B, carry.theta_A_ref, carry.theta_B_ref, 0.0)
        self._wound_from = carry.theta_A_ref, carry.theta_B_ref
        self._began = self._wound_at = m.q
        self._ticks = 0
        self._near_s = self._slack_s = 0.0
        self._way = 0.0  # of the joint since it was wound, as the motors are sent [rad]
        self._since = 0.0  # way at the begin of this phase
        self._open_from: float | None = None
        self._touched = 0.0

    def position_of(self, q: float) -> float:
        """Return where the joint is [rad] that reads ``q`` in the encoder's counts so far."""
        return self._position + q - self._touched

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> Decision:
        """One tick: look for surprises, then go on."""
        self._ticks += 1
        self.end = self._surprise(m) or self._advanced(m)
        if self.end is not None:
            self.done, self.cause = True, self.end
            return AT_REST
        turn = self._ratio * self._way
        theta_A, theta_B = self._winding.theta_A_ref + turn, self._winding.theta_B_ref - turn
        return self.follow(tuning._replace(u_max=min(tuning.u_max, HOMING_MAX_V)), m, theta_A, theta_B)

    def _surprise(self, m: Measurement) -> HomingEnd | None:
        """Return what has gone wrong; a reading that is no number is wrong."""
        if not (m.F_A <= TENSION_MAX_N and m.F_B <= TENSION_MAX_N):
            return HomingEnd.TENSION
        if not abs(m.q - self._began) <= self._travel:
            return HomingEnd.NOT_REACHED
        refs = self._carry.theta_A_ref, self._carry.theta_B_ref
        if not (abs(m.theta_A - refs[0]) <= MOTOR_OFF_RAD and abs(m.theta_B - refs[1]) <= MOTOR_OFF_RAD):
            return HomingEnd.MOTOR_OFF
        if self._ticks * T_s > TIME_MAX_S:
            return HomingEnd.TOO_LONG
        if self._phase is _Phase.WINDING:
            wound = max(abs(ref - begun) for ref, begun in zip(refs, self._wound_from, strict=True))
            return None if wound <= WOUND_MAX_RAD else HomingEnd.SLACK
        self._slack_s = 0.0 if m.F_A >= SLACK_N and m.F_B >= SLACK_N else self._slack_s + T_s
        if self._slack_s > _SLACK_S:
            return HomingEnd.SLACK
        gone = m.q - self._wound_at
        if not abs(gone - self._way) <= JOINT_OFF_RAD:
            went = math.copysign(gone, gone * self._way)
            return HomingEnd.WRONG_WAY if went < -0.25 * JOINT_OFF_RAD else HomingEnd.JOINT_HELD
        return None

    def _advanced(self, m: Measurement) -> HomingEnd | None:
        """Go on by a period; return an end that has been reached."""
        held, gone = self._at_end(), abs(self._way - self._since)
        match self._phase:
            case _Phase.WINDING:
                self._wind(m, held)
            case _Phase.SEEKING:
                if held:
                    self._begin(_Phase.LEAVING)
                elif gone > self._travel:
                    return HomingEnd.NOT_REACHED
                else:
                    self._go(self._sign * FAST_RAD_PER_S)
            case _Phase.LEAVING:
                if held and gone > STUCK_RAD:
                    return HomingEnd.STUCK_CLOSED
                self._leave(held)
            case _Phase.TOUCHING:
                if held:
                    self._touched = m.q
                    self._begin(_Phase.RETURNING)
                elif gone > STUCK_RAD:
                    return HomingEnd.NOT_REACHED
                else:
                    self._go(self._sign * SLOW_RAD_PER_S)
            case _Phase.RETURNING:
                if held and gone > STUCK_RAD:
                    return HomingEnd.STUCK_CLOSED
                if abs(m.q - self._touched) >= abs(self._position):
                    return HomingEnd.HOMED
                self._go(-self._sign * FAST_RAD_PER_S)
        return None

    def _begin(self, phase: _Phase) -> None:
        self._phase, self._since, self._open_from = phase, self._way, None

    def _go(self, speed: float) -> None:
        self._way += speed * T_s

    def _wind(self, m: Measurement, held: bool) -> None:
        self._winding = motion_primitives.step_pretension(self._winding, TENSION_N, m.F_A, m.F_B)
        near = abs(self._winding.F_A - TENSION_N) <= _NEAR_N and abs(self._winding.F_B - TENSION_N) <= _NEAR_N
        self._near_s = self._near_s + T_s if near else 0.0
        if self._near_s >= _NEAR_S:
            self._wound_at = m.q
            self._begin(_Phase.LEAVING if held else _Phase.SEEKING)

    def _leave(self, held: bool) -> None:
        """Go back until the switch has been open all the way of BACK_OFF_RAD: contacts bounce."""
        if held:
            self._open_from = None
        elif self._open_from is None:
            self._open_from = self._way
        elif abs(self._way - self._open_from) >= BACK_OFF_RAD:
            self._begin(_Phase.TOUCHING)
            return
        self._go(-self._sign * FAST_RAD_PER_S)
