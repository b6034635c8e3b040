"""What bringing a rig up asks of the loop: at zero volts, or with little of them and no loop closed."""

from typing import assert_never

from backend.loop.commands import ByHand, ProveDirections, SwitchDrives, TryModule, TryMotor, Zero
from backend.loop.mode import DRIVES_OFF, LEGAL, Mode, RefusedError
from backend.loop.mode_machine import NO_REFERENCE, ModeMachine
from backend.loop.module_trial import ModuleTrial
from plant.hand import Handled
from plant.interface import Plant, PlantError, Proven, Switched

Asked = Zero | TryMotor | TryModule | ProveDirections | SwitchDrives | ByHand


def carry_out(command: Asked, machine: ModeMachine, plant: Plant) -> None:
    """Carry out a command. Raises RefusedError, and PlantError where the plant has no such thing."""
    match command:
        case Zero(q, theta_A, theta_B, at_switch):
            _require_off(machine, "a zero is set")
            plant.zero(q, theta_A, theta_B, at_switch=at_switch)
            machine.offset_A = machine.offset_B = 0.0
            machine.zeroed = False  # the encoders count from elsewhere: pretension finds the motors' zeros anew
        case TryMotor(motor):
            _require_off(machine, "a motor is tried")
            if machine.drives_off:
                raise RefusedError(DRIVES_OFF)
            if isinstance(plant, Proven):
                plant.prove_directions(proven=False)  # until the step has come to its end
            machine.try_motor(motor)
        case TryModule():
            if not machine.pretension_done or machine.motion is None:
                raise RefusedError("the safety module is tried once both tendons hold the pretension")
            machine.motion = ModuleTrial(machine.motion.carry(), NO_REFERENCE, machine.m)
        case ProveDirections(proven):
            if proven:
                _require_off(machine, "directions are proven")
            if isinstance(plant, Proven):
                plant.prove_directions(proven=proven)
        case SwitchDrives(on):
            _require_off(machine, "drives are switched")
            if not isinstance(plant, Switched):
                raise PlantError("this plant has no drives that could be switched off")
            machine.drives_off = True  # until the card has obeyed
            plant.switch_drives(on=on)
            machine.drives_off = not on
        case ByHand(hand):
            if not isinstance(plant, Handled):
                raise PlantError("nothing here is moved by this program's hand: do it at the rig")
            plant.by_hand(hand)
        case _:
            assert_never(command)


def _require_off(machine: ModeMachine, what: str) -> None:
    if machine.mode is not Mode.OFF:
        raise RefusedError(f"{what} in off only; the mode is {machine.mode}", LEGAL[machine.mode])
