"""The control loop: one tick, the moves between modes, and zero volts at every way out.

The same class runs live in the loop process and headless for the command line; what differs is who calls ``tick``.
"""

import math
import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from backend.controllers import cascade, decoupler, i_pd, motors, scheduling
from backend.controllers.limits import bounds_for
from backend.faults import FAULT_CODE, Fault, Limit
from backend.loop.checks import Checks
from backend.loop.commands import (
    Accepted,
    Command,
    Event,
    Heartbeat,
    ModeChanged,
    ProgramEnded,
    Push,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    SetTuning,
    Shutdown,
    Stop,
    Stopped,
)
from backend.loop.mode import LEGAL, MODE_CODE, Mode
from backend.loop.motion import PRETENSION_N, Braking, Carry, Decision, ForceHold, Motion, Tracking, Travel, Winding
from backend.loop.player import Target
from backend.loop.program import Law, Program
from backend.refusal import OutOfRangeError, require_within
from backend.sample import FIELDS
from plant.compiled import compiled
from plant.interface import ZERO_VOLTS, Measurement, MotorCommand, Plant, PlantError, T_s
from plant.parameters import PlantParameters
from plant.spring import elongation

VELOCITY_FILTER_S = 0.010
"""Time constant of the estimate of joint velocity [s]: four encoder counts a tick at 6 rad/s, smoothed over ten."""

_CONTROLLED = (Mode.PRETENSION, Mode.RUN, Mode.COMPLIANCE, Mode.IDENTIFY, Mode.EXPERIMENT)
_NO_REFERENCE = Target(math.nan, math.nan, 0.0)


class SampleRing(Protocol):
    """Where the loop leaves its samples: rows of len(FIELDS) numbers, one a tick."""

    def append(self, row: NDArray[np.float64]) -> None:
        """Publish one row."""
        ...


class RefusedError(Exception):
    """A command that cannot be carried out now; ``legal`` lists the modes that could be asked for instead."""

    def __init__(self, reason: str, legal: tuple[Mode, ...] = ()) -> None:
        super().__init__(reason)
        self.legal = legal


@compiled
def _velocity(q_dot: float, q: float, q_before: float) -> float:
    pass_through = 1.0 - math.exp(-T_s / VELOCITY_FILTER_S)
    return q_dot + pass_through * ((q - q_before) / T_s - q_dot)


