"""What a Plant promises, as checks that run against any: ``sinew rig conformance``, and the tests of this house.

Nothing is moved but by the voltage that a ``Subject`` allows: at 0 V only what a plant at rest shows is checked.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator
from statistics import median

from plant.breakage import Breakage, Broken, Sensor
from plant.interface import NO_LOAD, ZERO_VOLTS, MotorCommand, PlantError, RawReading, T_s
from plant.packages import lacks
from plant.promises import (
    PERIODS,
    BrokenPromiseError,
    Check,
    Finding,
    NotTriedError,
    Outcome,
    Subject,
    at_rest,
    driven,
    driving_voltage,
    look,
    opened,
    others_garbage_stays,
    promise,
    require,
)

LONG_TICKS = 10_000
WARM_UP_TICKS = 3_000
"""What fills once has filled by then: on the virtual card, where nothing else ran before, 1000 blocks in the second
thousand ticks and none after that."""

GROWTH_BLOCKS = 200
"""Blocks of memory more after ``LONG_TICKS``: some caches fill once, nothing may be kept of each tick."""

DRIVE_TICKS = 300
MOVED_RAD = 1e-3


@promise("It has all parts of the Plant protocol, each of the type that the protocol gives.")
def _is_a_plant(subject: Subject) -> str:
    plant = subject.make()
    require(not lacks(plant), f"it has no {lacks(plant)}")
    for name in ("paces_loop", "stepped", "pushes", "loads_shafts"):
        require(isinstance(getattr(plant, name), bool), f"{name} has to be True or False")
    limit_s = plant.unattended_max_s
    require(isinstance(limit_s, float) and T_s < limit_s < math.inf, f"unattended_max_s = {limit_s}: give seconds")
    require(isinstance(plant.unready, str), "unready has to be a sentence, empty where it may be controlled")
    require(not (plant.stepped and plant.paces_loop), "stepped and paces_loop: it can be one of them only")
    return f"may be left alone for {1e3 * limit_s:g} ms"


@promise("Once it is open, its description says in one line what is driven and how it is timed.")
def _describes_itself(subject: Subject) -> str:
    with opened(subject) as plant:
        said = plant.description
    require(isinstance(said, str) and said.strip() != "", "it says nothing")
    require(len(said.splitlines()) == 1, "it has more than one line")
    return said


@promise("It opens at zero volts: joint and motors stand still before anything is written.")
def _opens_at_rest(subject: Subject) -> None:
    with opened(subject) as plant:
        first = plant.read()
        unwatched = round(0.5 * plant.unattended_max_s / T_s)
        for _ in range(min(50, unwatched)):
            at_rest(first, plant.read())


@promise("It can be read before the first write, in rad and N, with finite numbers that its parameters allow.")
def _reads_in_si(subject: Subject) -> str:
    with opened(subject) as plant:
        m = plant.read()
        look(plant, m, subject.parameters)
        require(isinstance(plant.raw, RawReading), "raw has to be a RawReading")
    return f"q = {m.q:.4g} rad, F_A = {m.F_A:.3g} N, F_B = {m.F_B:.3g} N"


@promise("At zero volts joint and motors stay where they are, and every reading of a second is in order.")
def _rests_at_zero_volts(subject: Subject) -> None:
    with opened(subject) as plant:
        first = plant.read()
        for _ in range(subject.ticks(PERIODS)):
            plant.write(ZERO_VOLTS)
            m = plant.read()
            look(plant, m, subject.parameters)
            if subject.answers:
                at_rest(first, m)


@promise("A positive voltage winds its own motor up: its angle grows, and the other motor's does not.")
def _a_voltage_acts(subject: Subject) -> str:
    volts = driving_voltage(subject)
    moved = []
    for side, command in enumerate((MotorCommand(volts, 0.0), MotorCommand(0.0, volts))):
        with opened(subject) as plant:
            first = plant.read()
            last = driven(plant, command, DRIVE_TICKS)
        turned = last.theta_A - first.theta_A, last.theta_B - first.theta_B
        own, other = turned[side], turned[1 - side]
        letter = "AB"[side]
        require(own > MOVED_RAD, f"{volts:g} V on motor {letter} turned it by {own:.2g} rad: sign, or too little?")
        require(abs(other) < own, f"{volts:g} V on motor {letter} turned the other one by {other:.2g} rad: swapped?")
        moved.append(f"{letter} by {own:.3g} rad")
    return f"{volts:g} V turned {', '.join(moved)}"


@promise("What is written acts from the next period on: without a write a stepped plant reads the same again.")
def _a_write_counts_from_the_next_reading(subject: Subject) -> None:
    volts = driving_voltage(subject)
    with opened(subject) as plant:
        if not plant.stepped:
            raise NotTriedError("it moves with the clock, not with the writes")
        m = driven(plant, MotorCommand(volts, volts), DRIVE_TICKS)
        again = plant.read()
        require(again[:3] == m[:3], f"it moved between two readings without a write: {m[:3]} to {again[:3]}")


@promise("Voltages beyond the outputs' range are refused with a PlantError or held at the range.")
def _keeps_to_its_voltages(subject: Subject) -> str:
    driving_voltage(subject)
    u_max = subject.parameters.motor.u_max
    with opened(subject) as plant:
        if not plant.stepped:
            raise NotTriedError("a plant that really moves is not driven at full voltage")
        at_bound = driven(plant, MotorCommand(u_max, u_max), 20)
    with opened(subject) as plant:
        try:
            beyond = driven(plant, MotorCommand(100.0 * u_max, 100.0 * u_max), 20)
        except PlantError as error:
            return f"refused: {error}"
    for excess in (beyond.theta_A - at_bound.theta_A, beyond.theta_B - at_bound.theta_B):
        require(excess < MOVED_RAD, f"at {100.0 * u_max:g} V it went {excess:.2g} rad further than at {u_max:g} V")
    return f"held at {u_max:g} V"


@promise("A voltage that is no number is refused with a PlantError or taken for zero volts; nothing moves by it.")
def _no_number_is_no_voltage(subject: Subject) -> str:
    said = []
    for command in (MotorCommand(math.nan, 0.0), MotorCommand(0.0, math.inf)):
        with opened(subject) as plant:
            first = plant.read()
            try:
                plant.write(command)
            except PlantError as error:
                said.append(f"refused: {error}")
            for _ in range(20):
                m = plant.read()
                look(plant, m, subject.parameters)
                if subject.answers:
                    at_rest(first, m)
                plant.write(ZERO_VOLTS)
    return said[0] if said else "taken for zero volts"


@promise(
    "What it cannot do (zero, push, load, break) it refuses with a PlantError; pushes, loads_shafts tell the truth."
)
def _refuses_in_a_sentence(subject: Subject) -> str:
    refused = []
    with opened(subject) as plant:
        m = plant.read()
        attempts: tuple[tuple[str, Callable[[], None]], ...] = (
            ("zero", lambda: plant.zero(m.q, m.theta_A, m.theta_B)),
            ("push", lambda: plant.push(0.0)),
            ("load", lambda: plant.load(NO_LOAD)),
            ("inject", lambda: plant.inject(Broken(Breakage.STUCK, Sensor.F_A))),
        )
        for name, attempt in attempts:
            try:
                attempt()
            except PlantError as error:
                require(str(error).strip() != "", f"{name} is refused without a word")
                refused.append(name)
        for name, says, able in (("push", "pushes", plant.pushes), ("load", "loads_shafts", plant.loads_shafts)):
            require((name in refused) != able, f"{says} is {able}: {name} says otherwise")
        look(plant, plant.read(), subject.parameters)
    return f"refuses {', '.join(refused)}" if refused else "can do all of them"


@promise("Without a trip there is something to read after an acknowledgement, and no reason to refuse it.")
def _can_be_acknowledged(subject: Subject) -> None:
    with opened(subject) as plant:
        if plant.read().safety_trip:
            raise NotTriedError("its safety module has tripped: acknowledge it first")
        plant.acknowledge()
        plant.write(ZERO_VOLTS)
        look(plant, plant.read(), subject.parameters)


@promise("It may be closed twice, and lets go of what it held: it and another one open after that.")
def _closes_twice_and_opens_again(subject: Subject) -> None:
    plant = subject.make()
    plant.open()
    plant.read()
    plant.close()
    plant.close()
    for again in (plant, subject.make()):
        again.open()
        try:
            look(again, again.read(), subject.parameters)
        finally:
            again.close()


@promise("It may be closed without ever having been opened.")
def _closes_unopened(subject: Subject) -> None:
    subject.make().close()


@promise("A plant that paces the loop gives no reading before it is due; any other reads and writes well within 1 ms.")
def _keeps_the_time(subject: Subject) -> str:
    with opened(subject) as plant:
        paces = plant.paces_loop
        took_s: list[float] = []
        for _ in range(subject.ticks(PERIODS)):
            begun_s = time.perf_counter()
            plant.read()
            plant.write(ZERO_VOLTS)
            took_s.append(time.perf_counter() - begun_s)
    whole_s, usual_s, due_s = sum(took_s), median(took_s), len(took_s) * T_s
    if paces:
        require(whole_s > 0.9 * due_s, f"{len(took_s)} readings came within {whole_s:.3f} s, before they were due")
        return f"{len(took_s)} ticks took {whole_s:.3f} s"
    require(usual_s < T_s, f"a reading and a write take {1e3 * usual_s:.2f} ms, longer than a period")
    return f"a reading and a write take {1e6 * usual_s:.0f} µs (median)"


@promise("Over 10 000 ticks at zero volts it needs no more memory from tick to tick.")
def _keeps_nothing_of_a_tick(subject: Subject) -> str:
    whole = subject.ticks(WARM_UP_TICKS + LONG_TICKS)
    warm_up = min(WARM_UP_TICKS, whole // 4)
    with others_garbage_stays(), opened(subject) as plant:
        for _ in range(warm_up):
            plant.read()
            plant.write(ZERO_VOLTS)
        before = sys.getallocatedblocks()
        for _ in range(whole - warm_up):
            plant.read()
            plant.write(ZERO_VOLTS)
        grown = sys.getallocatedblocks() - before
    require(grown < GROWTH_BLOCKS, f"{grown} blocks of memory more after {whole - warm_up} ticks")
    return f"{whole - warm_up} ticks"


@promise("A stepped plant made with the same seed does the same again, to the last bit.")
def _repeats(subject: Subject) -> None:
    runs = []
    for _ in range(2):
        with opened(subject) as plant:
            if not plant.stepped:
                raise NotTriedError("it moves with the clock, not with the writes")
            runs.append([driven(plant, MotorCommand(subject.voltage, 0.0), 1)[:5] for _ in range(subject.ticks(100))])
    require(runs[0] == runs[1], "the second time it read otherwise")


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
"""In the order in which they are made: nothing is driven before it is known to stand still at zero volts."""


def run_contract(subject: Subject, checks: tuple[Check, ...] = CHECKS) -> Iterator[Finding]:
    """Make each check on a plant of its own and yield what came of it."""
    for check in checks:
        try:
            outcome, seen = Outcome.HOLDS, check.make(subject) or ""
        except BrokenPromiseError as broken:
            outcome, seen = Outcome.BROKEN, str(broken)
        except NotTriedError as reason:
            outcome, seen = Outcome.NOT_TRIED, str(reason)
        except PlantError as error:
            outcome, seen = Outcome.BROKEN, f"it failed: {error}"
        except Exception as error:
            outcome, seen = Outcome.BROKEN, f"{type(error).__name__} in place of a PlantError: {error}"
        yield Finding(check.name, check.sentence, outcome, seen)
