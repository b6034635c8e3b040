"""The control loop: steps, commands between them, zero volts at every exit."""

import logging
import math
from typing import Final, assert_never

import numpy as np

from backend.control import (
    AT_REST,
    CONTACT_DETECTED,
    CONTROL_COMPUTED,
    DISTURBANCE_CHANGED,
    FAULT_DETECTED,
    GAINS_CHANGED,
    MOTION_DONE,
    NO_EVENT,
    NO_REFERENCE,
    SLACK_MAX_S,
    DetectedFault,
    FaultDetectionState,
    StepInputs,
    TickRange,
    compute_bounds,
    fault_detection,
)
from backend.errors import check_range
from backend.faults import FAULT_CODE, Fault, Limit
from backend.realtime import messages
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Command,
    Event,
    Heartbeat,
    Home,
    Inject,
    Obstruct,
    PlantAnswers,
    PlantFailing,
    PlayRecording,
    ProveDirections,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    Shutdown,
    SimulateManualInput,
    Stop,
    SwitchDrives,
    TryModule,
    TryMotor,
    Zero,
)
from backend.realtime.commissioning_motions import TENSION_MAX_N, Homing, ModuleTrial, MotorTrial
from backend.realtime.contact import ManualDisturbance
from backend.realtime.gains import build_cascade_tuning
from backend.realtime.mode_manager import ModeManager, TickContext
from backend.realtime.modes import DRIVES_OFF, LEGAL, MODE_CODE, Cause, CommandRejectedError, HomingEnd, Mode
from backend.realtime.motions import Motion
from backend.realtime.program import ConfigureContactDetection, SetTuning
from backend.realtime.ring_buffer import Ring, SampleRing
from backend.realtime.shared_state import StepContext
from backend.sample import FIELDS
from backend.tuning import TuningParameters, collect_plant_knowledge
from plant import (
    NO_RAW,
    ZERO_VOLTS,
    HasLimitSwitch,
    InvariantError,
    Measurement,
    Message,
    MotorCommand,
    Plant,
    PlantError,
    PlantParameters,
    RawReading,
    Simulator,
    SupportsDirectionCheck,
    SupportsDriveEnable,
    SupportsManualInput,
    T_s,
    WatchdogDeadError,
    WatchdogExpiredError,
    elastic_deflection,
)

# Commissioning -------------------------------------------------------------------------------------
# Commands of commissioning, executed at zero or small voltages.


MIN_SWITCH_TRAVEL_RAD = 0.1
"""Least distance of an end switch from the joint's centre [rad]."""

CommissioningCommand = Zero | TryMotor | TryModule | Home | ProveDirections | SwitchDrives | SimulateManualInput


def execute_commissioning(
    command: CommissioningCommand, mode_manager: ModeManager, plant: Plant, context: TickContext
) -> None:
    """Execute a command. Raises CommandRejectedError, and PlantError if unsupported."""
    match command:
        case Zero():
            _require_off(mode_manager, messages.zero_can_be_set())
            set_zero(command, mode_manager, plant)
        case TryMotor(motor):
            _require_off_with_drives(mode_manager, messages.motor_can_be_tested())
            if isinstance(plant, SupportsDirectionCheck):
                plant.prove_directions(proven=False)  # until the test of the direction has succeeded
            mode_manager.start_commissioning_motion(
                lambda motor_loops: MotorTrial(motor_loops, NO_REFERENCE, context.m, motor), Cause.MOTOR_TRIAL, context
            )
        case Home(position):
            _start_homing(position, mode_manager, plant, context)
        case TryModule():
            mode_manager.start_module_trial(context)
        case ProveDirections(proven):
            if proven:
                _require_off(mode_manager, messages.directions_can_be_confirmed())
            if isinstance(plant, SupportsDirectionCheck):
                plant.prove_directions(proven=proven)
        case SwitchDrives(on):
            _switch_drives(mode_manager, plant, context, on=on)
        case SimulateManualInput(manual_input):
            if not isinstance(plant, SupportsManualInput):
                raise PlantError(messages.plant_without_manual_input())
            plant.apply_manual_input(manual_input)
        case _:
            assert_never(command)


