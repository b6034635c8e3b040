"""What a program plays, as the compiled tick reads it."""

from collections.abc import Sequence

import numpy as np

from backend.control import motion_primitives, pid, setpoint_player
from backend.control.motion_types import Carry, Target
from backend.loop.program import Excitation, Program, Segment, Shape
from plant.interface import T_s

_SHAPES = {
    Shape.STEP: setpoint_player.STEP,
    Shape.RAMP: setpoint_player.RAMP,
    Shape.SINE: setpoint_player.SINE,
    Shape.SWEEP: setpoint_player.SWEEP,
    Shape.PRBS: setpoint_player.PRBS,
    Shape.MULTISINE: setpoint_player.MULTISINE,
}


def player_of(segments: Sequence[Segment], start: Target) -> setpoint_player.Player:
    """Play segments from a target on."""
    rows = [
        (
            _SHAPES[segment.shape],
            round(segment.duration_s / T_s),
            segment.duration_s,
            segment.q_ref,
            segment.S_ref,
            segment.F_push,
            segment.period_s,
            segment.load_A,
            segment.load_B,
            segment.period_end_s,
            segment.count,
            segment.peak,
            segment.tuning,
            segment.wall,
            segment.touch,
        )
        for segment in segments
    ]
    return setpoint_player.Player(
        np.array(rows, dtype=np.float64).reshape(-1, setpoint_player.COLUMNS), 0, 0, setpoint_player.FIRST, start
    )


def tension_hold_of(
    program: Program, excitation: Excitation, carry: Carry, theta_A: float
) -> motion_primitives.TensionHoldState:
    """Hold the program's tension, which ``theta_A`` [rad] of motor A gives about, settle, and excite."""
    amplitude = excitation.amplitude_rad
    levels = np.array([amplitude if level == "+" else -amplitude for level in excitation.levels])
    chip_ticks = max(round(excitation.chip_s / T_s), 1)
    chips = motion_primitives.Chips(levels, chip_ticks, excitation.periods * len(levels) * chip_ticks)
    base = carry.theta_A_ref, carry.theta_B_ref
    settle_ticks = round(program.settle_s / T_s)
    return motion_primitives.TensionHoldState(
        program.tension_N, theta_A, *base, settle_ticks, chips, 0, pid.ForceHoldState(0.0)
    )


def tension_sweep_of(program: Program, goals: Sequence[tuple[float, float]]) -> motion_primitives.TensionSweepState:
    """Sweep along ``goals``: theta_A and theta_B [rad] of the start and of each leg's end."""
    ticks = np.array([max(round(leg.duration_s / T_s), 1) for leg in program.legs], dtype=np.int64)
    return motion_primitives.TensionSweepState(np.array(goals), ticks, round(program.settle_s / T_s), -1, 0)


def voltage_steps_of(program: Program, room: motion_primitives.VoltageMargin) -> motion_primitives.VoltageStepsState:
    """Make the program's steps within ``room``."""
    rows = [(step.theta_start, step.u, round(step.duration_s / T_s), step.travel_rad) for step in program.steps]
    steps = np.array(rows, dtype=np.float64).reshape(-1, 4)
    still = motion_primitives.BrakeState(0.0, 0.0, 0.0, 0.0)
    first = motion_primitives.CENTRED
    return motion_primitives.VoltageStepsState(room, steps, round(program.settle_s / T_s), 0, first, 0, 0.0, 0.0, still)
