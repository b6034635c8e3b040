"""Conformance checks for any Plant: ``sinew rig conformance``, and the tests.

A check applies at most the voltage that a ``Subject`` allows: at 0 V only the checks at rest run.
"""

import gc
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from statistics import median

from plant import messages
from plant.errors import SinewError
from plant.factory import find_missing_parts
from plant.interface import (
    NO_LOAD,
    ZERO_VOLTS,
    InjectedFault,
    InjectedFaultKind,
    Measurement,
    MotorCommand,
    Plant,
    PlantError,
    RawReading,
    Sensor,
    T_s,
)
from plant.message import Message
from plant.parameters import PlantParameters

# Check types ---------------------------------------------------------------------------------------
# Types and building blocks of the checks.


RESTING_RAD = 0.02
"""Largest motion of joint and motors at zero volts within a second [rad]: a slack tendon settling."""

PERIODS = round(1.0 / T_s)
"""Ticks per second."""


class CheckOutcome(StrEnum):
    """Result of a check."""

    HOLDS = "holds"
    BROKEN = "broken"
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Subject:
    """Plant to check; each call of ``make`` returns a new one, not yet open.

    ``voltage`` [V] is the voltage that a check may apply, 0 if nothing may move. ``answers`` is False for a recording,
    on which writes have no effect; ``lasts`` is its number of ticks.
    """

    make: Callable[[], Plant]
    parameters: PlantParameters
    voltage: float = 0.0
    answers: bool = True
    lasts: int = 1_000_000

    def ticks(self, wanted: int) -> int:
        """Return ``wanted``, limited to the ticks that the plant lasts."""
        return min(wanted, self.lasts - 1)


@dataclass(frozen=True)
class CheckFinding:
    """Result of a check, with the observed values in ``seen``."""

    name: str
    sentence: str
    outcome: CheckOutcome
    seen: str = ""


class RequirementError(SinewError):
    """A plant violates the contract; the message contains the observation."""


class NotTriedError(SinewError):
    """A check is not possible here; the message contains the reason."""


@dataclass(frozen=True)
class Check:
    """Check of the contract: its name, the requirement as a sentence, and its function.

    The function raises RequirementError if the plant violates the requirement.
    """

    name: str
    sentence: str
    make: Callable[[Subject], str | None]


def requirement(sentence: str) -> Callable[[Callable[[Subject], str | None]], Check]:
    """Return a decorator that turns a function into a check.

    The function returns its observation as text.
    """
    return lambda function: Check(function.__name__.strip("_"), sentence, function)


def require(holds: bool, message: Message) -> None:
    """Raise RequirementError with ``message`` unless ``holds``."""
    if not holds:
        raise RequirementError(message)


@contextmanager
def open_subject(subject: Subject) -> Iterator[Plant]:
    """Open a plant for the block and close it afterwards."""
    plant = subject.make()
    plant.open()
    try:
        yield plant
    finally:
        plant.close()


