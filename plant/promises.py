"""Words that the contract of a Plant is written in: what is checked, what came of it, and how a check looks at it."""

import gc
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum

from plant.interface import Measurement, MotorCommand, Plant, T_s
from plant.parameters import PlantParameters

RESTING_RAD = 0.02
"""How far joint and motors may creep at zero volts in a second [rad]: a slack tendon settling."""

PERIODS = round(1.0 / T_s)
"""Ticks of a second."""


class Outcome(StrEnum):
    """What became of a check."""

    HOLDS = "holds"
    BROKEN = "broken"
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Subject:
    """What is checked: ``make`` gives the plant, not yet open, as often as it is asked.

    ``voltage`` [V] is what a check may put on the outputs, 0 where nothing may move. A recording played back ``lasts``
    for so many ticks only, and what is written to it has no effect: it does not answer.
    """

    make: Callable[[], Plant]
    parameters: PlantParameters
    voltage: float = 0.0
    answers: bool = True
    lasts: int = 1_000_000

    def ticks(self, wanted: int) -> int:
        """Return ``wanted``, or as many ticks as there are."""
        return min(wanted, self.lasts - 1)


@dataclass(frozen=True)
class Finding:
    """A sentence of the contract, what became of it, and what was seen."""

    name: str
    sentence: str
    outcome: Outcome
    seen: str = ""


class BrokenPromiseError(Exception):
    """A plant does not keep the contract; the message says what was seen."""


class NotTriedError(Exception):
    """A check cannot be made here; the message says why."""


@dataclass(frozen=True)
class Check:
    """A promise: its name, the sentence that a person reads, and what raises where it is not kept."""

    name: str
    sentence: str
    make: Callable[[Subject], str | None]


def promise(sentence: str) -> Callable[[Callable[[Subject], str | None]], Check]:
    """Make a check of a function that returns what was seen."""
    return lambda made: Check(made.__name__.strip("_"), sentence, made)


def require(kept: bool, seen: str) -> None:
    """Raise BrokenPromiseError with what was ``seen`` unless the promise is ``kept``."""
    if not kept:
        raise BrokenPromiseError(seen)


@contextmanager
def opened(subject: Subject) -> Iterator[Plant]:
    """Give a plant that is open; close it at the end, whatever happens."""
    plant = subject.make()
    plant.open()
    try:
        yield plant
    finally:
        plant.close()


@contextmanager
def others_garbage_stays() -> Iterator[None]:
    """Keep the collector's hands off all that is there already, until the end: memory can be counted meanwhile.

    Garbage in cycles that others have left would be freed between two counts and hide what is kept. To collect it
    at a count would keep the plant waiting for longer than a watchdog does, and empty lists that fill again.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def driving_voltage(subject: Subject) -> float:
    """Return the voltage that may be used [V]. Raises NotTriedError where there is none."""
    if not subject.answers:
        raise NotTriedError("what is written to it has no effect, as it says")
    if subject.voltage <= 0.0:
        raise NotTriedError("it would move: allow it a small voltage")
    return subject.voltage


def look(plant: Plant, m: Measurement, parameters: PlantParameters) -> None:
    """Raise BrokenPromiseError for a reading that no rig of these parameters gives."""
    require(isinstance(m, Measurement), f"read gave a {type(m).__name__}, it has to be a Measurement")
    wrong = [name for name, value in zip(m._fields, m, strict=True) if not isinstance(value, float)]
    require(not wrong, f"no floats: {', '.join(wrong)}")
    told = {name: value for name, value in zip(m._fields, m, strict=True) if name not in ("S_true", "F_wall")}
    silent = [name for name, value in told.items() if not math.isfinite(value)]
    require(not silent, f"no finite number: {', '.join(silent)}")
    q_max, F_max = parameters.geometry.q_max, parameters.safety.F_max
    require(abs(m.q) <= 1.1 * q_max, f"q = {m.q:g}, beyond {q_max:.3g} rad: is it in rad?")
    for name, F in (("F_A", m.F_A), ("F_B", m.F_B)):
        require(-0.1 * F_max <= F <= F_max, f"{name} = {F:g}, outside 0 to {F_max:g} N: is it in N, and tared?")
    for name, theta in (("theta_A", m.theta_A), ("theta_B", m.theta_B)):
        require(abs(theta) <= 100.0, f"{name} = {theta:g}, beyond 100 rad: is it in rad at the gearbox outlet?")
    require(m.safety_trip in (0.0, 1.0), f"safety_trip = {m.safety_trip:g}, it has to be 0 or 1")
    require(len(plant.raw) == 5, "raw has to be a RawReading, of nan where there is no card")


def driven(plant: Plant, command: MotorCommand, ticks: int) -> Measurement:
    """Write for so many ticks, each after a reading, at the plant's pace; return what is read then."""
    for _ in range(ticks):
        begun_s = time.monotonic()
        plant.read()
        plant.write(command)
        if not (plant.stepped or plant.paces_loop):
            time.sleep(max(0.0, T_s - (time.monotonic() - begun_s)))
    return plant.read()


def at_rest(first: Measurement, m: Measurement) -> None:
    """Raise BrokenPromiseError where joint or motors have moved by more than a slack tendon settles."""
    for name in ("q", "theta_A", "theta_B"):
        crept = abs(getattr(m, name) - getattr(first, name))
        if not crept <= RESTING_RAD:
            raise BrokenPromiseError(f"{name} moved by {crept:.2g} rad at zero volts")