class Loop:
    """Control of one plant. ``mode`` and ``fault`` are its state; ``drain_events`` tells what happened."""

    def __init__(self, plant: Plant, parameters: PlantParameters, ring: SampleRing, tuning: SetTuning) -> None:
        geometry, k = parameters.geometry, parameters.spring.k
        self.mode = Mode.OFF
        self.fault = Fault.NONE
        self.finished = False
        self.bounds = bounds_for(geometry.q_max, parameters.safety.F_max, parameters.motor.u_max)
        self._plant = plant
        self._ring = ring
        self._spring = parameters.nominal_spring
        self._decoupler = decoupler.Decoupler(geometry.r_m, geometry.r_j, k[1], k[2])
        self._checks = Checks(self.bounds)
        self._events: list[Event] = []
        self._row = np.zeros(len(FIELDS))
        self._tick = 0
        self._run = 0
        self._zeroed = False
        self._offset_A = self._offset_B = 0.0
        self._motion: Motion | None = None
        self._program: Program | None = None
        self._stop: tuple[Stop, int, float, str] | None = None
        self._q_before = math.nan
        self._q_dot = 0.0
        self._overruns = 0
        self._apply(tuning)
        plant.open()
        self._m = self._read()

    # Commands ---------------------------------------------------------------------------------------------------

    def handle(self, sequence: int, command: Command) -> None:
        """Carry out a command between two ticks, or refuse it whole; the answer is queued as an event."""
        try:
            self._carry_out(command)
        except (RefusedError, OutOfRangeError, PlantError, ValueError) as error:
            legal = error.legal if isinstance(error, RefusedError) else ()
            self._events.append(Refused(sequence, self._tick, str(error), legal))
        else:
            self._events.append(Accepted(sequence, self._tick))

    def drain_events(self) -> list[Event]:
        """Events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def _carry_out(self, command: Command) -> None:
        match command:
            case Heartbeat():
                pass
            case Stop():
                self._begin_stop(command, "asked for")
            case SetMode():
                self._set_mode(command)
            case SetReferences():
                self._set_references(command)
            case SetTuning():
                self._apply(command)
            case RunProgram():
                self._run_program(command)
            case Push():
                self._plant.push(command.F_push)
            case Reset():
                self._reset()
            case Shutdown():
                self.finished = True

    def _set_mode(self, command: SetMode) -> None:
        self._require_legal(command.mode)
        match command.mode:
            case Mode.PRETENSION:
                self._enter_pretension("asked for")
            case Mode.RUN:
                self._require_taut(command.mode)
                motion = Tracking(self._tuning, self._carried(), self._m, self.bounds)
                self._enter(Mode.RUN, motion, "asked for", command.run)
            case Mode.COMPLIANCE:
                self._require_taut(command.mode)
                open_joint = Program(Law.COMPLIANCE)
                motion = Tracking(self._tuning, self._carried(), self._m, self.bounds, open_joint)
                self._enter(Mode.COMPLIANCE, motion, "asked for", command.run)
            case Mode.STOPPING:
                self._brake("asked for")
            case Mode.OFF:
                self._enter(Mode.OFF, None, "asked for")
            case _:
                raise RefusedError(f"{command.mode} starts with a program, not by itself", LEGAL[self.mode])

    def _run_program(self, command: RunProgram) -> None:
        program = command.program
        mode = Mode.IDENTIFY if program.law is Law.FORCE_HOLD else Mode.EXPERIMENT
        self._require_legal(mode)
        self._require_taut(mode)
        motion: Motion
        if program.law is Law.FORCE_HOLD:
            theta_A = 2.0 * elongation(self._spring, program.tension_N) / self._decoupler.r_m
            motion = ForceHold(self._carried(), _NO_REFERENCE, program, theta_A)
        else:
            for segment in program.segments:
                self._require_references(segment.q_ref, segment.S_ref)
            motion = Tracking(self._tuning, self._carried(), self._m, self.bounds, program)
        self._program = program
        self._enter(mode, motion, "program", command.run)

    def _set_references(self, command: SetReferences) -> None:
        if self.mode not in (Mode.RUN, Mode.COMPLIANCE) or not isinstance(self._motion, Tracking):
            raise RefusedError(f"references are the operator's in run and compliance only; the mode is {self.mode}")
        self._require_references(command.q_ref, command.S_ref)
        self._motion.target = Target(command.q_ref, command.S_ref, 0.0)

    def _require_references(self, q_ref: float, S_ref: float) -> None:
        require_within("q_ref", q_ref, self.bounds.q_min, self.bounds.q_max, "rad")
        require_within("S_ref", S_ref, self.bounds.S_min, self.bounds.S_max, "N·m/rad")

    def _apply(self, command: SetTuning) -> None:
        if not command.entries:
            raise RefusedError("a bank needs at least one entry")
        entries = sorted(command.entries, key=lambda entry: entry.S_nominal)
        columns = ("S_nominal", "k_p_q", "k_i_q", "k_r_q", "k_p_S", "k_i_S", "k_r_S")
        table = np.array([[getattr(entry, column) for column in columns] for entry in entries], dtype=np.float64)
        gains_A, gains_B = command.motor_A, command.motor_B
        inner = motors.Gains(
            i_pd.Gains(gains_A.k_p, gains_A.k_i, gains_A.k_d, gains_A.t_f),
            i_pd.Gains(gains_B.k_p, gains_B.k_i, gains_B.k_d, gains_B.t_f),
        )
        if not (np.all(np.isfinite(table)) and np.all(np.isfinite(np.array(inner)))):
            raise RefusedError("a gain is not a finite number: no gain was changed")
        self._tuning = cascade.Tuning(
            inner,
            scheduling.Schedule(table, command.interpolate),
            self._decoupler,
            self.bounds.omega_max,
            self.bounds.u_max,
        )
        self._lam_q, self._lam_S = command.lam_q, command.lam_S

    def _reset(self) -> None:
        if self.mode is not Mode.TRIPPED:
            raise RefusedError(f"there is no fault to reset; the mode is {self.mode}", LEGAL[self.mode])
        self._plant.acknowledge()
        fault, seen = self._checks.step(self._m._replace(safety_trip=0.0), taut_wanted=False, missed=0)
        if fault is not Fault.NONE:
            raise RefusedError(f"the cause is still there: {seen}")
        self.fault = Fault.NONE
        self._enter(Mode.OFF, None, "reset")

    # Moves between modes ----------------------------------------------------------------------------------------

    def _require_legal(self, mode: Mode) -> None:
        legal = LEGAL[self.mode]
        if mode not in legal:
            names = ", ".join(legal) or "none: reset the fault first"
            raise RefusedError(f"{self.mode} cannot go to {mode}; legal now: {names}", legal)

    def _require_taut(self, mode: Mode) -> None:
        if self.mode is Mode.PRETENSION and not self.pretension_done:
            raise RefusedError(f"{mode} has to wait until both tendons hold {PRETENSION_N:g} N", LEGAL[self.mode])

    @property
    def pretension_done(self) -> bool:
        """Whether pretension has been reached and both tendons are held."""
        return self.mode is Mode.PRETENSION and self._motion is not None and self._motion.done

    def _carried(self) -> Carry:
        if self._motion is not None:
            return self._motion.carry()
        m = self._m
        at_rest = motors.at_rest(self._tuning.motors, m.theta_A, m.theta_B, 0.0, 0.0)
        return Carry(at_rest, self._tuning.motors, m.theta_A, m.theta_B)

    def _enter(self, mode: Mode, motion: Motion | None, cause: str, run: int = 0) -> None:
        if self._program is not None and mode not in (Mode.IDENTIFY, Mode.EXPERIMENT):
            completed = cause == "program ended"
            self._events.append(ProgramEnded(self._tick, self._run, completed))
            self._program = None
            if not isinstance(self._motion, ForceHold):
                self._release_push()
        self._events.append(ModeChanged(self._tick, self.mode, mode, cause))
        self.mode, self._motion, self._run = mode, motion, run

    def _release_push(self) -> None:
        # A rig cannot push by itself: there is nothing to release then.
        try:
            self._plant.push(0.0)
        except PlantError:
            return

    def _enter_pretension(self, cause: str) -> None:
        carry = self._carried()
        motion: Motion
        if self._zeroed:
            theta = elongation(self._spring, PRETENSION_N) / self._decoupler.r_m
            motion = Travel(carry, _NO_REFERENCE, theta, theta)
        else:
            motion = Winding(carry, _NO_REFERENCE)
        self._enter(Mode.PRETENSION, motion, cause)

    def _take_zero(self, winding: Winding) -> None:
        """Set the encoders' zeros from the tensions: the incremental encoders do not know where slack ends."""
        r_m, r_j = self._decoupler.r_m, self._decoupler.r_j
        F_A, F_B = winding.tensions
        move_A = (elongation(self._spring, F_A) + r_j * self._m.q) / r_m - self._m.theta_A
        move_B = (elongation(self._spring, F_B) - r_j * self._m.q) / r_m - self._m.theta_B
        carry = winding.carry()
        self._offset_A += move_A
        self._offset_B += move_B
        self._m = self._m._replace(theta_A=self._m.theta_A + move_A, theta_B=self._m.theta_B + move_B)
        state = motors.shift(carry.gains, carry.state, move_A, move_B)
        shifted = Carry(state, carry.gains, carry.theta_A_ref + move_A, carry.theta_B_ref + move_B)
        self._zeroed = True
        theta = elongation(self._spring, PRETENSION_N) / r_m
        self._motion = Travel(shifted, _NO_REFERENCE, theta, theta)

    def _brake(self, cause: str) -> None:
        self._enter(Mode.STOPPING, Braking(self._carried(), _NO_REFERENCE, self._m), cause)

    def _begin_stop(self, stop: Stop, detail: str) -> None:
        if self._stop is None or stop.hard:
            self._stop = (stop, self._tick, time.perf_counter(), detail)
        if self.mode is Mode.TRIPPED:
            return
        self.fault = stop.fault
        if stop.hard or self.mode in (Mode.OFF, Mode.STOPPING):
            self._enter(Mode.TRIPPED, None, stop.fault)
        else:
            self._brake(stop.fault)

    def _end_motion(self) -> None:
        """What follows when a motion has reached its end by itself."""
        if isinstance(self._motion, Winding):
            self._take_zero(self._motion)
        elif self.mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
            self._enter_pretension("program ended")
        elif self.mode is Mode.STOPPING:
            self._enter(Mode.OFF if self.fault is Fault.NONE else Mode.TRIPPED, None, "standing")

    # The tick ---------------------------------------------------------------------------------------------------

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """One period: read, estimate, decide, limit, write, append. Zero volts on any way out by an error."""
        command = ZERO_VOLTS
        try:
            self._m = m = self._read()
            self._q_dot = _velocity(self._q_dot, m.q, m.q if math.isnan(self._q_before) else self._q_before)
            self._q_before = m.q
            taut = self.mode in _CONTROLLED and not isinstance(self._motion, Winding) and self._zeroed
            fault, seen = self._checks.step(m, taut, overruns - self._overruns)
            if fault is not Fault.NONE and self.mode is not Mode.TRIPPED and self._at_risk(fault):
                self._begin_stop(Stop(fault), seen)
            decision = self._decide(m)
            command = MotorCommand(decision.u_A, decision.u_B)
        except PlantError as error:
            self._begin_stop(Stop(Fault.PLANT_ERROR), str(error))
            decision = self._standing(self._m)
        finally:
            self._write(command)
        self._overruns = overruns
        self._append(self._m, decision, lateness_s)
        self._tick += 1

    def _at_risk(self, fault: Fault) -> bool:
        return self.mode is not Mode.OFF or fault in (Fault.SAFETY_MODULE, Fault.SENSOR_INVALID)

    def _decide(self, m: Measurement) -> Decision:
        if self._motion is None:
            return self._standing(m)
        decision = self._motion.step(self._tuning, m)
        if decision.pushes:
            self._plant.push(decision.target.F_push)
        if self._motion.done:
            self._end_motion()
        return decision

    def _standing(self, m: Measurement) -> Decision:
        nan = math.nan
        return Decision(0.0, 0.0, nan, nan, Target(nan, nan, 0.0), nan, nan, nan, Limit(0))

    def _read(self) -> Measurement:
        m = self._plant.read()
        return m._replace(theta_A=m.theta_A + self._offset_A, theta_B=m.theta_B + self._offset_B)

    def _write(self, command: MotorCommand) -> None:
        if self.mode in (Mode.OFF, Mode.TRIPPED):
            command = ZERO_VOLTS
        try:
            self._plant.write(command)
        except PlantError as error:
            if self.mode is not Mode.TRIPPED:
                self._begin_stop(Stop(Fault.PLANT_ERROR), str(error))
            return
        if self._stop is not None and self.mode is Mode.TRIPPED:
            stop, arrived, clock, detail = self._stop
            elapsed_ms = 1e3 * (time.perf_counter() - clock)
            self._events.append(Stopped(stop.fault, stop.hard, arrived, self._tick, elapsed_ms, detail))
            self._stop = None

    def _append(self, m: Measurement, y: Decision, lateness_s: float) -> None:
        row = self._row
        S = decoupler.stiffness(self._decoupler, m.theta_A, m.theta_B)
        u_A, u_B = (0.0, 0.0) if self.mode in (Mode.OFF, Mode.TRIPPED) else (y.u_A, y.u_B)
        row[:] = (
            self._tick,
            self._tick * T_s,
            MODE_CODE[self.mode],
            self._run,
            m.q,
            y.target.q_ref,
            y.q_ref_gov,
            self._q_dot,
            S,
            y.target.S_ref,
            y.S_ref_gov,
            m.S_true,
            m.theta_A,
            y.theta_A_ref,
            m.theta_B,
            y.theta_B_ref,
            m.F_A,
            m.F_B,
            u_A,
            u_B,
            m.F_push,
            self._lam_q,
            self._lam_S,
            y.bank_entry,
            int(y.limits),
            FAULT_CODE[self.fault],
            lateness_s,
            self._overruns,
        )
        self._ring.append(row)

    def close(self) -> None:
        """Zero volts and let go of the plant. Safe to call twice."""
        try:
            self._plant.write(ZERO_VOLTS)
        except PlantError:
            pass
        finally:
            self._plant.close()
