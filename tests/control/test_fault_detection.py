"""Implausible readings: each kind is detected on each side after its documented time, and not otherwise."""

from collections.abc import Callable

import pytest

from backend.control.fault_detection import (
    CONTRADICTION_N,
    CONTRADICTION_S,
    IMPLAUSIBLE,
    PLAUSIBLE,
    REVERSED,
    REVERSED_S,
    STUCK,
    TURNED_RAD,
    UNMOVED,
    UNMOVED_S,
    SensorVerdict,
    build_sensor_limits,
    build_tendons,
    check_plausibility,
    make_reading_memory,
    remember_readings,
)
from plant.interface import NOT_MEASURED, Measurement, MotorCommand, T_s
from plant.parameters import load_parameters

LAB = load_parameters("lab")
LIMITS, TENDONS = build_sensor_limits(LAB), build_tendons(LAB)


def told_at(acceleration: float, u: float, ticks: int) -> tuple[int, int]:
    """Return the tick in which motor A is reported, 0 for never, and the verdict; it turns by ½ a t² under u [V]."""
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
def test_a_reversed_motor_is_reported_after_two_checks(sign: float) -> None:
    u = sign * 4.0 * LIMITS.driven_V[0]
    assert told_at(-sign * 8.0, u, 300) == (1 + 2 * round(REVERSED_S / T_s), REVERSED)
    assert told_at(sign * 8.0, u, 300) == (0, PLAUSIBLE)


def test_motion_without_voltage_or_of_small_size_is_no_reversed_motor() -> None:
    assert told_at(-8.0, 0.0, 300) == (0, PLAUSIBLE)
    assert told_at(-0.2, 4.0 * LIMITS.driven_V[0], 150) == (0, PLAUSIBLE)


AT_REST = NOT_MEASURED._replace(q=0.0, theta_A=0.0, theta_B=0.0, F_A=10.0, F_B=10.0)
SIDE_NAMES = ("A", "B")


def find_verdict(
    read: Callable[[int], Measurement], u: tuple[float, float] = (0.0, 0.0), *, zeroed: bool = False, ticks: int = 500
) -> tuple[int, SensorVerdict]:
    """Return the tick of the first verdict, 0 for none; ``read`` returns the readings of a tick."""
    memory = make_reading_memory()
    remember_readings(memory, read(0))
    for tick in range(1, ticks + 1):
        m = read(tick)
        verdict = SensorVerdict(*check_plausibility(LIMITS, TENDONS, memory, m, m, MotorCommand(*u), zeroed, 1))
        if verdict.kind != PLAUSIBLE:
            return tick, verdict
    return 0, SensorVerdict(PLAUSIBLE, 0, -1, 0.0)


def read_at_rest(tick: int, **other: float) -> Measurement:
    """Return readings at rest, whose load cells change by their last digit; ``other`` replaces some of them."""
    force = 10.0 + 0.01 * (tick % 2)
    return AT_REST._replace(F_A=force, F_B=force)._replace(**other)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_driven_motor_with_a_constant_encoder_is_detected_after_its_time(side: int, sign: float) -> None:
    def drive(volts: float) -> tuple[float, float]:
        return (sign * volts, 0.0) if side == 0 else (0.0, sign * volts)

    least = LIMITS.driven_V[side]
    tick, verdict = find_verdict(read_at_rest, drive(1.01 * least))
    assert (verdict.kind, verdict.which) == (UNMOVED, side)
    assert tick * T_s == pytest.approx(UNMOVED_S, abs=1.5 * T_s)
    assert find_verdict(read_at_rest, drive(0.99 * least))[0] == 0

    def read_moving(tick: int) -> Measurement:  # by a count each 50 ms, forward and back
        return read_at_rest(tick, **{f"theta_{SIDE_NAMES[side]}": 1e-3 * (tick // 50 % 2)})

    assert find_verdict(read_moving, drive(1.01 * least))[0] == 0


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("speed", [20.0, -20.0])
def test_a_constant_load_cell_with_a_turning_motor_is_detected(side: int, speed: float) -> None:
    name = SIDE_NAMES[side]

    def read(tick: int) -> Measurement:
        return read_at_rest(tick, **{f"theta_{name}": speed * tick * T_s, f"F_{name}": 10.0})

    tick, verdict = find_verdict(read)
    assert (verdict.kind, verdict.which) == (STUCK, side)
    assert tick == pytest.approx(TURNED_RAD / abs(speed) / T_s, abs=1.5)

    def read_alive(tick: int) -> Measurement:
        return read_at_rest(tick, **{f"theta_{name}": speed * tick * T_s})

    assert find_verdict(read_alive)[0] == 0


def test_a_slack_tendon_has_a_constant_force() -> None:
    """Below the zero-force elongation a load cell correctly shows a constant value."""

    def read(tick: int) -> Measurement:
        return read_at_rest(tick, theta_A=-20.0 * tick * T_s, F_A=0.0, theta_B=-1.0, F_B=0.001 * (tick % 2))

    assert find_verdict(read, zeroed=True)[0] == 0
    assert find_verdict(read, zeroed=False)[1].kind == STUCK


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_load_cell_that_contradicts_its_spring_is_detected_after_its_time(side: int, sign: float) -> None:
    theta, springs = 3.0, (TENDONS.spring_A, TENDONS.spring_B)
    x = TENDONS.r_m * theta
    forces = [sum(k * x**power for power, k in enumerate(spring.k)) for spring in springs]

    def read(tick: int, difference: float) -> Measurement:
        off = [difference if which == side else 0.0 for which in (0, 1)]
        alive = 0.001 * (tick % 2)
        F_A, F_B = (force + alive + more for force, more in zip(forces, off, strict=True))
        return AT_REST._replace(q=0.001 * (tick % 2), theta_A=theta, theta_B=theta, F_A=F_A, F_B=F_B)

    tick, verdict = find_verdict(lambda tick: read(tick, sign * (CONTRADICTION_N + 1.0)), zeroed=True)
    assert (verdict.kind, verdict.which, verdict.still) == (IMPLAUSIBLE, side, 1 + side)
    assert verdict.excess == pytest.approx(sign * (CONTRADICTION_N + 1.0), abs=0.1)
    assert tick * T_s == pytest.approx(CONTRADICTION_S, abs=1.5 * T_s)
    assert find_verdict(lambda tick: read(tick, sign * (CONTRADICTION_N - 1.0)), zeroed=True)[0] == 0
    assert (
        find_verdict(lambda tick: read(tick, sign * (CONTRADICTION_N + (0.5 if tick % 150 else -0.5))), zeroed=True)[0]
        == 0
    )
