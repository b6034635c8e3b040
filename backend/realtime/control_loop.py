"""The control loop: one control step, the commands between two steps, zero volts at every exit."""

import logging
import math
from collections.abc import Callable
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
from backend.realtime.gains import tuning_of
from backend.realtime.mode_manager import ModeManager, TickContext
from backend.realtime.modes import DRIVES_OFF, LEGAL, MODE_CODE, Cause, CommandRejectedError, HomingEnd, Mode
from backend.realtime.motions import Motion
from backend.realtime.program import ConfigureContactDetection, SetTuning
from backend.realtime.ring_buffer import Ring, SampleRing
from backend.realtime.shared_state import StepContext
from backend.sample import FIELDS
from backend.tuning import TuningParameters, collect_plant_knowledge
from backend.units import in_digits
from plant import (
    NO_RAW,
    ZERO_VOLTS,
    Handled,
    HasLimitSwitch,
    InvariantError,
    Measurement,
    MotorCommand,
    Plant,
    PlantError,
    PlantParameters,
    RawReading,
    Simulator,
    SupportsDirectionCheck,
    SupportsDriveEnable,
    T_s,
    WatchdogDeadError,
    WatchdogExpiredError,
)

# Bring up ------------------------------------------------------------------------------------------
#
# What bringing a rig up asks of the loop: at zero volts, or with little of them.


SHORTEST_RAD = 0.1
"""An end switch nearer to the joint's middle than this [rad] is none."""

CommissioningCommand = Zero | TryMotor | TryModule | Home | ProveDirections | SwitchDrives | SimulateManualInput


def carry_out(command: CommissioningCommand, machine: ModeManager, plant: Plant, now: TickContext) -> None:
    """Carry out a command. Raises CommandRejectedError, and PlantError where the plant has no such thing."""
    match command:
        case Zero():
            _require_off(machine, "a zero is set")
            set_zero(command, machine, plant)
        case TryMotor(motor):
            _require_free(machine, "a motor is tried")
            if isinstance(plant, SupportsDirectionCheck):
                plant.prove_directions(proven=False)  # until the step has come to its end
            machine.try_out(lambda carry: MotorTrial(carry, NO_REFERENCE, now.m, motor), Cause.MOTOR_TRIAL, now)
        case Home(position):
            _home(position, machine, plant, now)
        case TryModule():
            machine.try_module(now)
        case ProveDirections(proven):
            if proven:
                _require_off(machine, "directions are proven")
            if isinstance(plant, SupportsDirectionCheck):
                plant.prove_directions(proven=proven)
        case SwitchDrives(on):
            _switch_drives(machine, plant, now, on=on)
        case SimulateManualInput(hand):
            if not isinstance(plant, Handled):
                raise PlantError("nothing here is moved by this program's hand: do it at the rig")
            plant.by_hand(hand)
        case _:
            assert_never(command)


def _switch_drives(machine: ModeManager, plant: Plant, now: TickContext, *, on: bool) -> None:
    """Off in any mode, and with it zero volts; on in off only. What the card does not obey leaves the loop locked."""
    if not isinstance(plant, SupportsDriveEnable):
        raise PlantError("this plant has no drives that could be switched off")
    if on:
        _require_off(machine, "drives are switched on")
    elif machine.mode not in (Mode.OFF, Mode.TRIPPED):
        machine.begin_stop(Stop(Fault.STOP_PRESSED, hard=True), "the drives were switched off", now)
    machine.drives_off = True  # until the card has obeyed
    plant.switch_drives(on=on)
    if on:
        machine.drives_off = False


def set_zero(zero: Zero, machine: ModeManager, plant: Plant) -> None:
    """Let the encoders count from where joint and motors are said to stand. Raises PlantError."""
    plant.zero(zero.q, zero.theta_A, zero.theta_B, at_switch=zero.at_switch)
    machine.zeros.begin_anew()  # pretension finds the motors' zeros


