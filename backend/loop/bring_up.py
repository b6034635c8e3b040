"""What bringing a rig up asks of the loop: at zero volts, or with little of them."""

from typing import assert_never

from backend.control.motion_types import NO_REFERENCE
from backend.errors import require_within
from backend.faults import Fault
from backend.loop.causes import Cause, HomingEnd
from backend.loop.commands import ByHand, Home, ProveDirections, Stop, SwitchDrives, TryModule, TryMotor, Zero
from backend.loop.homing import TENSION_MAX_N, Homing
from backend.loop.mode import DRIVES_OFF, LEGAL, Mode, RefusedError
from backend.loop.mode_machine import ModeMachine
from backend.loop.motion import Motion
from backend.loop.motor_trial import MotorTrial
from backend.loop.now import Now
from backend.loop.tick_desk import TickDesk
from plant.interface import EndSwitched, Plant, PlantError, Proven, Switched
from plant.manual_input import Handled

SHORTEST_RAD = 0.1
"""An end switch nearer to the joint's middle than this [rad] is none."""

Asked = Zero | TryMotor | TryModule | Home | ProveDirections | SwitchDrives | ByHand


def carry_out(command: Asked, machine: ModeMachine, plant: Plant, now: Now) -> None:
    """Carry out a command. Raises RefusedError, and PlantError where the plant has no such thing."""
    match command:
        case Zero():
            _require_off(machine, "a zero is set")
            set_zero(command, machine, plant)
        case TryMotor(motor):
            _require_free(machine, "a motor is tried")
            if isinstance(plant, Proven):
                plant.prove_directions(proven=False)  # until the step has come to its end
            machine.try_out(lambda carry: MotorTrial(carry, NO_REFERENCE, now.m, motor), Cause.MOTOR_TRIAL, now)
        case Home(position):
            _home(position, machine, plant, now)
        case TryModule():
            machine.try_module(now)
        case ProveDirections(proven):
            if proven:
                _require_off(machine, "directions are proven")
            if isinstance(plant, Proven):
                plant.prove_directions(proven=proven)
        case SwitchDrives(on):
            _switch_drives(machine, plant, now, on=on)
        case ByHand(hand):
            if not isinstance(plant, Handled):
                raise PlantError("nothing here is moved by this program's hand: do it at the rig")
            plant.by_hand(hand)
        case _:
            assert_never(command)


def _switch_drives(machine: ModeMachine, plant: Plant, now: Now, *, on: bool) -> None:
    """Off in any mode, and with it zero volts; on in off only. What the card does not obey leaves the loop locked."""
    if not isinstance(plant, Switched):
        raise PlantError("this plant has no drives that could be switched off")
    if on:
        _require_off(machine, "drives are switched on")
    elif machine.mode not in (Mode.OFF, Mode.TRIPPED):
        machine.begin_stop(Stop(Fault.STOP_PRESSED, hard=True), "the drives were switched off", now)
    machine.drives_off = True  # until the card has obeyed
    plant.switch_drives(on=on)
    if on:
        machine.drives_off = False


def set_zero(zero: Zero, machine: ModeMachine, plant: Plant) -> None:
    """Let the encoders count from where joint and motors are said to stand. Raises PlantError."""
    plant.zero(zero.q, zero.theta_A, zero.theta_B, at_switch=zero.at_switch)
    machine.zeros.begin_anew()  # pretension finds the motors' zeros


def zero_where_homed(motion: Motion, machine: ModeMachine, plant: Plant, desk: TickDesk) -> None:
    """Set the zero that a motion has found, if it was a homing that has. Raises PlantError."""
    if isinstance(motion, Homing) and motion.end is HomingEnd.HOMED:
        found = Zero(motion.position_of(desk.m.q), 0.0, 0.0)
        set_zero(found, machine, plant)
        desk.stands_at(found.q)


def _home(position: float, machine: ModeMachine, plant: Plant, now: Now) -> None:
    _require_free(machine, "the joint is driven to its end switch")
    if not isinstance(plant, EndSwitched):
        raise PlantError("this plant has no end switch that its joint could be driven to")
    if plant.unproven:
        raise RefusedError(plant.unproven)
    bounds, m = machine.bounds, now.m
    require_within("position", abs(position), SHORTEST_RAD, bounds.q_trip, "rad", words="way to the end switch")
    if not (m.F_A <= TENSION_MAX_N and m.F_B <= TENSION_MAX_N):
        raise RefusedError(
            f"the tendons hold {m.F_A:.1f} N and {m.F_B:.1f} N, at most {TENSION_MAX_N:g} N are safe: slacken them"
        )
    ratio, at_end = machine.turns_per_joint, lambda: plant.at_end
    if not plant.zeroed:
        machine.zeros.say_middle(m.q)  # that is what the person who started it has said
    machine.try_out(lambda carry: Homing(carry, NO_REFERENCE, m, position, ratio, at_end), Cause.HOMING, now)


def _require_off(machine: ModeMachine, what: str) -> None:
    if machine.mode is not Mode.OFF:
        raise RefusedError(f"{what} in off only; the mode is {machine.mode}", LEGAL[machine.mode])


def _require_free(machine: ModeMachine, what: str) -> None:
    _require_off(machine, what)
    if machine.drives_off:
        raise RefusedError(DRIVES_OFF)