@contextmanager
def freeze_garbage() -> Iterator[None]:
    """Exclude existing objects from garbage collection for the block, to count memory.

    Cycles of earlier code freed between two counts would hide growth. A collection at each count would leave the plant
    unattended for longer than its watchdog allows, and empty free lists that fill again.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def require_driving_voltage(subject: Subject) -> float:
    """Return the permitted voltage [V]. Raises NotTriedError if there is none."""
    if not subject.answers:
        raise NotTriedError(messages.writes_without_effect())
    if subject.voltage <= 0.0:
        raise NotTriedError(messages.no_voltage_permitted())
    return subject.voltage


def check_reading(plant: Plant, m: Measurement, parameters: PlantParameters) -> None:
    """Raise RequirementError for a reading that is impossible with these parameters."""
    require(isinstance(m, Measurement), messages.not_a_measurement(kind=type(m).__name__))
    wrong = [name for name, value in zip(m._fields, m, strict=True) if not isinstance(value, float)]
    require(not wrong, messages.reading_without_floats(names=wrong))
    reported = {name: value for name, value in zip(m._fields, m, strict=True) if name not in ("S_true", "F_wall")}
    missing = [name for name, value in reported.items() if not math.isfinite(value)]
    require(not missing, messages.reading_not_finite(names=missing))
    q_max, F_max = parameters.geometry.q_max, parameters.safety.F_max
    require(abs(m.q) <= 1.1 * q_max, messages.q_implausible(q=m.q, q_max=q_max))
    for name, F in (("F_A", m.F_A), ("F_B", m.F_B)):
        require(-0.1 * F_max <= F <= F_max, messages.tension_implausible(name=name, F=F, F_max=F_max))
    for name, theta in (("theta_A", m.theta_A), ("theta_B", m.theta_B)):
        require(abs(theta) <= 100.0, messages.theta_implausible(name=name, theta=theta, theta_max=100.0))
    require(m.safety_trip in (0.0, 1.0), messages.safety_trip_invalid(value=m.safety_trip))
    require(len(plant.raw) == len(RawReading._fields), messages.raw_reading_incomplete())


def drive(plant: Plant, command: MotorCommand, ticks: int) -> Measurement:
    """Write a command for some ticks at the plant's pace; return the last reading.

    Each write follows a reading.
    """
    for _ in range(ticks):
        begun_s = time.monotonic()
        plant.read()
        plant.write(command)
        if not (plant.stepped or plant.paces_loop):
            time.sleep(max(0.0, T_s - (time.monotonic() - begun_s)))
    return plant.read()


def require_at_rest(first: Measurement, m: Measurement) -> None:
    """Raise RequirementError if joint or motors moved further than RESTING_RAD."""
    for name in ("q", "theta_A", "theta_B"):
        travel = abs(getattr(m, name) - getattr(first, name))
        if not travel <= RESTING_RAD:
            raise RequirementError(messages.moved_at_zero_volts(name=name, travel=travel))


# Conformance ---------------------------------------------------------------------------------------


LONG_TICKS = 10_000
WARM_UP_TICKS = 3_000
"""Ticks until caches are filled: on the virtual card, as first use in a process, 1000 blocks are allocated in the
second thousand ticks and none later."""

GROWTH_BLOCKS = 200
"""Permitted growth after ``LONG_TICKS`` [memory blocks]: some caches fill once, but no tick may leak memory."""

DRIVE_TICKS = 300
MOVED_RAD = 1e-3


@requirement("It has all parts of the Plant protocol, each with the type that the protocol declares.")
def _is_a_plant(subject: Subject) -> str:
    plant = subject.make()
    missing = find_missing_parts(plant)
    require(not missing, messages.parts_missing(missing=missing))
    for name in ("paces_loop", "stepped", "pushes", "loads_shafts"):
        require(isinstance(getattr(plant, name), bool), messages.attribute_not_boolean(attribute=name))
    limit_s = plant.unattended_max_s
    require(
        isinstance(limit_s, float) and T_s < limit_s < math.inf,
        messages.unattended_time_invalid(value=limit_s),
    )
    require(isinstance(plant.unready, str), messages.unready_is_not_text())
    require(not (plant.stepped and plant.paces_loop), messages.stepped_and_paced())
    return messages.unattended_time(limit_s=limit_s)


@requirement("Once it is open, its description names the plant and its timing in one line.")
def _describes_itself(subject: Subject) -> str:
    with open_subject(subject) as plant:
        description = plant.description
    require(isinstance(description, str) and description.strip() != "", messages.description_empty())
    require(len(description.splitlines()) == 1, messages.description_of_several_lines())
    return description


@requirement("It opens at zero volts: joint and motors do not move before the first write.")
def _opens_at_rest(subject: Subject) -> None:
    with open_subject(subject) as plant:
        first = plant.read()
        unwatched = round(0.5 * plant.unattended_max_s / T_s)
        for _ in range(min(50, unwatched)):
            require_at_rest(first, plant.read())


@requirement(
    "It can be read before the first write, in rad and N, with finite numbers within the bounds of its parameters."
)
def _reads_in_si(subject: Subject) -> str:
    with open_subject(subject) as plant:
        m = plant.read()
        check_reading(plant, m, subject.parameters)
        require(isinstance(plant.raw, RawReading), messages.not_a_raw_reading())
    return messages.first_reading(q=m.q, F_A=m.F_A, F_B=m.F_B)


@requirement("At zero volts joint and motors stay at rest, and every reading within one second is plausible.")
def _rests_at_zero_volts(subject: Subject) -> None:
    with open_subject(subject) as plant:
        first = plant.read()
        for _ in range(subject.ticks(PERIODS)):
            plant.write(ZERO_VOLTS)
            m = plant.read()
            check_reading(plant, m, subject.parameters)
            if subject.answers:
                require_at_rest(first, m)


@requirement(
    "A positive voltage turns its own motor in the winding direction: the angle of this motor "
    "rises, and that of the other motor does not."
)
def _a_voltage_acts(subject: Subject) -> str:
    volts = require_driving_voltage(subject)
    moved = {}
    for side, command in enumerate((MotorCommand(volts, 0.0), MotorCommand(0.0, volts))):
        with open_subject(subject) as plant:
            first = plant.read()
            last = drive(plant, command, DRIVE_TICKS)
        turned = last.theta_A - first.theta_A, last.theta_B - first.theta_B
        own, other = turned[side], turned[1 - side]
        letter = "AB"[side]
        require(
            own > MOVED_RAD,
            messages.motor_not_turned(voltage=volts, motor=letter, angle=own),
        )
        require(
            abs(other) < own,
            messages.other_motor_turned(voltage=volts, motor=letter, angle=other),
        )
        moved[letter] = own
    return messages.motors_turned(voltage=volts, angles=moved)


@requirement(
    "A written voltage acts from the next period on: without a write, a stepped plant returns the same reading again."
)
def _a_write_counts_from_the_next_reading(subject: Subject) -> None:
    volts = require_driving_voltage(subject)
    with open_subject(subject) as plant:
        if not plant.stepped:
            raise NotTriedError(messages.plant_not_stepped())
        m = drive(plant, MotorCommand(volts, volts), DRIVE_TICKS)
        again = plant.read()
        require(again[:3] == m[:3], messages.moved_without_write(before=m[:3], after=again[:3]))


@requirement("Voltages beyond the outputs' range are refused with a PlantError or limited to the range.")
def _keeps_to_its_voltages(subject: Subject) -> str:
    require_driving_voltage(subject)
    u_max = subject.parameters.motor.u_max
    with open_subject(subject) as plant:
        if not plant.stepped:
            raise NotTriedError(messages.full_voltage_in_real_time())
        at_bound = drive(plant, MotorCommand(u_max, u_max), 20)
    with open_subject(subject) as plant:
        try:
            beyond = drive(plant, MotorCommand(100.0 * u_max, 100.0 * u_max), 20)
        except PlantError as error:
            return messages.voltage_refused(reason=str(error))
    for excess in (beyond.theta_A - at_bound.theta_A, beyond.theta_B - at_bound.theta_B):
        require(excess < MOVED_RAD, messages.voltage_not_limited(voltage=100.0 * u_max, excess=excess, u_max=u_max))
    return messages.voltage_limited(u_max=u_max)


@requirement(
    "A voltage that is not a number is refused with a PlantError or replaced by zero volts; it causes no motion."
)
def _no_number_is_no_voltage(subject: Subject) -> str:
    outcomes = []
    for command in (MotorCommand(math.nan, 0.0), MotorCommand(0.0, math.inf)):
        with open_subject(subject) as plant:
            first = plant.read()
            try:
                plant.write(command)
            except PlantError as error:
                outcomes.append(messages.voltage_refused(reason=str(error)))
            for _ in range(20):
                m = plant.read()
                check_reading(plant, m, subject.parameters)
                if subject.answers:
                    require_at_rest(first, m)
                plant.write(ZERO_VOLTS)
    return outcomes[0] if outcomes else messages.replaced_by_zero_volts()


@requirement(
    "It refuses unsupported operations (zero, push, load, inject) with a PlantError; pushes and "
    "loads_shafts agree with what it supports."
)
def _refuses_in_a_sentence(subject: Subject) -> str:
    refused = []
    with open_subject(subject) as plant:
        m = plant.read()
        attempts: tuple[tuple[str, Callable[[], None]], ...] = (
            ("zero", lambda: plant.zero(m.q, m.theta_A, m.theta_B)),
            ("push", lambda: plant.push(0.0)),
            ("load", lambda: plant.load(NO_LOAD)),
            ("inject", lambda: plant.inject(InjectedFault(InjectedFaultKind.STUCK, Sensor.F_A))),
        )
        for name, attempt in attempts:
            try:
                attempt()
            except PlantError as error:
                require(str(error).strip() != "", messages.refusal_without_message(operation=name))
                refused.append(name)
        for name, attribute, is_able in (
            ("push", "pushes", plant.pushes),
            ("load", "loads_shafts", plant.loads_shafts),
        ):
            require(
                (name in refused) != is_able,
                messages.attribute_contradicted(attribute=attribute, value=is_able, operation=name),
            )
        check_reading(plant, plant.read(), subject.parameters)
    return messages.operations_refused(operations=refused) if refused else messages.operations_supported()


@requirement("Without a trip, it accepts an acknowledgement and can be read afterwards.")
def _can_be_acknowledged(subject: Subject) -> None:
    with open_subject(subject) as plant:
        if plant.read().safety_trip:
            raise NotTriedError(messages.plant_tripped())
        plant.acknowledge()
        plant.write(ZERO_VOLTS)
        check_reading(plant, plant.read(), subject.parameters)


@requirement(
    "It may be closed twice and releases its resources: the same plant and a new one can be opened afterwards."
)
def _closes_twice_and_opens_again(subject: Subject) -> None:
    plant = subject.make()
    plant.open()
    plant.read()
    plant.close()
    plant.close()
    for again in (plant, subject.make()):
        again.open()
        try:
            check_reading(again, again.read(), subject.parameters)
        finally:
            again.close()


@requirement("It may be closed without ever having been opened.")
def _closes_unopened(subject: Subject) -> None:
    subject.make().close()


@requirement(
    "A plant that paces the loop returns no reading before it is due; any other plant completes a read "
    "and a write within 1 ms."
)
def _keeps_the_time(subject: Subject) -> str:
    with open_subject(subject) as plant:
        paces = plant.paces_loop
        took_s: list[float] = []
        for _ in range(subject.ticks(PERIODS)):
            begun_s = time.perf_counter()
            plant.read()
            plant.write(ZERO_VOLTS)
            took_s.append(time.perf_counter() - begun_s)
    whole_s, usual_s, due_s = sum(took_s), median(took_s), len(took_s) * T_s
    if paces:
        require(whole_s > 0.9 * due_s, messages.readings_before_due(readings=len(took_s), duration_s=whole_s))
        return messages.duration_of_ticks(ticks=len(took_s), duration_s=whole_s)
    require(usual_s < T_s, messages.cycle_longer_than_period(cycle_s=usual_s))
    return messages.duration_of_cycle(cycle_s=usual_s)


@requirement("Its memory use does not grow over 10 000 cycles at zero volts.")
def _keeps_nothing_of_a_tick(subject: Subject) -> str:
    whole = subject.ticks(WARM_UP_TICKS + LONG_TICKS)
    warm_up = min(WARM_UP_TICKS, whole // 4)
    with freeze_garbage(), open_subject(subject) as plant:
        for _ in range(warm_up):
            plant.read()
            plant.write(ZERO_VOLTS)
        before = sys.getallocatedblocks()
        for _ in range(whole - warm_up):
            plant.read()
            plant.write(ZERO_VOLTS)
        grown = sys.getallocatedblocks() - before
    require(grown < GROWTH_BLOCKS, messages.memory_grows(blocks=grown, ticks=whole - warm_up))
    return messages.ticks_without_growth(ticks=whole - warm_up)


@requirement("A stepped plant created again with the same seed repeats its readings bit for bit.")
def _repeats(subject: Subject) -> None:
    runs = []
    for _ in range(2):
        with open_subject(subject) as plant:
            if not plant.stepped:
                raise NotTriedError(messages.plant_not_stepped())
            runs.append([drive(plant, MotorCommand(subject.voltage, 0.0), 1)[:5] for _ in range(subject.ticks(100))])
    require(runs[0] == runs[1], messages.readings_not_repeated())


CHECKS: tuple[Check, ...] = (
    _is_a_plant,
    _describes_itself,
    _opens_at_rest,
    _reads_in_si,
    _rests_at_zero_volts,
    _a_voltage_acts,
    _a_write_counts_from_the_next_reading,
    _keeps_to_its_voltages,
    _no_number_is_no_voltage,
    _refuses_in_a_sentence,
    _can_be_acknowledged,
    _closes_twice_and_opens_again,
    _closes_unopened,
    _keeps_the_time,
    _keeps_nothing_of_a_tick,
    _repeats,
)
"""Checks in order of execution: no check drives the plant before one has shown that it rests at zero volts."""


def run_contract(subject: Subject, checks: tuple[Check, ...] = CHECKS) -> Iterator[CheckFinding]:
    """Run each check on a new plant and yield its result."""
    for check in checks:
        try:
            outcome, seen = CheckOutcome.HOLDS, check.make(subject) or ""
        except RequirementError as broken:
            outcome, seen = CheckOutcome.BROKEN, broken.message
        except NotTriedError as reason:
            outcome, seen = CheckOutcome.NOT_TRIED, reason.message
        except PlantError as error:
            outcome, seen = CheckOutcome.BROKEN, messages.check_failed(reason=error.message)
        except Exception as error:
            outcome = CheckOutcome.BROKEN
            seen = messages.other_error_raised(kind=type(error).__name__, reason=str(error))
        yield CheckFinding(check.name, check.sentence, outcome, seen)
