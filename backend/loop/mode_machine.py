"""The moves between modes: which are granted, what starts with them, and what follows when a motion has ended."""

import time
from collections.abc import Callable
from contextlib import suppress

from backend.controllers import motors
from backend.controllers.cascade import Tuning
from backend.controllers.decoupler import decoupler_for
from backend.controllers.limits import bounds_for
from backend.faults import Fault
from backend.loop.causes import Cause, Why
from backend.loop.commands import (
    Event,
    ModeChanged,
    PretensionReached,
    ProgramEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
)
from backend.loop.mode import DRIVES_OFF, LEGAL, Mode, RefusedError
from backend.loop.module_trial import ModuleTrial
from backend.loop.motion import NO_REFERENCE, PRETENSION_N, Braking, Carry, ForceHold, Motion, Travel, Trial, Winding
from backend.loop.motor_steps import MotorSteps
from backend.loop.pending_stop import PendingStop
from backend.loop.player import Target
from backend.loop.program import IDENTIFYING, Law, Program, Segment, mode_of_law, require_able, require_few, starts_from
from backend.loop.tension_sweep import TensionSweep
from backend.loop.tracking import BASELINES, Baseline, Tracking
from backend.refusal import require_within
from backend.tuning.models import Lambdas
from plant.interface import NO_LOAD, Measurement, Plant, PlantError, Proven, ShaftLoad
from plant.parameters import PlantParameters
from plant.spring import elongation

_DOUBTS_ZEROS = (Fault.SENSOR_JUMP, Fault.SENSOR_STUCK, Fault.IMPLAUSIBLE, Fault.MOTOR_REVERSED)
"""After these the encoders' zeros may be wrong: pretension winds up from slack again and finds them anew."""