def zero_where_homed(motion: Motion, machine: ModeManager, plant: Plant, step: StepContext) -> None:
    """Set the zero that a motion has found, if it was a homing that has. Raises PlantError."""
    if isinstance(motion, Homing) and motion.end is HomingEnd.HOMED:
        found = Zero(motion.position_of(step.m.q), 0.0, 0.0)
        set_zero(found, machine, plant)
        step.stands_at(found.q)


def _home(position: float, machine: ModeManager, plant: Plant, now: TickContext) -> None:
    _require_free(machine, "the joint is driven to its end switch")
    if not isinstance(plant, HasLimitSwitch):
        raise PlantError("this plant has no end switch that its joint could be driven to")
    if plant.unproven:
        raise CommandRejectedError(plant.unproven)
    bounds, m = machine.bounds, now.m
    check_range("position", abs(position), SHORTEST_RAD, bounds.q_trip, "rad", words="way to the end switch")
    if not (m.F_A <= TENSION_MAX_N and m.F_B <= TENSION_MAX_N):
        raise CommandRejectedError(
            f"the tendons hold {m.F_A:.1f} N and {m.F_B:.1f} N, at most {TENSION_MAX_N:g} N are safe: slacken them"
        )
    ratio, at_end = machine.turns_per_joint, lambda: plant.at_end
    if not plant.zeroed:
        machine.zeros.say_middle(m.q)  # that is what the person who started it has said
    machine.try_out(
        lambda carry: Homing(carry=carry, target=NO_REFERENCE, m=m, position=position, ratio=ratio, at_end=at_end),
        Cause.HOMING,
        now,
    )


def _require_off(machine: ModeManager, what: str) -> None:
    if machine.mode is not Mode.OFF:
        raise CommandRejectedError(f"{what} in off only; the mode is {machine.mode}", LEGAL[machine.mode])


def _require_free(machine: ModeManager, what: str) -> None:
    _require_off(machine, what)
    if machine.drives_off:
        raise CommandRejectedError(DRIVES_OFF)


# Orders --------------------------------------------------------------------------------------------
#
# What the compiled tick is told of the mode machine before it is made.


def make_step_inputs(machine: ModeManager) -> StepInputs:
    """Return what the next tick is to know."""
    zeros, lambdas, push, motion = machine.zeros, machine.tunings.lambdas, machine.push, machine.motion
    trial = isinstance(motion, ModuleTrial)  # the trip that it provokes is heard when it is done, and then in any case
    return StepInputs(
        offset_A=zeros.offset_A,
        offset_B=zeros.offset_B,
        joint_centre=zeros.middle,
        zeroed=zeros.motors_known,
        tension_required=machine.keeps_taut,
        contact_threshold=machine.contact.felt_from(motion),
        ignores_safety_trip=trial,
        tripped=trial and motion is not None and motion.done,
        completion_reported=machine.reached_told,
        F_push=push.F_push,
        load=push.load,
        tuning=machine.tunings.number,
        obstacle=push.wall,
        contact_detection=push.touch,
        mode=MODE_CODE[machine.mode],
        run=machine.run,
        lam_q=lambdas.lam_q,
        lam_S=lambdas.lam_S,
        fault=FAULT_CODE[machine.fault],
        limits=Limit.CONTACT if machine.contact.felt else 0,
    )


# Plant watch ---------------------------------------------------------------------------------------
#
# Whether the plant can be read and written: told when that begins and when it is over, not in every
# tick.


ANSWERS_S = 1.0
"""So long without a failure [s] and the plant answers again: one that fails now and then is told of once."""