def _switch_drives(mode_manager: ModeManager, plant: Plant, context: TickContext, *, on: bool) -> None:
    """Disable the drives in any mode, with zero volts, or enable them in OFF.

    If the card does not obey, the loop stays locked.
    """
    if not isinstance(plant, SupportsDriveEnable):
        raise PlantError(messages.plant_without_drive_switch())
    if on:
        _require_off(mode_manager, messages.drives_can_be_switched_on())
    elif mode_manager.mode not in (Mode.OFF, Mode.TRIPPED):
        mode_manager.begin_stop(Stop(Fault.STOP_PRESSED, hard=True), messages.stopped_by_switching_off(), context)
    mode_manager.drives_off = True  # until the card has obeyed
    plant.switch_drives(on=on)
    if on:
        mode_manager.drives_off = False


def set_zero(zero: Zero, mode_manager: ModeManager, plant: Plant) -> None:
    """Set the encoders' zeros from a given position of joint and motors.

    Raises PlantError.
    """
    plant.zero(zero.q, zero.theta_A, zero.theta_B, at_switch=zero.at_switch)
    mode_manager.zeros.reset()  # pretension sets the motors' zeros


def set_homed_zero(motion: Motion, mode_manager: ModeManager, plant: Plant, step: StepContext) -> None:
    """Set the zero that a successful homing has found. Raises PlantError."""
    if isinstance(motion, Homing) and motion.end is HomingEnd.HOMED:
        zero = Zero(motion.compute_joint_position(step.m.q), 0.0, 0.0)
        set_zero(zero, mode_manager, plant)
        step.reset_joint_position(zero.q)


def _start_homing(position: float, mode_manager: ModeManager, plant: Plant, context: TickContext) -> None:
    _require_off_with_drives(mode_manager, messages.homing_can_be_started())
    if not isinstance(plant, HasLimitSwitch):
        raise PlantError(messages.plant_without_end_switch())
    if plant.unproven:
        raise CommandRejectedError(plant.unproven)
    bounds, m = mode_manager.bounds, context.m
    check_range(
        "position", abs(position), MIN_SWITCH_TRAVEL_RAD, bounds.q_trip, "rad", label=messages.travel_to_switch()
    )
    if not (m.F_A <= TENSION_MAX_N and m.F_B <= TENSION_MAX_N):
        raise CommandRejectedError(messages.tendons_too_taut(F_A=m.F_A, F_B=m.F_B, maximum_N=TENSION_MAX_N))
    ratio, at_end = mode_manager.turns_per_joint, lambda: plant.at_end
    if not plant.zeroed:
        mode_manager.zeros.set_joint_centre(m.q)  # the operator confirmed this before the start
    mode_manager.start_commissioning_motion(
        lambda motor_loops: Homing(
            motor_loops=motor_loops, target=NO_REFERENCE, m=m, position=position, ratio=ratio, at_end=at_end
        ),
        Cause.HOMING,
        context,
    )


def _require_off(mode_manager: ModeManager, action: str) -> None:
    mode = mode_manager.mode
    if mode is not Mode.OFF:
        raise CommandRejectedError(messages.only_in_off(action=action, mode=mode), LEGAL[mode])


def _require_off_with_drives(mode_manager: ModeManager, action: str) -> None:
    _require_off(mode_manager, action)
    if mode_manager.drives_off:
        raise CommandRejectedError(DRIVES_OFF)


# Step inputs ---------------------------------------------------------------------------------------
# Inputs of the compiled step, from the mode manager.


def make_step_inputs(mode_manager: ModeManager) -> StepInputs:
    """Return the inputs of the next control step."""
    zeros, lambdas, push, motion = (
        mode_manager.zeros,
        mode_manager.tunings.lambdas,
        mode_manager.disturbances,
        mode_manager.motion,
    )
    trial = isinstance(motion, ModuleTrial)  # the provoked trip is evaluated at the end of the trial, then always
    return StepInputs(
        offset_A=zeros.offset_A,
        offset_B=zeros.offset_B,
        joint_centre=zeros.joint_centre,
        zeroed=zeros.is_motor_zero_known,
        tension_required=mode_manager.requires_tension,
        contact_threshold=mode_manager.contact.compute_threshold(motion),
        ignores_safety_trip=trial,
        tripped=trial and motion is not None and motion.done,
        completion_reported=mode_manager.is_completion_reported,
        F_push=push.F_push,
        load=push.load,
        tuning=mode_manager.tunings.number,
        obstacle=push.obstacle,
        contact_detection=push.contact_detection,
        mode=MODE_CODE[mode_manager.mode],
        run=mode_manager.run,
        lam_q=lambdas.lam_q,
        lam_S=lambdas.lam_S,
        fault=FAULT_CODE[mode_manager.fault],
        limits=Limit.CONTACT if mode_manager.contact.is_active else 0,
    )


