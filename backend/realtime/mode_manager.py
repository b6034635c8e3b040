"""The mode manager: granted transitions, motions they start, pending stops, zeros of the encoders."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from backend.control import NO_REFERENCE, PRETENSION_N, CascadeTuning, MotorLoopState, Setpoint, pid
from backend.faults import Fault
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
from backend.realtime.contact import NOTHING, TAIL_TICKS, Contact, ProgramDisturbances, giving_way
from backend.realtime.gains import ActiveGains
from backend.realtime.modes import DRIVES_OFF, LEGAL, Cause, CommandRejectedError, Mode, Why
from backend.realtime.motions import (
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

# Now -----------------------------------------------------------------------------------------------
#
# When something is done to the loop: after which tick, and after what was measured.


class TickContext(NamedTuple):
    """The newest tick, and what was measured in it."""

    tick: int
    m: Measurement


# Pending stop --------------------------------------------------------------------------------------
#
# A stop between its order and its proof.


@dataclass(frozen=True)
class StopRequest:
    """A stop on its way to zero volts: what asked for it, in which tick, at which reading of the clock."""

    stop: Stop
    arrived_tick: int
    clock_s: float
    detail: str


# Zeros ---------------------------------------------------------------------------------------------
#
# Where joint and motors count from, beside what their encoders say.


class EncoderOffsets:
    """The zeros that the loop has found of one plant.

    ``motors_known`` tells that those of the motor encoders are known, ``middle`` [rad] is where the joint reads that is
    said to be in its middle.
    """

    def __init__(self) -> None:
        self.motors_known = False
        self.middle = 0.0
        self.offset_A = self.offset_B = 0.0

    def from_middle(self, m: Measurement) -> Measurement:
        """Return the measurement with the joint from its middle, also where its encoder counts from elsewhere."""
        return m._replace(q=m.q - self.middle) if self.middle else m

    def move(self, by_A: float, by_B: float) -> None:
        """Take the motors' zeros as found where they read more by so many rad."""
        self.offset_A += by_A
        self.offset_B += by_B
        self.motors_known = True

    def doubt(self) -> None:
        """Let the motors' zeros be found anew before they are counted on."""
        self.motors_known = False

    def say_middle(self, q: float) -> None:
        """Take the joint to be in its middle where it reads q [rad]."""
        self.middle = q

    def begin_anew(self) -> None:
        """Forget all of it: the encoders themselves count from elsewhere now."""
        self.offset_A = self.offset_B = self.middle = 0.0
        self.motors_known = False


# Mode machine --------------------------------------------------------------------------------------
#
# The moves between modes: which are granted, what starts with them, and what follows when a motion
# has ended.


_DOUBTS_ZEROS = (Fault.SENSOR_JUMP, Fault.SENSOR_STUCK, Fault.IMPLAUSIBLE, Fault.MOTOR_REVERSED)
"""After these the encoders' zeros may be wrong: pretension winds up from slack again and finds them anew."""