class PlantHealthMonitor:
    """Counts ticks without a failure. ``failure`` is what went wrong in the present tick, empty when nothing did."""

    def __init__(self) -> None:
        self.failure = ""
        self._told = False
        self._good_ticks = 0

    @property
    def answers(self) -> bool:
        """Whether nothing has to be told of the plant unless it fails."""
        return not self._told

    def begin(self) -> None:
        """Begin a tick."""
        self.failure = ""

    def end(self, tick: int) -> list[Event]:
        """End a tick; return what has changed."""
        self._good_ticks = 0 if self.failure else self._good_ticks + 1
        if self.failure and not self._told:
            self._told = True
            return [PlantFailing(tick, self.failure)]
        if self._told and self._good_ticks * T_s >= ANSWERS_S:
            self._told = False
            return [PlantAnswers(tick)]
        return []


# Sensor checks -------------------------------------------------------------------------------------
#
# What is said of readings that cannot be true; ``backend.control.fault_detection`` finds them.


_NAMES: Final = ("q", "theta_A", "theta_B", "F_A", "F_B")
_UNITS: Final = ("rad", "rad", "rad", "N", "N")


def describe_fault(
    found: DetectedFault, past: Measurement, raw: Measurement, m: Measurement, command: MotorCommand
) -> tuple[Fault, str]:
    """Fault and words of readings that cannot be true.

    ``past`` and ``raw`` are as read, before and now; ``m`` has the zeros; ``command`` was written in between.
    """
    side, still = found.which, found.still
    if found.verdict == fault_detection.JUMPED:
        way = f"{past[side]:.3f} to {raw[side]:.3f} {_UNITS[side]}"
        return Fault.SENSOR_JUMP, f"{_NAMES[side]} went from {way}"
    theta, F = _NAMES[1 + side], _NAMES[3 + side]
    if found.verdict == fault_detection.REVERSED:
        return Fault.MOTOR_REVERSED, f"{theta} runs away from {command[side]:.1f} V, faster and faster"
    if found.verdict == fault_detection.UNMOVED:
        stands = f"{theta} stands at {raw[1 + side]:.3f} rad although its motor gets {command[side]:.1f} V"
        return Fault.SENSOR_STUCK, stands
    if found.verdict == fault_detection.STUCK:
        turned = f"although its motor turned by {fault_detection.TURNED_RAD:g} rad"
        return Fault.SENSOR_STUCK, f"{F} stands at {raw[3 + side]:.2f} N {turned}"
    seen = f"{F} = {m[3 + side]:.1f} N, but the encoders stretch that spring to {m[3 + side] - found.excess:.1f} N"
    if still >= 0:
        return Fault.SENSOR_STUCK, f"{_NAMES[still]} stands still; {seen}"
    return Fault.IMPLAUSIBLE, seen


# Checks --------------------------------------------------------------------------------------------
#
# Names the fault that the control step has found, and says what was seen
# (``backend.control.fault_detection``).