# Plant monitoring ----------------------------------------------------------------------------------
# Monitoring of the plant: failures are reported at their beginning and end, not at every tick.


RECOVERY_S = 1.0
"""Time without a failure [s] after which the plant counts as healthy: occasional failures are reported once."""


class PlantHealthMonitor:
    """Monitors failures of the plant.

    ``failure`` is the message of a failure in the current tick, empty without one.
    """

    def __init__(self) -> None:
        self.failure = ""
        self._is_failing = False
        self._good_ticks = 0

    @property
    def is_healthy(self) -> bool:
        """Whether no failure of the plant is active."""
        return not self._is_failing

    def begin(self) -> None:
        """Begin a tick."""
        self.failure = ""

    def end(self, tick: int) -> list[Event]:
        """End a tick; return the events of a change."""
        self._good_ticks = 0 if self.failure else self._good_ticks + 1
        if self.failure and not self._is_failing:
            self._is_failing = True
            return [PlantFailing(tick, self.failure)]
        if self._is_failing and self._good_ticks * T_s >= RECOVERY_S:
            self._is_failing = False
            return [PlantAnswers(tick)]
        return []


# Sensor checks -------------------------------------------------------------------------------------
# Messages for implausible readings that ``backend.control.fault_detection`` finds.


_NAMES: Final = ("q", "theta_A", "theta_B", "F_A", "F_B")
_UNITS: Final = ("rad", "rad", "rad", "N", "N")


def describe_implausible_reading(
    fault: DetectedFault, previous: Measurement, raw: Measurement, m: Measurement, command: MotorCommand
) -> tuple[Fault, str]:
    """Return fault and message for implausible readings.

    ``previous`` and ``raw`` are as read, before and now; in ``m`` the motors count from their zeros; ``command`` was
    written in between.
    """
    side, unchanged = fault.which, fault.still
    if fault.verdict == fault_detection.JUMPED:
        return Fault.SENSOR_JUMP, messages.sensor_jumped(
            sensor=_NAMES[side], before=previous[side], after=raw[side], unit=_UNITS[side]
        )
    theta, F = _NAMES[1 + side], _NAMES[3 + side]
    if fault.verdict == fault_detection.REVERSED:
        return Fault.MOTOR_REVERSED, messages.motor_reversed(encoder=theta, u=command[side])
    if fault.verdict == fault_detection.UNMOVED:
        return Fault.SENSOR_STUCK, messages.motor_encoder_stuck(encoder=theta, angle=raw[1 + side], u=command[side])
    if fault.verdict == fault_detection.STUCK:
        return Fault.SENSOR_STUCK, messages.load_cell_stuck(
            load_cell=F, F=raw[3 + side], turned=fault_detection.TURNED_RAD
        )
    difference = messages.tension_unlike_encoders(load_cell=F, F=m[3 + side], F_encoders=m[3 + side] - fault.excess)
    if unchanged >= 0:
        return Fault.SENSOR_STUCK, messages.sensor_unchanged(sensor=_NAMES[unchanged], difference=difference)
    return Fault.IMPLAUSIBLE, difference


# Checks --------------------------------------------------------------------------------------------
# Messages for faults that the control step detects (``backend.control.fault_detection``).


