"""Motions of commissioning: motor direction, homing, trip of the safety module."""

import math
from collections.abc import Callable
from enum import Enum, auto

from backend.control import AT_REST, ControlOutput, MotorLoopState, Setpoint, cascade, motion_primitives, pid
from backend.realtime.modes import Cause, HomingEnd
from backend.realtime.motions import CommissioningMotion, PythonMotion
from plant import Measurement, T_s

# Homing --------------------------------------------------------------------------------------------
# The joint moves to its end switch slowly, with small voltage, tension and travel.
#
# Both tendons are first wound to a low tension; then one motor winds by what the other unwinds, so the joint moves at
# constant tension. The switch is reached twice, the second time more slowly, and the joint returns to its centre. Any
# failure ends the motion at zero volts, each with its own cause.


HOMING_MAX_V = 1.5
"""Largest voltage [V]; the motion needs 0.9 V."""

FAST_RAD_PER_S, SLOW_RAD_PER_S = 0.15, 0.03
"""Joint speed towards the switch, and when it reaches it again [rad/s]: a fiftieth of an encoder count per tick."""

HOMING_TENSION_N = 4.0
TENSION_MAX_N = 10.0
SLACK_N = 1.0
"""Tension of both tendons in motion [N]; above the maximum the joint is blocked, below SLACK_N a tendon is slack."""

TRAVEL_MARGIN_RAD = 0.3
"""Permitted travel beyond the distance from the centre to the switch [rad]."""

RETREAT_RAD = 0.05
STUCK_RAD = 0.2
"""Distance from which the switch is approached again, and travel back within which it must open [rad]."""

JOINT_ERROR_MAX_RAD, MOTOR_ERROR_MAX_RAD = 0.1, 1.0
"""Permitted deviations of the joint from its commanded travel, and of a motor from its reference [rad]."""

WOUND_MAX_RAD = 3.0
"""Winding after which a slack tendon is off its reel, or not connected to the load cell [rad]."""

TIME_MAX_S = 60.0
_NEAR_N, _NEAR_S, _SLACK_S = 0.7, 0.2, 0.1


class _Phase(Enum):
    WINDING = auto()
    SEEKING = auto()
    LEAVING = auto()
    TOUCHING = auto()
    RETURNING = auto()


def compute_switch_travel(position: float) -> float:
    """Return the largest travel of the joint to a switch at ``position`` [rad]."""
    return abs(position) + TRAVEL_MARGIN_RAD