class Checks:
    """Names faults of one plant."""

    def __init__(self, parameters: PlantParameters) -> None:
        self._bounds = compute_bounds(parameters)

    def told(
        self,
        found: DetectedFault,
        seen: FaultDetectionState,
        m: Measurement,
        heard: Measurement,
        command: MotorCommand,
        at_card: RawReading,
        missed: int,
    ) -> tuple[Fault, str]:
        """Return the fault and what was seen.

        ``m`` has the motors' zeros, ``heard`` is that from the joint's middle; ``at_card`` is what they were made from,
        ``missed`` the deadlines since the last tick.
        """
        match found.kind:
            case fault_detection.NOT_FINITE | fault_detection.OUT_OF_BOUNDS:
                return self.standing(heard, at_card)
            case fault_detection.TRIPPED:
                read = _read("F_A", m.F_A, ".1f", "N"), _read("F_B", m.F_B, ".1f", "N"), _read("q", m.q, "", "rad")
                return Fault.SAFETY_MODULE, f"the loop read {', '.join(read)} then"
            case fault_detection.IMPLAUSIBLE_READING:
                return describe_fault(found, seen.previous, seen.newest, m, command)
            case fault_detection.SLACK:
                F_slack = self._bounds.F_slack
                slack, taut = _parted(m, lambda F: F_slack > F)
                return Fault.SLACK, f"{slack} below the bound of {F_slack:g} N for more than {SLACK_MAX_S:g} s{taut}"
            case _:
                return Fault.DEADLINES_MISSED, f"{missed} periods of 1 ms missed in a row"

    def standing(self, m: Measurement, at_card: RawReading = NO_RAW) -> tuple[Fault, str]:
        """Return the fault that one measurement shows by itself, without what came before."""
        bounds = self._bounds
        if not math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B):
            silent = [name for name, value in zip(m._fields[:5], m[:5], strict=True) if not math.isfinite(value)]
            volts = {"F_A": at_card.V_A, "F_B": at_card.V_B}  # a number there, and yet no newtons
            at_end = [
                f"{name} reads {volts[name]:.2f} V" for name in silent if math.isfinite(volts.get(name, math.nan))
            ]
            if len(at_end) == len(silent):
                return Fault.SENSOR_SATURATED, f"{', '.join(at_end)}: the end of its input, or of its calibration"
            return Fault.SENSOR_INVALID, f"no number from {', '.join(silent)}"
        if max(m.F_A, m.F_B) > bounds.F_max:
            beyond, within = _parted(m, lambda F: bounds.F_max < F)
            return Fault.FORCE_LIMIT, f"{beyond} above the bound of {bounds.F_max:g} N{within}"
        if abs(m.q) > bounds.q_trip:
            q, q_trip = in_digits(m.q), in_digits(bounds.q_trip)  # whoever reads degrees is to read 90
            return Fault.JOINT_LIMIT, f"q = {q} rad; the bound is {q_trip} rad to either side"
        return Fault.NONE, ""


def _read(name: str, value: float, digits: str, unit: str) -> str:
    """Return a reading in words; one that is no number has no unit."""
    if not math.isfinite(value):
        return f"no number from {name}"
    return f"{name} = {format(value, digits) if digits else in_digits(value)} {unit}"


def _parted(m: Measurement, is_beyond: Callable[[float], bool]) -> tuple[str, str]:
    """Return in words the tensions that are beyond a bound, and behind a semicolon the other one, if any."""
    tensions = {"F_A": m.F_A, "F_B": m.F_B}
    beyond = [f"{name} = {F:.2f} N" for name, F in tensions.items() if is_beyond(F)]
    within = [f"; {_read(name, F, '.2f', 'N')}" for name, F in tensions.items() if not is_beyond(F)]
    return " and ".join(beyond), "".join(within)


# Loop ----------------------------------------------------------------------------------------------
#
# The control loop: one tick, the commands between two ticks, and zero volts at every way out.
#
# The same class runs live in the loop process and headless for the command line; what differs is
# who calls ``tick``.


_AT_REST_TOO = (Fault.SAFETY_MODULE, Fault.SENSOR_INVALID, Fault.SENSOR_SATURATED)


_LOG = logging.getLogger(__name__)