class ModeMachine:
    """Mode, motion and latched fault of one loop. The loop sets ``m`` and ``tick`` before it asks for anything.

    ``zeroed`` tells that the zeros of the motor encoders are known, ``drives_off`` that hands may be at the rig,
    ``middle`` [rad] where the joint reads that is said to be in its middle.
    """

    def __init__(
        self, plant: Plant, parameters: PlantParameters, tuning: Tuning, lambdas: Lambdas, m: Measurement
    ) -> None:
        self.mode = Mode.OFF
        self.fault = Fault.NONE
        self.motion: Motion | None = None
        self.run = self.tick = 0
        self.m = m
        self.tuning = tuning
        self.lambdas = lambdas
        self.bounds = bounds_for(parameters)
        self.pending_stop: PendingStop | None = None
        self.events: list[Event] = []
        self.offset_A = self.offset_B = self.middle = 0.0
        self._plant = plant
        self._parameters = parameters
        self._spring_A, self._spring_B = parameters.identified_spring("A"), parameters.identified_spring("B")
        self._geometry = decoupler_for(parameters)
        self.turns_per_joint = self._geometry.r_j / self._geometry.r_m
        self._program: Program | None = None
        self.zeroed = self.drives_off = False
        self.F_push, self.load = 0.0, NO_LOAD
        self._reached_told = False

    @property
    def pretension_done(self) -> bool:
        """Whether pretension has been reached and both tendons are held."""
        return self.mode is Mode.PRETENSION and isinstance(self.motion, Travel) and self.motion.done

    @property
    def unready(self) -> str:
        """What has to come before pretension; empty where nothing has."""
        return DRIVES_OFF if self.drives_off else self._plant.unready

    @property
    def keeps_taut(self) -> bool:
        """Whether slack would be a fault now: everywhere under control but on the way to pretension.

        Voltage steps are made with slack tendons on purpose.
        """
        on_the_way = self.mode is Mode.PRETENSION and not self._reached_told
        slack_wanted = isinstance(self.motion, MotorSteps | Trial)
        closed = self.motion is not None and self.zeroed and self.mode is not Mode.STOPPING
        return closed and not on_the_way and not slack_wanted

    def heard(self) -> Measurement:
        """Return what the checks are told: the joint from its middle, also where its encoder counts from elsewhere."""
        m = self.motion.heard(self.m) if isinstance(self.motion, ModuleTrial) else self.m
        return m._replace(q=m.q - self.middle) if self.middle else m

    def set_mode(self, command: SetMode) -> None:
        """Carry out an operator's move. Raises RefusedError."""
        mode = command.mode
        self._require_legal(mode)
        if isinstance(self.motion, Trial) and mode is not Mode.STOPPING:
            raise RefusedError("a motor is being tried: wait for its end or stop it", LEGAL[self.mode])
        if mode is Mode.PRETENSION:
            if self.unready:
                raise RefusedError(self.unready)
            self._enter_pretension(Cause.ASKED_FOR)
        elif mode is Mode.OFF:
            self._enter(Mode.OFF, None, Cause.ASKED_FOR)
        elif mode is Mode.STOPPING:
            self._brake(Cause.ASKED_FOR)
        elif mode in (Mode.RUN, Mode.COMPLIANCE):
            self._require_taut(mode)
            motion = Tracking(self.tuning, self._carried(), self.m, self.bounds, mode is Mode.RUN)
            self._enter(mode, motion, Cause.ASKED_FOR, command.run)
        else:
            raise RefusedError(f"{mode} starts with a program, not by itself", LEGAL[self.mode])

    def run_program(self, command: RunProgram) -> None:
        """Start a program. Raises RefusedError or OutOfRangeError before anything has moved."""
        program = command.program
        mode = mode_of_law(program.law)
        self._require_legal(mode)
        self._require_taut(mode)
        if not starts_from(program.law, self.mode):
            reason = f"a {program.law} program starts from pretension, where the joint is brought to 0 first"
            raise RefusedError(reason, LEGAL[self.mode])
        motion: Motion
        if program.law is Law.FORCE_HOLD:
            # Motor B stays at zero: what motor A winds stretches both springs.
            theta_A = sum(self._wound(program.tension_N))
            motion = ForceHold(self._carried(), NO_REFERENCE, program, theta_A)
        elif program.law is Law.MOTOR_STEPS:
            motion = self._motor_steps(program)
        elif program.law is Law.TENSION_SWEEP:
            motion = self._tension_sweep(program)
        else:
            require_few(program.segments)
            q_min, q_max, S_min, S_max = self.bounds.q_min, self.bounds.q_max, self.bounds.S_min, self.bounds.S_max
            for segment in program.segments:
                # Most are plain and good, and a thousand calls would take half a period.
                good = q_min <= segment.q_ref <= q_max and S_min <= segment.S_ref <= S_max
                if not good or segment.F_push or segment.load_A or segment.load_B:
                    self._require_segment(segment)
            motion = self._following(program)
        self._enter(mode, motion, Cause.PROGRAM, command.run)
        self._program = program

    def try_out(self, made: Callable[[Carry], Motion], cause: Why) -> None:
        """Play what the bring-up asks for, from OFF."""
        self._enter(Mode.IDENTIFY, made(self._carried()), cause)

    def set_tuning(self, tuning: Tuning, lambdas: Lambdas) -> None:
        """Replace all gains of the cascade. Raises RefusedError while a law without them plays."""
        if isinstance(self.motion, Baseline):
            raise RefusedError("the gains of a baseline are fixed while its program plays: wait for its end or stop it")
        self.tuning, self.lambdas = tuning, lambdas

    def set_references(self, command: SetReferences) -> None:
        """Move the operator's references. Raises RefusedError or OutOfRangeError."""
        if self.mode not in (Mode.RUN, Mode.COMPLIANCE) or not isinstance(self.motion, Tracking):
            raise RefusedError(f"references are the operator's in run and compliance only; the mode is {self.mode}")
        self._require_references(command.q_ref, command.S_ref)
        self.motion.target = Target(float(command.q_ref), float(command.S_ref), 0.0)

    def reset(self) -> None:
        """Leave TRIPPED; the loop has made sure that the cause is gone. Raises RefusedError or PlantError."""
        self._plant.acknowledge()
        self.fault = Fault.NONE
        self._enter(Mode.OFF, None, Cause.RESET)

    def begin_stop(self, stop: Stop, detail: str) -> None:
        """Latch the fault and go to zero volts at once (hard) or after braking (soft). Never refused."""
        if self.pending_stop is None or stop.hard:
            self.pending_stop = PendingStop(stop, self.tick, time.perf_counter(), detail)
        if self.mode is Mode.TRIPPED:
            return
        self.fault = stop.fault
        if stop.fault in _DOUBTS_ZEROS:
            self.zeroed = False
        if stop.fault is Fault.MOTOR_REVERSED and isinstance(self._plant, Proven):
            self._plant.prove_directions(proven=False)
        if stop.hard or self.motion is None or isinstance(self.motion, Trial):
            self._enter(Mode.TRIPPED, None, stop.fault)
        elif self.mode is not Mode.STOPPING:
            self._brake(stop.fault)

    def end_motion(self) -> None:
        """Go on from a motion that has reached its end by itself."""
        if isinstance(self.motion, Winding):
            self._take_zero(self.motion)
        elif isinstance(self.motion, Trial):
            self._enter(Mode.OFF, None, self.motion.cause)
        elif self.mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
            self._enter_pretension(Cause.PROGRAM_ENDED, completed=True)
        elif self.pretension_done and not self._reached_told:
            self._reached_told = True
            self.events.append(PretensionReached(self.tick))
        elif self.mode is Mode.STOPPING:
            self._enter(Mode.OFF if self.fault is Fault.NONE else Mode.TRIPPED, None, Cause.STANDING)

    def _following(self, program: Program) -> Motion:
        carry, m, bounds = self._carried(), self.m, self.bounds
        if program.law in BASELINES:
            parameters, lambdas = self._parameters, self.lambdas
            return Baseline(program.law, parameters, lambdas, self.tuning, carry, m, bounds, program.segments)
        return Tracking(self.tuning, carry, m, bounds, program.law is Law.CASCADE, program.segments)

    def _require_legal(self, mode: Mode) -> None:
        legal = LEGAL[self.mode]
        if mode not in legal:
            names = ", ".join(legal) or "none: reset the fault first"
            raise RefusedError(f"{self.mode} cannot go to {mode}; legal now: {names}", legal)

    def _require_taut(self, mode: Mode) -> None:
        if self.mode is Mode.PRETENSION and not self.pretension_done:
            raise RefusedError(f"{mode} has to wait until both tendons hold {PRETENSION_N:g} N", LEGAL[self.mode])

    def _require_references(self, q_ref: float, S_ref: float) -> None:
        require_within("q_ref", q_ref, self.bounds.q_min, self.bounds.q_max, "rad")
        require_within("S_ref", S_ref, self.bounds.S_min, self.bounds.S_max, "N·m/rad")

    def _require_segment(self, segment: Segment) -> None:
        self._require_references(segment.q_ref, segment.S_ref)
        require_able(segment, pushes=self._plant.pushes, loads_shafts=self._plant.loads_shafts)

    def _motor_steps(self, program: Program) -> MotorSteps:
        if not program.steps:
            raise RefusedError("a program of voltage steps needs at least one step")
        theta_max = self._geometry.r_j / self._geometry.r_m * self.bounds.q_trip  # what the joint's range winds up
        for step in program.steps:
            require_within("theta_start", step.theta_start, -theta_max, 0.0, "rad", "0 is where the tendons go slack")
            require_within("u", step.u, -self.bounds.u_max, self.bounds.u_max, "V")
        centre = self._wound(PRETENSION_N)
        return MotorSteps(self._carried(), NO_REFERENCE, program, centre, self.bounds.F_slack, theta_max)

    def _tension_sweep(self, program: Program) -> TensionSweep:
        if not program.legs:
            raise RefusedError("a sweep of the tension needs at least one leg")
        tensions = (program.tension_N, *(leg.tension_N for leg in program.legs))
        for tension_N in tensions:
            require_within("tension_N", tension_N, self.bounds.F_slack, self.bounds.F_max, "N")
        return TensionSweep(self._carried(), NO_REFERENCE, program, tuple(map(self._wound, tensions)))

    def _carried(self) -> Carry:
        if self.motion is not None:
            return self.motion.carry()
        gains, m = self.tuning.motors, self.m
        return Carry(motors.at_rest(gains, m.theta_A, m.theta_B, 0.0, 0.0), gains, m.theta_A, m.theta_B)

    def _enter(self, mode: Mode, motion: Motion | None, cause: Why, run: int = 0, *, completed: bool = False) -> None:
        if self._program is not None:
            self.events.append(ProgramEnded(self.tick, self.run, completed))
            if self._program.law not in IDENTIFYING:
                with suppress(PlantError):  # whoever pushes the plant has let go of it with it
                    self.act_on_joint(0.0, NO_LOAD)
            self._program = None
        self.events.append(ModeChanged(self.tick, self.mode, mode, cause))
        self.mode, self.motion, self.run = mode, motion, run
        self._reached_told = False

    def act_on_joint(self, F_push: float, load: ShaftLoad) -> None:
        """Push [N] and load the shafts; what can do neither is not asked to while the program does not. PlantError."""
        (F_before, load_before), (self.F_push, self.load) = (self.F_push, self.load), (F_push, load)
        if load != load_before:
            self._plant.load(load)
        if F_push != F_before:
            self._plant.push(F_push)

    def _wound(self, F: float) -> tuple[float, float]:
        """theta_A, theta_B [rad] that hold F [N] in both tendons at q = 0."""
        r_m = self._geometry.r_m
        return elongation(self._spring_A, F) / r_m, elongation(self._spring_B, F) / r_m

    def _enter_pretension(self, cause: Why, *, completed: bool = False) -> None:
        carry, known, wound = self._carried(), self.zeroed, self._wound(PRETENSION_N)
        motion: Motion = Travel(carry, NO_REFERENCE, *wound) if known else Winding(carry, NO_REFERENCE)
        self._enter(Mode.PRETENSION, motion, cause, completed=completed)

    def _take_zero(self, winding: Winding) -> None:
        """Set the encoders' zeros from the tensions: incremental encoders do not know where slack ends."""
        r_m, r_j = self._geometry.r_m, self._geometry.r_j
        (F_A, F_B), m = winding.tensions, self.m
        move_A = (elongation(self._spring_A, F_A) + r_j * m.q) / r_m - m.theta_A
        move_B = (elongation(self._spring_B, F_B) - r_j * m.q) / r_m - m.theta_B
        self.offset_A += move_A
        self.offset_B += move_B
        self.m = m._replace(theta_A=m.theta_A + move_A, theta_B=m.theta_B + move_B)
        carry = winding.carry()
        state = motors.shift(carry.gains, carry.state, move_A, move_B)
        shifted = Carry(state, carry.gains, carry.theta_A_ref + move_A, carry.theta_B_ref + move_B)
        self.zeroed = True
        self.motion = Travel(shifted, NO_REFERENCE, *self._wound(PRETENSION_N))

    def _brake(self, cause: Why) -> None:
        if isinstance(self.motion, Trial):  # which way it turns is not known: to brake could be to drive on
            self._enter(Mode.OFF, None, cause)
            return
        self._enter(Mode.STOPPING, Braking(self._carried(), NO_REFERENCE, self.m), cause)