class Homing(CommissioningMotion):
    """Motion to the end switch at ``position`` [rad].

    ``ratio`` is the rotation of a motor per radian of the joint; ``at_end`` returns whether the switch was held in the
    newest reading.
    """

    def __init__(
        self,
        motor_loops: MotorLoopState,
        target: Setpoint,
        m: Measurement,
        position: float,
        ratio: float,
        at_end: Callable[[], bool],
    ) -> None:
        super().__init__(motor_loops, target)
        self.end: HomingEnd | None = None
        self._position = position
        self._sign = 1.0 if position > 0.0 else -1.0
        self._travel = compute_switch_travel(position)
        self._ratio = ratio
        self._at_end = at_end
        self._phase = _Phase.WINDING
        self._winding = motion_primitives.PretensionState(
            m.F_A, m.F_B, motor_loops.theta_A_ref, motor_loops.theta_B_ref, 0.0
        )
        self._wound_from = motor_loops.theta_A_ref, motor_loops.theta_B_ref
        self._start_q = self._wound_q = m.q
        self._ticks = 0
        self._near_s = self._slack_s = 0.0
        self._commanded_travel = 0.0  # joint travel since winding, as commanded by the motors [rad]
        self._phase_start = 0.0  # commanded travel at the start of this phase [rad]
        self._open_from: float | None = None
        self._contact_q = 0.0

    def compute_joint_position(self, q: float) -> float:
        """Return the joint position [rad] for a reading ``q`` of its encoder."""
        return self._position + q - self._contact_q

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> ControlOutput:
        """Check for failures, then advance by a step."""
        self._ticks += 1
        self.end = self._find_failure(m) or self._advance(m)
        if self.end is not None:
            self.done, self.cause = True, self.end
            return AT_REST
        turn = self._ratio * self._commanded_travel
        theta_A, theta_B = self._winding.theta_A_ref + turn, self._winding.theta_B_ref - turn
        return self.follow(tuning._replace(u_max=min(tuning.u_max, HOMING_MAX_V)), m, theta_A, theta_B)

    def _find_failure(self, m: Measurement) -> HomingEnd | None:
        """Return the failure, if any; NaN in a reading is a failure."""
        if not (m.F_A <= TENSION_MAX_N and m.F_B <= TENSION_MAX_N):
            return HomingEnd.TENSION
        if not abs(m.q - self._start_q) <= self._travel:
            return HomingEnd.NOT_REACHED
        refs = self._motor_loops.theta_A_ref, self._motor_loops.theta_B_ref
        if not (abs(m.theta_A - refs[0]) <= MOTOR_ERROR_MAX_RAD and abs(m.theta_B - refs[1]) <= MOTOR_ERROR_MAX_RAD):
            return HomingEnd.MOTOR_OFF
        if self._ticks * T_s > TIME_MAX_S:
            return HomingEnd.TOO_LONG
        if self._phase is _Phase.WINDING:
            wound = max(abs(ref - begun) for ref, begun in zip(refs, self._wound_from, strict=True))
            return None if wound <= WOUND_MAX_RAD else HomingEnd.SLACK
        self._slack_s = 0.0 if m.F_A >= SLACK_N and m.F_B >= SLACK_N else self._slack_s + T_s
        if self._slack_s > _SLACK_S:
            return HomingEnd.SLACK
        travelled = m.q - self._wound_q
        if not abs(travelled - self._commanded_travel) <= JOINT_ERROR_MAX_RAD:
            signed_travel = math.copysign(travelled, travelled * self._commanded_travel)
            return HomingEnd.WRONG_WAY if signed_travel < -0.25 * JOINT_ERROR_MAX_RAD else HomingEnd.JOINT_HELD
        return None

    def _advance(self, m: Measurement) -> HomingEnd | None:
        """Advance by a period; return the end if it is reached."""
        is_closed, travelled = self._at_end(), abs(self._commanded_travel - self._phase_start)
        match self._phase:
            case _Phase.WINDING:
                self._wind(m, is_closed)
            case _Phase.SEEKING:
                if is_closed:
                    self._begin(_Phase.LEAVING)
                elif travelled > self._travel:
                    return HomingEnd.NOT_REACHED
                else:
                    self._move(self._sign * FAST_RAD_PER_S)
            case _Phase.LEAVING:
                if is_closed and travelled > STUCK_RAD:
                    return HomingEnd.STUCK_CLOSED
                self._leave(is_closed)
            case _Phase.TOUCHING:
                if is_closed:
                    self._contact_q = m.q
                    self._begin(_Phase.RETURNING)
                elif travelled > STUCK_RAD:
                    return HomingEnd.NOT_REACHED
                else:
                    self._move(self._sign * SLOW_RAD_PER_S)
            case _Phase.RETURNING:
                if is_closed and travelled > STUCK_RAD:
                    return HomingEnd.STUCK_CLOSED
                if abs(m.q - self._contact_q) >= abs(self._position):
                    return HomingEnd.HOMED
                self._move(-self._sign * FAST_RAD_PER_S)
        return None

    def _begin(self, phase: _Phase) -> None:
        self._phase, self._phase_start, self._open_from = phase, self._commanded_travel, None

    def _move(self, speed: float) -> None:
        self._commanded_travel += speed * T_s

    def _wind(self, m: Measurement, is_closed: bool) -> None:
        self._winding = motion_primitives.step_pretension(self._winding, HOMING_TENSION_N, m.F_A, m.F_B)
        is_near = (
            abs(self._winding.F_A - HOMING_TENSION_N) <= _NEAR_N
            and abs(self._winding.F_B - HOMING_TENSION_N) <= _NEAR_N
        )
        self._near_s = self._near_s + T_s if is_near else 0.0
        if self._near_s >= _NEAR_S:
            self._wound_q = m.q
            self._begin(_Phase.LEAVING if is_closed else _Phase.SEEKING)

    def _leave(self, is_closed: bool) -> None:
        """Move back until the switch has been open for RETREAT_RAD: contacts bounce."""
        if is_closed:
            self._open_from = None
        elif self._open_from is None:
            self._open_from = self._commanded_travel
        elif abs(self._commanded_travel - self._open_from) >= RETREAT_RAD:
            self._begin(_Phase.TOUCHING)
            return
        self._move(-self._sign * FAST_RAD_PER_S)


# Motor direction test ------------------------------------------------------------------------------
# One motor turns slightly before its direction is known: by a rising voltage, then by the same in reverse.
#
# No loop is closed: whatever the direction of the motor and the readings of its sensors, the voltage is bounded in size
# and time, so the joint moves less than 0.1 rad even if no reading changes.


TRIAL_MAX_V = 1.0
"""Largest voltage [V]: a tenth of the motors' maximum."""

MOTOR_TRIAL_RISE_V_PER_S = 1.0
TRAVEL_RAD = 0.2
"""Rotation of a motor that shows its direction [rad]; it coasts by about as much, 0.03 rad at the joint."""

JOINT_RAD = 0.02
MOTOR_TRIAL_TENSION_N = 3.0
"""Changes of joint [rad] or tension [N] that also end the outward motion, whatever the motor encoders read."""

COAST_S = 0.2
"""Pause at zero volts between outward and return motion [s]; the result is read then."""