class FaultDescriber:
    """Describes the faults of one plant."""

    def __init__(self, parameters: PlantParameters) -> None:
        self._bounds = compute_bounds(parameters)
        self._mechanism = None if parameters.mechanism is None else parameters.mechanism.make_mechanism()
        self._deflection_max = parameters.safety.deflection_max

    def describe(
        self,
        fault: DetectedFault,
        state: FaultDetectionState,
        m: Measurement,
        checked: Measurement,
        command: MotorCommand,
        card_reading: RawReading,
        missed: int,
    ) -> tuple[Fault, str]:
        """Return the fault and a description of its observation.

        In ``m`` the motors count from their zeros, in ``checked`` the joint from its centre as well; ``card_reading``
        are the raw values, ``missed`` the deadlines missed since the last tick.
        """
        match fault.kind:
            case fault_detection.NOT_FINITE | fault_detection.OUT_OF_BOUNDS:
                return self.find_static_fault(checked, card_reading)
            case fault_detection.TRIPPED:
                if self._mechanism is not None:
                    deflection = elastic_deflection(self._mechanism, m.q, m.theta_A, m.theta_B)
                    return Fault.SAFETY_MODULE, messages.deflection_at_trip(deflection=deflection, q=m.q)
                return Fault.SAFETY_MODULE, messages.readings_at_trip(F_A=m.F_A, F_B=m.F_B, q=m.q)
            case fault_detection.IMPLAUSIBLE_READING:
                return describe_implausible_reading(fault, state.previous, state.newest, m, command)
            case fault_detection.SLACK:
                return Fault.SLACK, messages.tendons_slack(
                    F_A=m.F_A, F_B=m.F_B, minimum_N=self._bounds.F_slack, duration_s=SLACK_MAX_S
                )
            case _:
                return Fault.DEADLINES_MISSED, messages.deadlines_missed(count=missed)

    def find_static_fault(self, m: Measurement, card_reading: RawReading = NO_RAW) -> tuple[Fault, str]:
        """Return the fault that one measurement shows without its history."""
        bounds, sensors = self._bounds, m._fields[: 5 if self._mechanism is None else 3]
        invalid = [name for name in sensors if not math.isfinite(getattr(m, name))]
        if invalid:
            volts = {"F_A": card_reading.V_A, "F_B": card_reading.V_B}  # finite volts without a valid tension
            saturated = {name: volts[name] for name in invalid if math.isfinite(volts.get(name, math.nan))}
            if len(saturated) == len(invalid):
                return Fault.SENSOR_SATURATED, messages.load_cells_saturated(voltages=saturated)
            return Fault.SENSOR_INVALID, messages.sensors_without_reading(sensors=tuple(invalid))
        if self._mechanism is not None:
            deflection = elastic_deflection(self._mechanism, m.q, m.theta_A, m.theta_B)
            if abs(deflection) > self._deflection_max:
                detail = messages.deflection_too_large(deflection=deflection, maximum=self._deflection_max)
                return Fault.FORCE_LIMIT, detail
        if max(m.F_A, m.F_B) > bounds.F_max:
            return Fault.FORCE_LIMIT, messages.tension_too_high(F_A=m.F_A, F_B=m.F_B, maximum_N=bounds.F_max)
        if abs(m.q) > bounds.q_trip:
            return Fault.JOINT_LIMIT, messages.joint_out_of_range(q=m.q, maximum=bounds.q_trip)
        return Fault.NONE, ""


# Loop ----------------------------------------------------------------------------------------------
# The control loop: one tick, commands between two ticks, and zero volts at every exit.
#
# The same class runs live in the loop process and headless for the command line; they differ only in who calls
# ``tick``.


_FAULTS_WITHOUT_MOTION = (Fault.SAFETY_MODULE, Fault.SENSOR_INVALID, Fault.SENSOR_SATURATED)


_LOG = logging.getLogger(__name__)


