"""What a fault is told in: one sentence, what was seen of it after a colon, and no number without its unit."""

import re

import pytest

from backend.control.fault_detection import CLEAR, TRIPPED, FaultDetectionState
from backend.faults import EXPLANATIONS, Fault, describe_fault
from backend.realtime.commands import Inject, Stop, Stopped
from backend.realtime.control_loop import FaultDescriber
from backend.units import AngleUnit, format_text
from plant.interface import NO_RAW, NOT_MEASURED, InjectedFault, InjectedFaultKind, MotorCommand, Sensor
from plant.parameters import PlantParameters, load_parameters
from tests.realtime.test_faults import moving, until_tripped

SENTENCE = re.compile(r"[A-Z][^:]*(: .*[^.])?\.")
WITHOUT_UNIT = re.compile(r"(?<![\w.-])-?\d+(?:\.\d+)?(?![\d.]|:? (?:rad|N|V|s|ms)\b| to -?\d)")


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.mark.parametrize(
    ("broken", "expected"),
    [
        (
            InjectedFault(InjectedFaultKind.JUMP, Sensor.Q),
            r"A sensor jumped further than the rig can move: q went from .* to .* rad\.",
        ),
        (InjectedFault(InjectedFaultKind.JUMP, Sensor.F_A), r".*: F_A went from .* to .* N\."),
        (
            InjectedFault(InjectedFaultKind.STUCK, Sensor.F_B),
            r".*: F_B stands at .* N although its motor turned by .* rad\.",
        ),
        (
            InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.Q),
            r"The joint left its range: q = .* rad; the bound is .* rad .*\.",
        ),
        (
            InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.F_A),
            r"A tendon pulled harder than its limit: F_A = .* N above .* N; F_B = .* N\.",
        ),
        (
            InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.F_A),
            r"A tendon was slack for too long: F_A = .* N below .* N for .*; F_B = .* N\.",
        ),
        (InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.Q), r"A sensor gave no number: no number from q\."),
        (
            InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.THETA_A),
            r"Tension and motor positions contradict each other: F_A = .*",
        ),
        (
            InjectedFault(InjectedFaultKind.SAFETY_TRIP),
            r"The independent safety module cut the motors: .*F_A = .* N, F_B = .* N, q = .* rad .*",
        ),
    ],
    ids=lambda value: f"{value.kind}-{value.sensor}" if isinstance(value, InjectedFault) else "",
)
def test_a_fault_is_one_sentence_with_units(lab: PlantParameters, broken: InjectedFault, expected: str) -> None:
    bench = moving(lab)
    bench.send(Inject(broken))
    until_tripped(bench, 2000)
    (stopped,) = (event for event in bench.events if isinstance(event, Stopped))
    told = format_text(describe_fault(stopped.fault, stopped.detail), AngleUnit.RADIANS)
    assert re.fullmatch(expected, told), told
    assert SENTENCE.fullmatch(told)
    assert WITHOUT_UNIT.findall(told) == []


def test_a_stop_that_was_pressed_says_no_more_than_that(lab: PlantParameters) -> None:
    bench = moving(lab)
    bench.send(Stop())
    bench.advance(0.01)
    (stopped,) = (event for event in bench.events if isinstance(event, Stopped))
    assert describe_fault(stopped.fault, stopped.detail) == EXPLANATIONS[Fault.STOP_PRESSED].message


def test_a_reading_that_is_no_number_is_told_without_a_unit(lab: PlantParameters) -> None:
    tripped = CLEAR._replace(kind=TRIPPED)
    seen = FaultDetectionState(*(len(FaultDetectionState._fields) * [None]))  # type: ignore[arg-type]
    m = NOT_MEASURED._replace(F_B=12.0)
    _, detail = FaultDescriber(lab).describe(tripped, seen, m, m, MotorCommand(0.0, 0.0), NO_RAW, 0)
    assert detail == "the loop read no number from F_A, F_B = 12.0 N, no number from q then"
