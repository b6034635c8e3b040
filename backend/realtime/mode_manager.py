"""Mode manager: transitions, motions they start, pending stops, encoder offsets."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from backend.control import NO_REFERENCE, PRETENSION_N, CascadeTuning, MotorLoopState, Setpoint, pid
from backend.faults import Fault
from backend.realtime import messages
from backend.realtime.commands import (
    Event,
    ModeChanged,
    PretensionReached,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.commissioning_motions import ModuleTrial
from backend.realtime.contact import NO_ACTIVE_INPUTS, TAIL_TICKS, Contact, ProgramDisturbances, make_yielding_motion
from backend.realtime.gains import ActiveGains
from backend.realtime.modes import DRIVES_OFF, LEGAL, Cause, CommandRejectedError, Mode, ModeCause
from backend.realtime.motions import (
    BASELINES,
    Baseline,
    Braking,
    CommissioningMotion,
    IdleMotion,
    Motion,
    MotorSteps,
    PointToPointMotion,
    PretensionMotion,
    ProgramMotions,
    PythonMotion,
    Tracking,
)
from backend.realtime.program import IDENTIFYING, Program, may_start_from, program_mode
from backend.realtime.shared_state import StepContext
from backend.tuning import TuningParameters, collect_plant_knowledge
from plant import InvariantError, Measurement, Plant, PlantParameters, SupportsDirectionCheck

# Context -------------------------------------------------------------------------------------------
# Context of a command or an event.


class TickContext(NamedTuple):
    """The newest tick and its measurement."""

    tick: int
    m: Measurement


# Pending stop --------------------------------------------------------------------------------------
# A stop between its request and the report of zero volts.


@dataclass(frozen=True)
class StopRequest:
    """Pending stop: request, tick and time [s] of its arrival."""

    stop: Stop
    arrived_tick: int
    clock_s: float
    detail: str


# Encoder offsets -----------------------------------------------------------------------------------
# Offsets of the encoders of joint and motors.


class EncoderOffsets:
    """Offsets that the loop has determined for one plant.

    ``is_motor_zero_known``: the zeros of the motor encoders are known, always if they are absolute. ``joint_centre``
    [rad]: reading at the joint's centre.
    """

    def __init__(self, *, has_absolute_motors: bool = False) -> None:
        self.has_absolute_motors = self.is_motor_zero_known = has_absolute_motors
        self.joint_centre = 0.0
        self.offset_A = self.offset_B = 0.0

    def subtract_joint_centre(self, m: Measurement) -> Measurement:
        """Return the measurement with the joint relative to its centre."""
        return m._replace(q=m.q - self.joint_centre) if self.joint_centre else m

    def shift_motors(self, by_A: float, by_B: float) -> None:
        """Shift the motors' readings by ``by_A``, ``by_B`` [rad].

        Their zeros are then known.
        """
        self.offset_A += by_A
        self.offset_B += by_B
        self.is_motor_zero_known = True

    def invalidate_motors(self) -> None:
        """Mark the motors' zeros as unknown, unless their encoders are absolute."""
        self.is_motor_zero_known = self.has_absolute_motors

    def set_joint_centre(self, q: float) -> None:
        """Set the reading q [rad] at which the joint is centred."""
        self.joint_centre = q

    def reset(self) -> None:
        """Reset all offsets, as the encoders themselves have new zeros."""
        self.offset_A = self.offset_B = self.joint_centre = 0.0
        self.is_motor_zero_known = self.has_absolute_motors


# Mode transitions ----------------------------------------------------------------------------------
# Transitions between modes: which are permitted, which motion they start, and what follows its end.


_FAULTS_THAT_INVALIDATE_ZEROS = (Fault.SENSOR_JUMP, Fault.SENSOR_STUCK, Fault.IMPLAUSIBLE, Fault.MOTOR_REVERSED)
"""Faults after which the encoders' zeros may be wrong: pretension winds from slack again and determines them."""