END_PAUSE_S = 0.3


class MotorTrial(CommissioningMotion):
    """Motion of one motor out and back; the other gets zero volts."""

    cause = Cause.MOTOR_TRIED

    def __init__(self, motor_loops: MotorLoopState, target: Setpoint, m: Measurement, motor: str) -> None:
        super().__init__(motor_loops, target)
        self._start = m
        self._is_A = motor == "A"
        self._ticks = 0
        self._forward_ticks = 0

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> ControlOutput:
        """Execute a step of outward motion, pause or return."""
        self._ticks += 1
        if not self._forward_ticks and (
            self._has_moved(m) or self._ticks * T_s >= TRIAL_MAX_V / MOTOR_TRIAL_RISE_V_PER_S
        ):
            self._forward_ticks = self._ticks
        u = self._compute_voltage()
        u_A, u_B = (u, 0.0) if self._is_A else (0.0, u)
        nan = math.nan
        self._motor_loops = MotorLoopState(
            pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, u_A, u_B), tuning.motors, m.theta_A, m.theta_B
        )
        return ControlOutput(
            u_A=u_A,
            u_B=u_B,
            theta_A_ref=nan,
            theta_B_ref=nan,
            setpoint=self.setpoint,
            q_ref_gov=nan,
            S_ref_gov=nan,
            bank_entry=nan,
            limits=0,
            sets_disturbance=False,
            done=False,
        )

    def _compute_voltage(self) -> float:
        if not self._forward_ticks:
            return MOTOR_TRIAL_RISE_V_PER_S * T_s * self._ticks
        return_ticks = self._ticks - self._forward_ticks - round(COAST_S / T_s)
        self.done = return_ticks > self._forward_ticks + round(END_PAUSE_S / T_s)
        return -MOTOR_TRIAL_RISE_V_PER_S * T_s * return_ticks if 0 < return_ticks <= self._forward_ticks else 0.0

    def _has_moved(self, m: Measurement) -> bool:
        start = self._start
        is_within = (
            abs(m.theta_A - start.theta_A) < TRAVEL_RAD
            and abs(m.theta_B - start.theta_B) < TRAVEL_RAD
            and abs(m.q - start.q) < JOINT_RAD
            and abs(m.F_A - start.F_A) < MOTOR_TRIAL_TENSION_N
            and abs(m.F_B - start.F_B) < MOTOR_TRIAL_TENSION_N
        )
        return not is_within  # NaN never increases the voltage


# Safety module test --------------------------------------------------------------------------------
# Test of the safety module: a trip is provoked at pretension while the loop continues to drive briefly.
#
# Only this shows whether the module itself disables the drives, or only reports a trip to which the loop reacts.


DRIVE_TIME_S = 0.3
"""Time after the trip for which the motors are driven [s]; zero volts follow."""

MODULE_TRIAL_RISE_V_PER_S = 3.0
RISE_MAX_N = 3.0
"""Increase of a tension [N] that ends the test at once."""


class ModuleTrial(PythonMotion):
    """Hold the motors; after the trip drive them with rising voltage for DRIVE_TIME_S.

    Friction holds a motor within a band of voltages, at whose lower end it creeps back although its drive is enabled.
    The rise makes the difference: a motor with drive winds up, one without is turned back by its tendon.
    """

    def __init__(self, motor_loops: MotorLoopState, target: Setpoint, m: Measurement) -> None:
        super().__init__(motor_loops, target)
        self._u_A = self._u_B = 0.0
        self._ticks = 0
        self._tension_max = max(m.F_A, m.F_B) + RISE_MAX_N

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> ControlOutput:
        """Execute a step of holding, or of driving."""
        if not (self._ticks or m.safety_trip):
            output = self.follow(tuning, m, self._motor_loops.theta_A_ref, self._motor_loops.theta_B_ref)
            self._u_A, self._u_B = output.u_A, output.u_B
            return output
        self._ticks += 1
        is_within = self._tension_max >= m.F_A and self._tension_max >= m.F_B
        self.done = self.done or not is_within or self._ticks * T_s >= DRIVE_TIME_S
        self._u_A, self._u_B = (
            min(max(u, 0.0) + MODULE_TRIAL_RISE_V_PER_S * T_s, TRIAL_MAX_V) for u in (self._u_A, self._u_B)
        )
        at_rest = pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, self._u_A, self._u_B)
        self._motor_loops = MotorLoopState(at_rest, tuning.motors, m.theta_A, m.theta_B)
        nan = math.nan
        return ControlOutput(
            u_A=self._u_A,
            u_B=self._u_B,
            theta_A_ref=nan,
            theta_B_ref=nan,
            setpoint=self.setpoint,
            q_ref_gov=nan,
            S_ref_gov=nan,
            bank_entry=nan,
            limits=0,
            sets_disturbance=False,
            done=self.done,
        )
