"""Rejections of tare and calibration, with quantity, value, bound with unit, and remedy."""

import asyncio
import re
from typing import Any

import pytest

from backend.commissioning.procedure import StepFinding
from backend.commissioning.session import collect_values
from backend.commissioning.steps import WEIGHT_MAX_N, StepId
from backend.errors import OutOfRangeError
from backend.realtime.commands import Inject
from plant.interface import InjectedFault, InjectedFaultKind, Sensor
from tests.commissioning.rigs import WIRING, CommissionedRig, played, with_entries

REFUSED: dict[str, tuple[dict[str, dict[str, Any]], str]] = {
    "wrong sign": (
        {"load_cell_A": {"slope": -9.4}},
        r"load cell A has -9\.[34]\d* N/V, and the wiring says 10 N/V, .*turn the sign of load_cell_A\.slope",
    ),
    "saturated": (
        {"load_cell_B": {"slope": 1.5}},
        r"load cell B reads up to 10\.00 V, 9\.99 V are the end of its input: less load, or less gain",
    ),
    "dead": (
        {"load_cell_A": {"channel": "ai7"}},
        r"load cell A reads 0\.00 mV more under 25 N than under 5 N, 1 mV at least .*look at its cable",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_load_cell_that_cannot_be_calibrated_is_refused_in_words(case: str) -> None:
    true, said = REFUSED[case]
    rig = CommissionedRig(WIRING, with_entries(WIRING, **true))
    (finding,) = played(rig, StepId.CALIBRATE, weight_1_N=5.0, weight_2_N=25.0)
    assert not finding.passed
    assert not finding.calibrations
    assert re.match(said, finding.text), finding.text


@pytest.mark.parametrize("step", [StepId.TARE, StepId.CALIBRATE])
def test_no_number_is_not_taken_for_a_load(step: StepId) -> None:
    async def session() -> StepFinding:
        rig = CommissionedRig()

        async def broken(_words: str) -> None:
            await rig.loop.send(Inject(InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.F_A)))

        rig.meanwhile = broken
        try:
            return await rig.do(step)
        finally:
            rig.loop.close()

    finding = asyncio.run(session())
    assert (finding.passed, finding.calibrations) == (False, ())
    assert finding.text == "load cell A gave no number of volts: look at its cable, amplifier and channel"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"weight_1_N": 5.0, "weight_2_N": 9.0},
            r"heavier weight: 9 N is less than 10 N; take weights at least 5 N apart, the lighter one first",
        ),
        ({"weight_1_N": 25.0, "weight_2_N": 5.0}, r"heavier weight: 5 N is less than 30 N; .* the lighter one first"),
        (
            {"weight_2_N": WEIGHT_MAX_N + 1.0},
            rf"heavier weight: {WEIGHT_MAX_N + 1.0:g} N is outside 0 to {WEIGHT_MAX_N:g} N",
        ),
        ({"weight_1_N": -1.0}, rf"lighter weight: -1 N is outside 0 to {WEIGHT_MAX_N:g} N"),
        ({"weight_2_N": float("nan")}, rf"heavier weight: nan N is outside 0 to {WEIGHT_MAX_N:g} N"),
    ],
)
def test_weights_that_tell_nothing_are_refused_before_anything_is_hung(given: dict[str, Any], said: str) -> None:
    with pytest.raises(OutOfRangeError, match=said):
        collect_values(StepId.CALIBRATE, given)