class ModeManager:
    """Mode, motion and latched fault of one loop; changes are added to ``events``.

    ``drives_off``: people may be working at the rig. ``zeros``: encoder offsets.
    """

    def __init__(
        self,
        plant: Plant,
        parameters: PlantParameters,
        step: StepContext,
        tuning: CascadeTuning,
        lambdas: TuningParameters,
        events: list[Event],
    ) -> None:
        self.mode, self.fault = Mode.OFF, Fault.NONE
        self._events, self._plant, self._step = events, plant, step
        self._idle = IdleMotion(tuning.motors)
        self.motion = None
        self.run, self.is_completion_reported = 0, False
        self.tunings = ActiveGains(step, events, tuning, lambdas)
        self._plant_model = collect_plant_knowledge(parameters)
        self.bounds = self._plant_model.bounds
        self.has_tendons = parameters.mechanism is None
        self.zeros, self.drives_off = EncoderOffsets(has_absolute_motors=not self.has_tendons), False
        self._pending_stop: StopRequest | None = None
        self._programs = ProgramMotions(plant, parameters)
        self.turns_per_joint = self._plant_model.decoupler.r_j / self._plant_model.decoupler.r_m
        self._program: Program | None = None
        self.contact = Contact(step, events, self.tunings)
        self.disturbances = ProgramDisturbances(plant, events, self.contact)

    @property
    def motion(self) -> Motion | None:
        """Active motion."""
        return self._motion

    @motion.setter
    def motion(self, motion: Motion | None) -> None:
        self._motion = motion
        self.python_motion = motion if isinstance(motion, PythonMotion) else None
        if self.python_motion is None:
            self._step.set_motion(motion or self._idle)

    @property
    def is_pretension_done(self) -> bool:
        """Whether pretension has been reached and both tendons are held."""
        return self.mode is Mode.PRETENSION and isinstance(self.motion, PointToPointMotion) and self.motion.done

    @property
    def unready(self) -> str:
        """What must precede pretension; empty for nothing."""
        return DRIVES_OFF if self.drives_off else self._plant.unready

    @property
    def requires_tension(self) -> bool:
        """Whether slack would be a fault: under control, except while winding.

        Voltage steps are made with slack tendons deliberately.
        """
        is_winding = self.mode is Mode.PRETENSION and not self.is_completion_reported
        allows_slack = isinstance(self.motion, MotorSteps | CommissioningMotion)
        is_controlled = self.motion is not None and self.zeros.is_motor_zero_known and self.mode is not Mode.STOPPING
        return is_controlled and not is_winding and not allows_slack

    @property
    def has_unreported_stop(self) -> bool:
        """Whether a stop has reached zero volts and has not been reported."""
        return self._pending_stop is not None and self.mode is Mode.TRIPPED

    def require_consistent(self) -> None:
        """Raise InvariantError if mode, motion and latched fault are inconsistent."""
        if (self.mode in (Mode.OFF, Mode.TRIPPED)) is not (self.motion is None):
            raise InvariantError(f"mode {self.mode} with motion {type(self.motion).__name__}")
        if self.mode is Mode.TRIPPED and self.fault is Fault.NONE:
            raise InvariantError("mode tripped without a fault")
        if self.mode not in (Mode.TRIPPED, Mode.STOPPING) and self.fault is not Fault.NONE:
            raise InvariantError(f"mode {self.mode} with fault {self.fault}")

    def set_mode(self, command: SetMode, context: TickContext) -> None:
        """Execute an operator's transition. Raises CommandRejectedError."""
        mode = command.mode
        self._require_legal(mode)
        if isinstance(self.motion, CommissioningMotion) and mode is not Mode.STOPPING:
            raise CommandRejectedError(messages.commissioning_motion_in_progress(), LEGAL[self.mode])
        if mode is Mode.PRETENSION:
            if self.unready:
                raise CommandRejectedError(self.unready)
            self._enter_pretension(context, Cause.ASKED_FOR)
        elif mode is Mode.OFF:
            self._enter(context, Mode.OFF, None, Cause.ASKED_FOR)
        elif mode is Mode.STOPPING:
            self._brake(context, Cause.ASKED_FOR)
        elif mode in (Mode.RUN, Mode.COMPLIANCE):
            self._require_taut(mode)
            motion = Tracking(
                self.tunings.gains, self._get_motor_loops(context.m), context.m, self.bounds, mode is Mode.RUN
            )
            self._enter(context, mode, motion, Cause.ASKED_FOR, command.run)
        else:
            raise CommandRejectedError(messages.mode_requires_program(mode=mode), LEGAL[self.mode])

    def run_program(self, command: RunProgram, context: TickContext) -> None:
        """Start a program.

        Raises CommandRejectedError or OutOfRangeError before any motion.
        """
        program, mode = command.program, program_mode(command.program.law)
        self._require_legal(mode)
        self._require_taut(mode)
        if not self.has_tendons and program.law in (*IDENTIFYING, *BASELINES):
            raise CommandRejectedError(messages.law_requires_tendons(law=program.law), LEGAL[self.mode])
        if not may_start_from(program.law, self.mode):
            raise CommandRejectedError(messages.law_requires_pretension(law=program.law), LEGAL[self.mode])
        tunings, program_gains = self.tunings, self.tunings.build_for_program(program, self._plant_model)
        motion = self._programs.make_motion(
            program, self._get_motor_loops(context.m), context.m, tunings.gains, tunings.lambdas
        )
        self.disturbances.require_program(program)
        self._enter(context, mode, motion, Cause.PROGRAM, command.run)
        self._program = program
        self.disturbances.begin(program)
        tunings.begin(program_gains)

    def start_commissioning_motion(
        self, make_motion: Callable[[MotorLoopState], Motion], cause: ModeCause, context: TickContext
    ) -> None:
        """Start a commissioning motion from OFF."""
        self._enter(context, Mode.IDENTIFY, make_motion(self._get_motor_loops(context.m)), cause)

    def start_module_trial(self, context: TickContext) -> None:
        """Provoke the safety module's trip at pretension. Raises CommandRejectedError."""
        if not self.has_tendons:
            raise CommandRejectedError(messages.trial_requires_load_cells(), LEGAL[self.mode])
        if not self.is_pretension_done or self.motion is None:
            raise CommandRejectedError(messages.safety_module_requires_pretension())
        self.motion = ModuleTrial(self.motion.get_motor_loops(), NO_REFERENCE, context.m)

    def set_tuning(self, tuning: CascadeTuning, lambdas: TuningParameters) -> None:
        """Replace all gains of the cascade.

        Raises CommandRejectedError during a baseline law.
        """
        if isinstance(self.motion, Baseline):
            raise CommandRejectedError(messages.baseline_gains_fixed())
        self.tunings.replace(tuning, lambdas)

    def set_references(self, command: SetReferences) -> None:
        """Set the operator's references.

        Raises CommandRejectedError or OutOfRangeError.
        """
        self.contact.require_none(LEGAL[self.mode])
        if self.mode not in (Mode.RUN, Mode.COMPLIANCE) or not isinstance(self.motion, Tracking):
            raise CommandRejectedError(messages.references_not_in_mode(mode=self.mode))
        self._programs.require_references(command.q_ref, command.S_ref)
        self.motion.set_setpoint(Setpoint(float(command.q_ref), float(command.S_ref), 0.0))

    def react_to_contact(self, context: TickContext) -> None:
        """React to a contact: the joint yields at its position.

        It yields permanently, or for a limited time while the run of a program continues.
        """
        has_program, ticks = self._program is not None, self.contact.pause(self._program, self.motion)
        run_continues = bool(ticks) or (self.contact.begin_reaction(context.tick) and has_program)
        active = self.disturbances.get_active_inputs(self.tunings.number) if run_continues else NO_ACTIVE_INPUTS
        motion = make_yielding_motion(
            tuning=self.tunings.gains,
            motor_loops=self._get_motor_loops(context.m),
            m=context.m,
            bounds=self.bounds,
            active=active,
            ticks=ticks or TAIL_TICKS,
        )
        if run_continues:
            self.motion = motion
        else:
            self._enter(context, Mode.COMPLIANCE, motion, Cause.CONTACT, 0 if has_program else self.run)

    def reset(self, context: TickContext) -> None:
        """Leave TRIPPED; the caller has checked that the cause is gone.

        Raises CommandRejectedError or PlantError.
        """
        self._plant.acknowledge()
        self.fault = Fault.NONE
        self._enter(context, Mode.OFF, None, Cause.RESET)

    def begin_stop(self, stop: Stop, detail: str, context: TickContext) -> None:
        """Latch the fault; zero volts at once (hard) or after braking (soft).

        Never rejected.
        """
        if self._pending_stop is None or stop.hard:
            self._pending_stop = StopRequest(stop, context.tick, time.perf_counter(), detail)
        if self.mode is Mode.TRIPPED:
            return
        self.fault = stop.fault
        if stop.fault in _FAULTS_THAT_INVALIDATE_ZEROS:
            self.zeros.invalidate_motors()
        if stop.fault is Fault.MOTOR_REVERSED and isinstance(self._plant, SupportsDirectionCheck):
            self._plant.prove_directions(proven=False)
        if stop.hard or self.motion is None or isinstance(self.motion, CommissioningMotion):
            self._enter(context, Mode.TRIPPED, None, stop.fault)
        elif self.mode is not Mode.STOPPING:
            self._brake(context, stop.fault)

    def report_stopped(self, tick: int) -> None:
        """Report a stop once zero volts have been written."""
        pending = self._pending_stop
        if pending is None or self.mode is not Mode.TRIPPED:
            return
        stop, elapsed_ms = pending.stop, 1e3 * (time.perf_counter() - pending.clock_s)
        self._events.append(
            Stopped(
                fault=stop.fault,
                hard=stop.hard,
                arrived_tick=pending.arrived_tick,
                zero_tick=tick,
                milliseconds=elapsed_ms,
                detail=pending.detail,
            )
        )
        self._pending_stop = None

    def end_motion(self, context: TickContext) -> Measurement:
        """Continue after a motion has ended; return the measurement with current zeros."""
        if isinstance(self.motion, PretensionMotion):
            return self._set_motor_zeros(self.motion, context)
        if isinstance(self.motion, CommissioningMotion):
            self._enter(context, Mode.OFF, None, self.motion.cause)
        elif self.contact.paused is not None:
            self._program = rest = self.contact.resume(self.contact.paused)
            self.motion = Tracking(
                tuning=self.tunings.gains,
                motor_loops=self._get_motor_loops(context.m),
                m=context.m,
                bounds=self.bounds,
                position_loop=True,
                program=rest,
            )
        elif self.contact.is_active and self.mode is Mode.EXPERIMENT:
            self.react_to_contact(context)
        elif self.mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
            self._enter_pretension(context, Cause.PROGRAM_ENDED, completed=True)
        elif self.is_pretension_done and not self.is_completion_reported:
            self.is_completion_reported = True
            self._events.append(PretensionReached(context.tick))
        elif self.mode is Mode.STOPPING:
            self._enter(context, Mode.OFF if self.fault is Fault.NONE else Mode.TRIPPED, None, Cause.STANDING)
        return context.m

    def _require_legal(self, mode: Mode) -> None:
        legal = LEGAL[self.mode]
        if mode not in legal:
            raise CommandRejectedError(
                messages.mode_change_not_legal(current=self.mode, wanted=mode, legal=legal), legal
            )

    def _require_taut(self, mode: Mode) -> None:
        if self.mode is Mode.PRETENSION and not self.is_pretension_done:
            raise CommandRejectedError(
                messages.mode_requires_taut_tendons(mode=mode, tension_N=PRETENSION_N), LEGAL[self.mode]
            )

    def _get_motor_loops(self, m: Measurement) -> MotorLoopState:
        if self.motion is not None:
            return self.motion.get_motor_loops()
        gains = self.tunings.gains.motors
        return MotorLoopState(
            pid.at_rest_motor_pair(gains, m.theta_A, m.theta_B, 0.0, 0.0), gains, m.theta_A, m.theta_B
        )

    def _enter(
        self,
        context: TickContext,
        mode: Mode,
        motion: Motion | None,
        cause: ModeCause,
        run: int = 0,
        *,
        completed: bool = False,
    ) -> None:
        if self._program is not None or self.run not in (0, run):
            is_complete = completed or (self._program is None and not isinstance(cause, Fault))
            detail = self._pending_stop.detail if self._pending_stop is not None and isinstance(cause, Fault) else ""
            self._events.append(RunEnded(context.tick, self.run, is_complete, cause, detail))
        if self._program is not None:
            if self._program.law not in IDENTIFYING:
                self.disturbances.end(context.tick)
            self._program = None
            self.tunings.end(context.tick)
        self._events.append(ModeChanged(context.tick, self.mode, mode, cause))
        self.mode, self.motion, self.run = mode, motion, run
        self.is_completion_reported, self.contact.is_active = False, cause is Cause.CONTACT

    def _enter_pretension(self, context: TickContext, cause: ModeCause, *, completed: bool = False) -> None:
        motor_loops, is_zero_known, angles = (
            self._get_motor_loops(context.m),
            self.zeros.is_motor_zero_known,
            self._programs.compute_pretension_angles(),
        )
        motion: Motion = PointToPointMotion(motor_loops, *angles) if is_zero_known else PretensionMotion(motor_loops)
        self._enter(context, Mode.PRETENSION, motion, cause, completed=completed)

    def _set_motor_zeros(self, winding: PretensionMotion, context: TickContext) -> Measurement:
        """Set the motors' zeros from the tensions, as incremental encoders have none."""
        m = context.m
        move_A, move_B = self._programs.compute_encoder_errors(winding.tensions, m)
        self.contact.reset(context.tick)
        self.zeros.shift_motors(move_A, move_B)
        motor_loops = winding.get_motor_loops()
        state = pid.shift_motor_pair(motor_loops.gains, motor_loops.state, move_A, move_B)
        shifted = MotorLoopState(
            state, motor_loops.gains, motor_loops.theta_A_ref + move_A, motor_loops.theta_B_ref + move_B
        )
        self.motion = PointToPointMotion(shifted, *self._programs.compute_pretension_angles())
        return m._replace(theta_A=m.theta_A + move_A, theta_B=m.theta_B + move_B)

    def _brake(self, context: TickContext, cause: ModeCause) -> None:
        if isinstance(self.motion, CommissioningMotion):  # the direction is unknown: braking could accelerate
            self._enter(context, Mode.OFF, None, cause)
            return
        self._enter(
            context,
            Mode.STOPPING,
            Braking(self._get_motor_loops(context.m), context.m, self.tunings.gains.u_max),
            cause,
        )