class Loop:
    """Control of one plant. ``finished`` tells that a Shutdown has been asked for."""

    def __init__(self, plant: Plant, parameters: PlantParameters, ring: SampleRing, tuning: SetTuning) -> None:
        self._plant, self._ring, self.finished = plant, ring, False
        self._known = known = collect_plant_knowledge(parameters)
        self._u_max, self._has_failed = parameters.motor.u_max, False
        self.bounds = known.bounds
        self._checks, self._plant_watch = Checks(parameters), PlantHealthMonitor()
        self._tick = self._newest_tick = self._overruns = 0
        self._command = ZERO_VOLTS  # what was written last
        self._changed = True  # whether the step may not know yet what has become of the machine
        self._hand, self._row = ManualDisturbance(plant), np.zeros(len(FIELDS))
        self._events: list[Event] = []
        gains = tuning_of(tuning, self._known)
        self._step = StepContext(parameters, plant.unattended_max_s, gains)  # once open, a card waits for 50 ms at most
        try:
            plant.open()
            self._step.begin(plant.read())
            self._machine = ModeManager(
                plant=plant,
                parameters=parameters,
                step=self._step,
                tuning=gains,
                lambdas=TuningParameters(tuning.lam_q, tuning.lam_S),
                events=self._events,
            )
        except BaseException:  # the drives may be on already, and nobody else has this plant to close
            self.close()
            raise

    @property
    def mode(self) -> Mode:
        """What the loop is doing."""
        return self._machine.mode

    @property
    def fault(self) -> Fault:
        """The latched fault, or NONE."""
        return self._machine.fault

    @property
    def pretension_done(self) -> bool:
        """Whether the moves out of pretension towards motion are granted now."""
        return self._machine.pretension_done

    @property
    def readiness(self) -> tuple[str, bool]:
        """What has to come before pretension, empty where nothing has; and whether the drives are locked off."""
        return self._machine.unready, self._machine.drives_off

    def drain_events(self) -> list[Event]:
        """Events since the last call, oldest first."""
        events, self._events[:] = list(self._events), []
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Carry out a command between two ticks, or refuse it whole; the answer is queued as an event."""
        events, tick = self._events, self._tick
        self._changed = True
        try:
            self._carry_out(command)
        except CommandRejectedError as refused:
            events.append(Refused(sequence, tick, str(refused), refused.legal))
        except (ValueError, PlantError) as error:
            events.append(Refused(sequence, tick, str(error)))
        except AssertionError:  # of assert_never: a service of another version, which no type checker has seen
            events.append(Refused(sequence, tick, f"this loop knows no command {type(command).__name__}"))
        except Exception as error:  # a mistake of the program: no voltage is decided on what it has left behind
            self._step_failed(error)
            events.append(Refused(sequence, tick, f"{type(command).__name__} ended in {_named(error)}"))
        else:
            events.append(Accepted(sequence, tick))

    def _carry_out(self, command: Command) -> None:
        self._obey(command)
        self._machine.require_consistent()

    def _obey(self, command: Command) -> None:
        if isinstance(command, CommissioningCommand):
            carry_out(command, self._machine, self._plant, TickContext(self._newest_tick, self._step.m))
            if isinstance(command, Zero):
                self._step.stands_at(command.q)
            return
        match command:
            case Stop():
                self._machine.begin_stop(command, command.detail, TickContext(self._newest_tick, self._step.m))
            case SetMode():
                self._machine.set_mode(command, TickContext(self._newest_tick, self._step.m))
            case SetReferences():
                self._machine.set_references(command)
            case SetTuning():
                self._machine.set_tuning(
                    tuning_of(command, self._known), TuningParameters(command.lam_q, command.lam_S)
                )
            case ConfigureContactDetection():
                self._machine.contact.put(command)
            case RunProgram():
                self._machine.run_program(command, TickContext(self._newest_tick, self._step.m))
            case ApplyPush():
                self._hand.begin(command, self._tick, self._machine.mode)
            case Inject():
                self._plant.inject(command.broken)
            case Obstruct():
                self._machine.push.obstruct(command.obstacle, self._tick)
            case Reset():
                self._reset()
            case Shutdown():
                self.finished = True
            case Heartbeat():
                pass
            case PlayRecording():
                raise CommandRejectedError("no recording is played: there is nothing to play, pause or go to")
            case _:
                assert_never(command)

    def _reset(self) -> None:
        machine = self._machine
        if machine.mode is not Mode.TRIPPED:
            raise CommandRejectedError(f"there is no fault to reset; the mode is {machine.mode}", LEGAL[machine.mode])
        if self._has_failed:
            raise CommandRejectedError("this loop has failed by a mistake of its own: a new one has to be started")
        fault, seen = self._checks.standing(machine.zeros.from_middle(self._step.m), self._plant.raw)
        seen = self._plant_watch.failure or seen
        if fault is not Fault.NONE or self._plant_watch.failure:
            raise CommandRejectedError(f"the cause is still there: {seen}")
        machine.reset(TickContext(self._newest_tick, self._step.m))

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """One period: read, look, decide, write, keep the row. Zero volts on any way out by an error."""
        self._make_tick(None, lateness_s, overruns)

    def run(self, ticks: int) -> int:
        """Make at most so many ticks, and at least one: in a batch where nobody has to be asked in between; how many.

        A batch ends in the tick that something comes of, which is made by itself from there on.
        """
        plant, ring, machine, step = self._plant, self._ring, self._machine, self._step
        told = self._plant_watch.answers and not machine.has_to_tell
        undisturbed = told and self._hand.is_idle and machine.interpreted is None
        alone = plant.alone_for(ticks) if undisturbed and isinstance(plant, Simulator) else 0
        if not (alone and isinstance(plant, Simulator) and isinstance(ring, Ring)):
            self.tick(overruns=self._overruns)
            return 1
        self._update_inputs()
        stretch = TickRange(self._tick, plant.periods, alone, self._overruns)
        made, came, u_A, u_B, m = step.run(plant.simulated, plant.read(), stretch, ring.rows)
        plant.has_gone(made, m)
        ring.count_in(made)
        machine.push.has_become(*step.acting)
        self._tick += made
        self._newest_tick = self._tick - 1
        self._command = step.command
        if came == NO_EVENT:
            return made
        self._make_tick((came, u_A, u_B), 0.0, self._overruns)
        return made + 1

    def _make_tick(self, begun: tuple[int, float, float] | None, lateness_s: float, overruns: int) -> None:
        """Make a tick, or the rest of one that a batch has ``begun``: what came of it so far, and voltages [V]."""
        machine, missed = self._machine, overruns - self._overruns
        self._newest_tick = self._tick
        self._plant_watch.begin()
        self._events += self._hand.step(self._tick, machine.mode)
        command, has_changed = ZERO_VOLTS, self._changed
        try:
            came, u_A, u_B = begun or self._begin_tick(missed)
            if came not in (NO_EVENT, CONTROL_COMPUTED) or machine.interpreted is not None:
                u_A, u_B = self._attend(came, missed)
                self._changed = True
            if machine.mode not in (Mode.OFF, Mode.TRIPPED):
                self._require_possible(u_A, u_B)
                command = MotorCommand(u_A, u_B)
            if has_changed or self._changed:
                machine.require_consistent()
        except PlantError as error:
            command = ZERO_VOLTS
            self._step.decision = AT_REST
            self._plant_failed(error)
        except Exception as error:  # a mistake of the program is a trip, never an end with a voltage on
            command = ZERO_VOLTS
            self._step.decision = AT_REST
            self._step_failed(error)
        finally:
            self._write(command)
        self._events += self._plant_watch.end(self._tick)
        self._overruns = overruns
        self._update_inputs()
        self._step.write_row(self._row, self._tick, self._command, self._plant.raw, lateness_s, overruns)
        try:
            self._ring.append(self._row)
        except InvariantError as error:
            self._step_failed(error)
            self._write(ZERO_VOLTS)
        self._tick += 1

    def _begin_tick(self, missed: int) -> tuple[int, float, float]:
        """Read, look, and let a compiled motion decide; what came of it, and voltages [V]."""
        step, raw = self._step, self._plant.read()
        self._update_inputs()
        found = step.detect_faults(raw, missed)
        if found != NO_EVENT or self._machine.interpreted is not None:
            return found, 0.0, 0.0
        return step.compute_control()

    def _update_inputs(self) -> None:
        if self._changed:
            self._step.set_inputs(make_step_inputs(self._machine))
            self._changed = False

    def _attend(self, came: int, missed: int) -> tuple[float, float]:
        """See to what came of a tick that was looked at; return the voltages [V] that are decided then."""
        machine, step = self._machine, self._step
        if came & FAULT_DETECTED:
            self._react(missed)
        elif came & CONTACT_DETECTED:
            machine.give_way(TickContext(self._newest_tick, step.m))
        step.set_inputs(make_step_inputs(machine))
        if machine.interpreted is not None:
            decision = step.decision = machine.interpreted.step(machine.tunings.gains, step.m)
            came = MOTION_DONE if machine.interpreted.done else NO_EVENT
        else:
            if came & (FAULT_DETECTED | CONTACT_DETECTED):
                came, _, _ = step.compute_control()
            decision = step.decision
        if came & DISTURBANCE_CHANGED:
            machine.push.act(decision.setpoint, self._newest_tick)
        if came & GAINS_CHANGED:
            machine.tunings.use(decision.setpoint.tuning, self._newest_tick)
        motion, m = machine.motion, step.m
        if came & MOTION_DONE and motion is not None:
            motion.done = True
            zero_where_homed(motion, machine, self._plant, step)
            step.m = machine.end_motion(TickContext(self._newest_tick, m))
        return decision.u_A, decision.u_B

    def _react(self, missed: int) -> None:
        """Stop for what the checks have found, where that is to be stopped for."""
        machine, step, m, command = self._machine, self._step, self._step.m, self._command
        if machine.mode is Mode.TRIPPED:
            return
        heard = machine.zeros.from_middle(m)
        fault, seen = self._checks.told(step.found, step.readings, m, heard, command, self._plant.raw, missed)
        if machine.motion is not None or fault in _AT_REST_TOO:
            machine.begin_stop(Stop(fault), seen, TickContext(self._newest_tick, m))

    def _write(self, command: MotorCommand) -> None:
        machine = self._machine
        try:
            self._plant.write(command)
            self._command = command  # what cannot be written leaves the outputs as they were
        except (WatchdogExpiredError, WatchdogDeadError) as error:
            # The drives are off already: this is zero volts, and stays so until somebody resets.
            self._command = ZERO_VOLTS
            self._changed = True
            if machine.mode is not Mode.TRIPPED:
                fault = Fault.WATCHDOG if isinstance(error, WatchdogExpiredError) else Fault.WATCHDOG_DEAD
                machine.begin_stop(Stop(fault), str(error), TickContext(self._newest_tick, self._step.m))
        except PlantError as error:
            self._plant_failed(error)
            return
        machine.tell_stopped(self._tick)

    def _require_possible(self, u_A: float, u_B: float) -> None:
        """Raise InvariantError for a voltage that the control step must not decide, nan among them."""
        most = self._u_max
        if not (-most <= u_A <= most and -most <= u_B <= most):
            raise InvariantError(f"the control step decided {u_A} V and {u_B} V, beyond ±{most:g} V")

    def _step_failed(self, error: Exception) -> None:
        """Trip for a mistake of the program, whatever has tripped before. This loop stays tripped from now on."""
        self._changed = True
        if self._has_failed:
            return
        self._has_failed = True
        _LOG.critical("The control loop failed: %s", _named(error), exc_info=error)
        stop = Stop(Fault.INTERNAL_ERROR)
        self._machine.begin_stop(stop, _named(error), TickContext(self._newest_tick, self._step.m))
        self._machine.fault = Fault.INTERNAL_ERROR  # by which the service knows that a reset starts a new loop

    def _plant_failed(self, error: PlantError) -> None:
        self._plant_watch.failure = str(error)
        self._changed = True
        if self._machine.mode is not Mode.TRIPPED:
            self._machine.begin_stop(Stop(Fault.PLANT_ERROR), str(error), TickContext(self._newest_tick, self._step.m))

    def close(self) -> None:
        """Zero volts and let go of the plant. Safe to call twice."""
        try:
            self._plant.write(ZERO_VOLTS)
        except PlantError:
            pass
        finally:
            self._plant.close()


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
