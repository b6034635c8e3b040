"""A motor that runs against its volts is told after twice the time that is looked at, not before, and only then."""

import pytest

from backend.control.fault_detection import (
    PLAUSIBLE,
    REVERSED,
    REVERSED_S,
    build_sensor_limits,
    build_tendons,
    check_plausibility,
    make_reading_memory,
    remember_readings,
)
from plant.interface import NOT_MEASURED, MotorCommand, T_s
from plant.parameters import load_parameters

LAB = load_parameters("lab")
LIMITS, TENDONS = build_sensor_limits(LAB), build_tendons(LAB)


def told_at(acceleration: float, u: float, ticks: int) -> tuple[int, int]:
    """Return the tick in which motor A is doubted, 0 for never, and what is said; it turns by ½ a t² under u [V]."""
    memory = make_reading_memory()
    at = NOT_MEASURED._replace(q=0.0, theta_A=0.0, theta_B=0.0, F_A=10.0, F_B=10.0)
    remember_readings(memory, at)
    for tick in range(1, ticks + 1):
        force = 10.0 + 0.01 * (tick % 2)  # cells that live
        m = at._replace(theta_A=0.5 * acceleration * (tick * T_s) ** 2, F_A=force, F_B=force)
        what, *_ = check_plausibility(LIMITS, TENDONS, memory, m, m, MotorCommand(u, 0.0), False, 1)
        if what != PLAUSIBLE:
            return tick, what
    return 0, PLAUSIBLE


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_told_after_two_looks(sign: float) -> None:
    u = sign * 4.0 * LIMITS.driven_V[0]
    assert told_at(-sign * 8.0, u, 300) == (1 + 2 * round(REVERSED_S / T_s), REVERSED)
    assert told_at(sign * 8.0, u, 300) == (0, PLAUSIBLE)


def test_what_turns_by_itself_or_too_little_is_no_reversed_motor() -> None:
    assert told_at(-8.0, 0.0, 300) == (0, PLAUSIBLE)
    assert told_at(-0.2, 4.0 * LIMITS.driven_V[0], 150) == (0, PLAUSIBLE)