class ModeManager:
    """Mode, motion and latched fault of one loop; what happens to them is told to ``events``.

    ``drives_off`` tells that hands may be at the rig, ``zeros`` where joint and motors count from.
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
        self._rest = IdleMotion(tuning.motors)
        self.motion = None
        self.run, self.reached_told = 0, False
        self.tunings = ActiveGains(step, events, tuning, lambdas)
        self._known = collect_plant_knowledge(parameters)
        self.bounds = self._known.bounds
        self.zeros, self.drives_off = EncoderOffsets(), False
        self._pending_stop: StopRequest | None = None
        self._programs = ProgramMotions(plant, parameters)
        self.turns_per_joint = self._known.decoupler.r_j / self._known.decoupler.r_m
        self._program: Program | None = None
        self.contact = Contact(step, events, self.tunings)
        self.push = ProgramDisturbances(plant, events, self.contact)

    @property
    def motion(self) -> Motion | None:
        """The motion that is under way."""
        return self._motion

    @motion.setter
    def motion(self, motion: Motion | None) -> None:
        self._motion = motion
        self.interpreted = motion if isinstance(motion, PythonMotion) else None
        if self.interpreted is None:
            self._step.set_motion(motion or self._rest)

    @property
    def pretension_done(self) -> bool:
        """Whether pretension has been reached and both tendons are held."""
        return self.mode is Mode.PRETENSION and isinstance(self.motion, PointToPointMotion) and self.motion.done

    @property
    def unready(self) -> str:
        """What has to come before pretension; empty where nothing has."""
        return DRIVES_OFF if self.drives_off else self._plant.unready

    @property
    def keeps_taut(self) -> bool:
        """Whether slack would be a fault now: everywhere under control but on the way to pretension.

        Voltage steps are made with slack tendons on purpose.
        """
        on_the_way = self.mode is Mode.PRETENSION and not self.reached_told
        slack_wanted = isinstance(self.motion, MotorSteps | CommissioningMotion)
        closed = self.motion is not None and self.zeros.motors_known and self.mode is not Mode.STOPPING
        return closed and not on_the_way and not slack_wanted

    @property
    def has_to_tell(self) -> bool:
        """Whether a stop has come to zero volts that nobody was told of yet."""
        return self._pending_stop is not None and self.mode is Mode.TRIPPED

    def require_consistent(self) -> None:
        """Raise InvariantError where mode, motion and latched fault do not belong together."""
        if (self.mode in (Mode.OFF, Mode.TRIPPED)) is not (self.motion is None):
            raise InvariantError(f"mode {self.mode} with motion {type(self.motion).__name__}")
        if self.mode is Mode.TRIPPED and self.fault is Fault.NONE:
            raise InvariantError("mode tripped without a fault")
        if self.mode not in (Mode.TRIPPED, Mode.STOPPING) and self.fault is not Fault.NONE:
            raise InvariantError(f"mode {self.mode} with fault {self.fault}")

    def set_mode(self, command: SetMode, now: TickContext) -> None:
        """Carry out an operator's move. Raises CommandRejectedError."""
        mode = command.mode
        self._require_legal(mode)
        if isinstance(self.motion, CommissioningMotion) and mode is not Mode.STOPPING:
            raise CommandRejectedError("a motor is being tried: wait for its end or stop it", LEGAL[self.mode])
        if mode is Mode.PRETENSION:
            if self.unready:
                raise CommandRejectedError(self.unready)
            self._enter_pretension(now, Cause.ASKED_FOR)
        elif mode is Mode.OFF:
            self._enter(now, Mode.OFF, None, Cause.ASKED_FOR)
        elif mode is Mode.STOPPING:
            self._brake(now, Cause.ASKED_FOR)
        elif mode in (Mode.RUN, Mode.COMPLIANCE):
            self._require_taut(mode)
            motion = Tracking(self.tunings.gains, self._carried(now.m), now.m, self.bounds, mode is Mode.RUN)
            self._enter(now, mode, motion, Cause.ASKED_FOR, command.run)
        else:
            raise CommandRejectedError(f"{mode} starts with a program, not by itself", LEGAL[self.mode])

    def run_program(self, command: RunProgram, now: TickContext) -> None:
        """Start a program. Raises CommandRejectedError or OutOfRangeError before anything has moved."""
        program, mode = command.program, program_mode(command.program.law)
        self._require_legal(mode)
        self._require_taut(mode)
        if not may_start_from(program.law, self.mode):
            reason = f"a {program.law} program starts from pretension, where the joint is brought to 0 first"
            raise CommandRejectedError(reason, LEGAL[self.mode])
        tunings, own = self.tunings, self.tunings.of(program, self._known)
        motion = self._programs.motion_for(program, self._carried(now.m), now.m, tunings.gains, tunings.lambdas)
        self.push.require(program)
        self._enter(now, mode, motion, Cause.PROGRAM, command.run)
        self._program = program
        self.push.begin(program)
        tunings.begin(own)

    def try_out(self, made: Callable[[MotorLoopState], Motion], cause: Why, now: TickContext) -> None:
        """Play what the bring-up asks for, from OFF."""
        self._enter(now, Mode.IDENTIFY, made(self._carried(now.m)), cause)

    def try_module(self, now: TickContext) -> None:
        """Provoke the safety module's trip at the pretension. Raises CommandRejectedError."""
        if not self.pretension_done or self.motion is None:
            raise CommandRejectedError("the safety module is tried once both tendons hold the pretension")
        self.motion = ModuleTrial(self.motion.carry(), NO_REFERENCE, now.m)

    def set_tuning(self, tuning: CascadeTuning, lambdas: TuningParameters) -> None:
        """Replace all gains of the cascade. Raises CommandRejectedError while a law without them plays."""
        if isinstance(self.motion, Baseline):
            raise CommandRejectedError(
                "the gains of a baseline are fixed while its program plays: wait for its end or stop it"
            )
        self.tunings.replace(tuning, lambdas)

    def set_references(self, command: SetReferences) -> None:
        """Move the operator's references. Raises CommandRejectedError or OutOfRangeError."""
        self.contact.require_none(LEGAL[self.mode])
        if self.mode not in (Mode.RUN, Mode.COMPLIANCE) or not isinstance(self.motion, Tracking):
            raise CommandRejectedError(
                f"references are the operator's in run and compliance only; the mode is {self.mode}"
            )
        self._programs.require_references(command.q_ref, command.S_ref)
        self.motion.aim(Setpoint(float(command.q_ref), float(command.S_ref), 0.0))

    def give_way(self, now: TickContext) -> None:
        """React to a contact: the joint gives way where it is, and for good where no program's run goes on."""
        playing, ticks = self._program is not None, self.contact.pause(self._program, self.motion)
        goes_on = bool(ticks) or (self.contact.feel(now.tick) and playing)
        acting = self.push.acting(self.tunings.number) if goes_on else NOTHING
        motion = giving_way(
            tuning=self.tunings.gains,
            carry=self._carried(now.m),
            m=now.m,
            bounds=self.bounds,
            acting=acting,
            ticks=ticks or TAIL_TICKS,
        )
        if goes_on:
            self.motion = motion
        else:
            self._enter(now, Mode.COMPLIANCE, motion, Cause.CONTACT, 0 if playing else self.run)

    def reset(self, now: TickContext) -> None:
        """Leave TRIPPED; the loop has made sure that the cause is gone. Raises CommandRejectedError or PlantError."""
        self._plant.acknowledge()
        self.fault = Fault.NONE
        self._enter(now, Mode.OFF, None, Cause.RESET)

    def begin_stop(self, stop: Stop, detail: str, now: TickContext) -> None:
        """Latch the fault and go to zero volts at once (hard) or after braking (soft). Never refused."""
        if self._pending_stop is None or stop.hard:
            self._pending_stop = StopRequest(stop, now.tick, time.perf_counter(), detail)
        if self.mode is Mode.TRIPPED:
            return
        self.fault = stop.fault
        if stop.fault in _DOUBTS_ZEROS:
            self.zeros.doubt()
        if stop.fault is Fault.MOTOR_REVERSED and isinstance(self._plant, SupportsDirectionCheck):
            self._plant.prove_directions(proven=False)
        if stop.hard or self.motion is None or isinstance(self.motion, CommissioningMotion):
            self._enter(now, Mode.TRIPPED, None, stop.fault)
        elif self.mode is not Mode.STOPPING:
            self._brake(now, stop.fault)

    def tell_stopped(self, tick: int) -> None:
        """Tell once of a stop that has come to zero volts; they have just been written."""
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

    def end_motion(self, now: TickContext) -> Measurement:
        """Go on from a motion that has reached its end by itself; return what is measured, from zeros just found."""
        if isinstance(self.motion, PretensionMotion):
            return self._take_zero(self.motion, now)
        if isinstance(self.motion, CommissioningMotion):
            self._enter(now, Mode.OFF, None, self.motion.cause)
        elif self.contact.paused is not None:
            self._program = rest = self.contact.go_on(self.contact.paused)
            self.motion = Tracking(
                tuning=self.tunings.gains,
                carry=self._carried(now.m),
                m=now.m,
                bounds=self.bounds,
                position_loop=True,
                program=rest,
            )
        elif self.contact.felt and self.mode is Mode.EXPERIMENT:
            self.give_way(now)
        elif self.mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
            self._enter_pretension(now, Cause.PROGRAM_ENDED, completed=True)
        elif self.pretension_done and not self.reached_told:
            self.reached_told = True
            self._events.append(PretensionReached(now.tick))
        elif self.mode is Mode.STOPPING:
            self._enter(now, Mode.OFF if self.fault is Fault.NONE else Mode.TRIPPED, None, Cause.STANDING)
        return now.m

    def _require_legal(self, mode: Mode) -> None:
        legal = LEGAL[self.mode]
        if mode not in legal:
            names = ", ".join(legal) or "none: reset the fault first"
            raise CommandRejectedError(f"{self.mode} cannot go to {mode}; legal now: {names}", legal)

    def _require_taut(self, mode: Mode) -> None:
        if self.mode is Mode.PRETENSION and not self.pretension_done:
            raise CommandRejectedError(
                f"{mode} has to wait until both tendons hold {PRETENSION_N:g} N", LEGAL[self.mode]
            )

    def _carried(self, m: Measurement) -> MotorLoopState:
        if self.motion is not None:
            return self.motion.carry()
        gains = self.tunings.gains.motors
        return MotorLoopState(
            pid.at_rest_motor_pair(gains, m.theta_A, m.theta_B, 0.0, 0.0), gains, m.theta_A, m.theta_B
        )

    def _enter(
        self, now: TickContext, mode: Mode, motion: Motion | None, cause: Why, run: int = 0, *, completed: bool = False
    ) -> None:
        if self._program is not None or self.run not in (0, run):
            whole = completed or (self._program is None and not isinstance(cause, Fault))
            detail = self._pending_stop.detail if self._pending_stop is not None and isinstance(cause, Fault) else ""
            self._events.append(RunEnded(now.tick, self.run, whole, cause, detail))
        if self._program is not None:
            if self._program.law not in IDENTIFYING:
                self.push.let_go(now.tick)
            self._program = None
            self.tunings.end(now.tick)
        self._events.append(ModeChanged(now.tick, self.mode, mode, cause))
        self.mode, self.motion, self.run = mode, motion, run
        self.reached_told, self.contact.felt = False, cause is Cause.CONTACT

    def _enter_pretension(self, now: TickContext, cause: Why, *, completed: bool = False) -> None:
        carry, known, wound = self._carried(now.m), self.zeros.motors_known, self._programs.wound(PRETENSION_N)
        motion: Motion = PointToPointMotion(carry, *wound) if known else PretensionMotion(carry)
        self._enter(now, Mode.PRETENSION, motion, cause, completed=completed)

    def _take_zero(self, winding: PretensionMotion, now: TickContext) -> Measurement:
        """Set the encoders' zeros from the tensions: incremental encoders do not know where slack ends."""
        m = now.m
        move_A, move_B = self._programs.off_by(winding.tensions, m)
        self.contact.forget(now.tick)
        self.zeros.move(move_A, move_B)
        carry = winding.carry()
        state = pid.shift_motor_pair(carry.gains, carry.state, move_A, move_B)
        shifted = MotorLoopState(state, carry.gains, carry.theta_A_ref + move_A, carry.theta_B_ref + move_B)
        self.motion = PointToPointMotion(shifted, *self._programs.wound(PRETENSION_N))
        return m._replace(theta_A=m.theta_A + move_A, theta_B=m.theta_B + move_B)

    def _brake(self, now: TickContext, cause: Why) -> None:
        if isinstance(
            self.motion, CommissioningMotion
        ):  # which way it turns is not known: to brake could be to drive on
            self._enter(now, Mode.OFF, None, cause)
            return
        self._enter(now, Mode.STOPPING, Braking(self._carried(now.m), now.m, self.tunings.gains.u_max), cause)