class Loop:
    """Control of one plant. ``finished``: a Shutdown was received."""

    def __init__(self, plant: Plant, parameters: PlantParameters, ring: SampleRing, tuning: SetTuning) -> None:
        self._plant, self._ring, self.finished = plant, ring, False
        self._plant_model = plant_model = collect_plant_knowledge(parameters)
        self._u_max, self._has_internal_error = parameters.motor.u_max, False
        self.bounds = plant_model.bounds
        self._fault_describer, self._plant_watch = FaultDescriber(parameters), PlantHealthMonitor()
        self._tick = self._newest_tick = self._overruns = 0
        self._command = ZERO_VOLTS  # last command written
        self._inputs_outdated = True  # whether the step's inputs may differ from the mode manager
        self._manual_disturbance, self._row = ManualDisturbance(plant), np.zeros(len(FIELDS))
        self._events: list[Event] = []
        gains = build_cascade_tuning(tuning, self._plant_model)
        # before the plant opens: a card waits for at most 50 ms then
        self._step = StepContext(parameters, plant.unattended_max_s, gains)
        try:
            plant.open()
            self._step.begin(plant.read())
            self._mode_manager = ModeManager(
                plant=plant,
                parameters=parameters,
                step=self._step,
                tuning=gains,
                lambdas=TuningParameters(tuning.lam_q, tuning.lam_S),
                events=self._events,
            )
        except BaseException:  # the drives may be on, and only this object can close the plant
            self.close()
            raise

    @property
    def mode(self) -> Mode:
        """Current mode."""
        return self._mode_manager.mode

    @property
    def fault(self) -> Fault:
        """Latched fault, or NONE."""
        return self._mode_manager.fault

    @property
    def is_pretension_done(self) -> bool:
        """Whether the transitions from pretension to motion are permitted."""
        return self._mode_manager.is_pretension_done

    @property
    def readiness(self) -> tuple[str, bool]:
        """What must precede pretension, empty for nothing; whether drives are locked off."""
        return self._mode_manager.unready, self._mode_manager.drives_off

    def drain_events(self) -> list[Event]:
        """Return the events since the last call, oldest first."""
        events, self._events[:] = list(self._events), []
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Execute or reject a command between two ticks; the reply is queued as an event."""
        events, tick = self._events, self._tick
        self._inputs_outdated = True
        try:
            self._execute(command)
        except CommandRejectedError as refused:
            events.append(Refused(sequence, tick, refused.message, refused.legal))
        except (ValueError, PlantError) as error:
            events.append(Refused(sequence, tick, _get_reason(error)))
        except AssertionError:  # from assert_never: a service of another version
            events.append(Refused(sequence, tick, messages.unknown_command(command=type(command).__name__)))
        except Exception as error:  # a programming error; the state it left must not produce voltages
            self._trip_on_internal_error(error)
            reason = messages.command_failed(command=type(command).__name__, reason=_describe_error(error))
            events.append(Refused(sequence, tick, reason))
        else:
            events.append(Accepted(sequence, tick))

    def _execute(self, command: Command) -> None:
        self._dispatch(command)
        self._mode_manager.require_consistent()

    def _dispatch(self, command: Command) -> None:
        if isinstance(command, CommissioningCommand):
            execute_commissioning(
                command, self._mode_manager, self._plant, TickContext(self._newest_tick, self._step.m)
            )
            if isinstance(command, Zero):
                self._step.reset_joint_position(command.q)
            return
        match command:
            case Stop():
                self._mode_manager.begin_stop(command, command.detail, TickContext(self._newest_tick, self._step.m))
            case SetMode():
                self._mode_manager.set_mode(command, TickContext(self._newest_tick, self._step.m))
            case SetReferences():
                self._mode_manager.set_references(command)
            case SetTuning():
                self._mode_manager.set_tuning(
                    build_cascade_tuning(command, self._plant_model), TuningParameters(command.lam_q, command.lam_S)
                )
            case ConfigureContactDetection():
                self._mode_manager.contact.configure(command)
            case RunProgram():
                self._mode_manager.run_program(command, TickContext(self._newest_tick, self._step.m))
            case ApplyPush():
                self._manual_disturbance.begin(command, self._tick, self._mode_manager.mode)
            case Inject():
                self._plant.inject(command.injected_fault)
            case Obstruct():
                self._mode_manager.disturbances.set_obstacle(command.obstacle, self._tick)
            case Reset():
                self._reset()
            case Shutdown():
                self.finished = True
            case Heartbeat():
                pass
            case PlayRecording():
                raise CommandRejectedError(messages.no_recording_replayed())
            case _:
                assert_never(command)

    def _reset(self) -> None:
        mode_manager = self._mode_manager
        if mode_manager.mode is not Mode.TRIPPED:
            raise CommandRejectedError(messages.no_fault_to_reset(mode=mode_manager.mode), LEGAL[mode_manager.mode])
        if self._has_internal_error:
            raise CommandRejectedError(messages.loop_failed_in_own_code())
        fault, detail = self._fault_describer.find_static_fault(
            mode_manager.zeros.subtract_joint_centre(self._step.m), self._plant.raw
        )
        detail = self._plant_watch.failure or detail
        if fault is not Fault.NONE or self._plant_watch.failure:
            raise CommandRejectedError(messages.cause_of_fault_persists(reason=detail))
        mode_manager.reset(TickContext(self._newest_tick, self._step.m))

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """Execute a period: read, check, compute, write, store. Zero volts on any error."""
        self._make_tick(None, lateness_s, overruns)

    def run(self, ticks: int) -> int:
        """Execute at least one and at most ``ticks`` ticks; return how many.

        Runs a batch if no tick needs Python code. An event ends the batch, and its tick is completed in Python.
        """
        plant, ring, mode_manager, step = self._plant, self._ring, self._mode_manager, self._step
        is_quiet = self._plant_watch.is_healthy and not mode_manager.has_unreported_stop
        can_batch = is_quiet and self._manual_disturbance.is_idle and mode_manager.python_motion is None
        count = plant.count_batchable_ticks(ticks) if can_batch and isinstance(plant, Simulator) else 0
        if not (count and isinstance(plant, Simulator) and isinstance(ring, Ring)):
            self.tick(overruns=self._overruns)
            return 1
        self._update_inputs()
        tick_range = TickRange(self._tick, plant.periods, count, self._overruns)
        done, events, u_A, u_B, m = step.run(plant.simulated, plant.read(), tick_range, ring.rows)
        plant.complete_batch(done, m)
        ring.count_in(done)
        mode_manager.disturbances.set_state(*step.active_disturbance)
        self._tick += done
        self._newest_tick = self._tick - 1
        self._command = step.command
        if events == NO_EVENT:
            return done
        self._make_tick((events, u_A, u_B), 0.0, self._overruns)
        return done + 1

    def _make_tick(self, computed: tuple[int, float, float] | None, lateness_s: float, overruns: int) -> None:
        """Execute a tick, or the rest of one that a batch has ``computed``.

        ``computed`` are its events so far and its voltages [V].
        """
        mode_manager, missed = self._mode_manager, overruns - self._overruns
        self._newest_tick = self._tick
        self._plant_watch.begin()
        self._events += self._manual_disturbance.step(self._tick, mode_manager.mode)
        command, has_changed = ZERO_VOLTS, self._inputs_outdated
        try:
            events, u_A, u_B = computed or self._begin_tick(missed)
            if events not in (NO_EVENT, CONTROL_COMPUTED) or mode_manager.python_motion is not None:
                u_A, u_B = self._handle_events(events, missed)
                self._inputs_outdated = True
            if mode_manager.mode not in (Mode.OFF, Mode.TRIPPED):
                self._require_valid_voltages(u_A, u_B)
                command = MotorCommand(u_A, u_B)
            if has_changed or self._inputs_outdated:
                mode_manager.require_consistent()
        except PlantError as error:
            command = ZERO_VOLTS
            self._step.output = AT_REST
            self._trip_on_plant_error(error)
        except Exception as error:  # a programming error trips; it never leaves a voltage on
            command = ZERO_VOLTS
            self._step.output = AT_REST
            self._trip_on_internal_error(error)
        finally:
            self._write(command)
        self._events += self._plant_watch.end(self._tick)
        self._overruns = overruns
        self._update_inputs()
        self._step.write_row(self._row, self._tick, self._command, self._plant.raw, lateness_s, overruns)
        try:
            self._ring.append(self._row)
        except InvariantError as error:
            self._trip_on_internal_error(error)
            self._write(ZERO_VOLTS)
        self._tick += 1

    def _begin_tick(self, missed: int) -> tuple[int, float, float]:
        """Read, detect faults, step a compiled motion; return events and voltages [V]."""
        step, raw = self._step, self._plant.read()
        self._update_inputs()
        detected = step.detect_faults(raw, missed)
        if detected != NO_EVENT or self._mode_manager.python_motion is not None:
            return detected, 0.0, 0.0
        return step.compute_control()

    def _update_inputs(self) -> None:
        if self._inputs_outdated:
            self._step.set_inputs(make_step_inputs(self._mode_manager))
            self._inputs_outdated = False

    def _handle_events(self, events: int, missed: int) -> tuple[float, float]:
        """Handle the events of a step; return its voltages [V]."""
        mode_manager, step = self._mode_manager, self._step
        if events & FAULT_DETECTED:
            self._handle_fault(missed)
        elif events & CONTACT_DETECTED:
            mode_manager.react_to_contact(TickContext(self._newest_tick, step.m))
        step.set_inputs(make_step_inputs(mode_manager))
        if mode_manager.python_motion is not None:
            output = step.output = mode_manager.python_motion.step(mode_manager.tunings.gains, step.m)
            events = MOTION_DONE if mode_manager.python_motion.done else NO_EVENT
        else:
            if events & (FAULT_DETECTED | CONTACT_DETECTED):
                events, _, _ = step.compute_control()
            output = step.output
        if events & DISTURBANCE_CHANGED:
            mode_manager.disturbances.apply_setpoint(output.setpoint, self._newest_tick)
        if events & GAINS_CHANGED:
            mode_manager.tunings.use(output.setpoint.tuning, self._newest_tick)
        motion, m = mode_manager.motion, step.m
        if events & MOTION_DONE and motion is not None:
            motion.done = True
            set_homed_zero(motion, mode_manager, self._plant, step)
            step.m = mode_manager.end_motion(TickContext(self._newest_tick, m))
        return output.u_A, output.u_B

    def _handle_fault(self, missed: int) -> None:
        """Stop because of a fault, unless the motors are off and only motion matters."""
        mode_manager, step, m, command = self._mode_manager, self._step, self._step.m, self._command
        if mode_manager.mode is Mode.TRIPPED:
            return
        checked = mode_manager.zeros.subtract_joint_centre(m)
        fault, detail = self._fault_describer.describe(
            step.detected_fault, step.fault_state, m, checked, command, self._plant.raw, missed
        )
        if mode_manager.motion is not None or fault in _FAULTS_WITHOUT_MOTION:
            mode_manager.begin_stop(Stop(fault), detail, TickContext(self._newest_tick, m))

    def _write(self, command: MotorCommand) -> None:
        mode_manager = self._mode_manager
        try:
            self._plant.write(command)
            self._command = command  # a failed write leaves the outputs unchanged
        except (WatchdogExpiredError, WatchdogDeadError) as error:
            # The drives are off already: this is zero volts, and stays so until a reset.
            self._command = ZERO_VOLTS
            self._inputs_outdated = True
            if mode_manager.mode is not Mode.TRIPPED:
                fault = Fault.WATCHDOG if isinstance(error, WatchdogExpiredError) else Fault.WATCHDOG_DEAD
                mode_manager.begin_stop(Stop(fault), str(error), TickContext(self._newest_tick, self._step.m))
        except PlantError as error:
            self._trip_on_plant_error(error)
            return
        mode_manager.report_stopped(self._tick)

    def _require_valid_voltages(self, u_A: float, u_B: float) -> None:
        """Raise InvariantError for a voltage beyond ±u_max or NaN."""
        u_max = self._u_max
        if not (-u_max <= u_A <= u_max and -u_max <= u_B <= u_max):
            raise InvariantError(f"the control step computed {u_A} V and {u_B} V, beyond ±{u_max:g} V")

    def _trip_on_internal_error(self, error: Exception) -> None:
        """Trip because of an error in the program. This loop cannot be reset afterwards."""
        self._inputs_outdated = True
        if self._has_internal_error:
            return
        self._has_internal_error = True
        _LOG.critical("The control loop failed: %s", _describe_error(error), exc_info=error)
        stop = Stop(Fault.INTERNAL_ERROR)
        self._mode_manager.begin_stop(stop, _describe_error(error), TickContext(self._newest_tick, self._step.m))
        self._mode_manager.fault = Fault.INTERNAL_ERROR  # shows the service that a reset must start a new loop

    def _trip_on_plant_error(self, error: PlantError) -> None:
        self._plant_watch.failure = str(error)
        self._inputs_outdated = True
        if self._mode_manager.mode is not Mode.TRIPPED:
            self._mode_manager.begin_stop(
                Stop(Fault.PLANT_ERROR), str(error), TickContext(self._newest_tick, self._step.m)
            )

    def close(self) -> None:
        """Write zero volts and close the plant. Safe to call twice."""
        try:
            self._plant.write(ZERO_VOLTS)
        except PlantError:
            pass
        finally:
            self._plant.close()


def _get_reason(error: ValueError | PlantError) -> str:
    """Return the text of an error, with its code if it is of a catalogue."""
    (text, *_) = error.args or ("",)
    return text if isinstance(text, Message) else str(error)


def _describe_error(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
