"""Pretension and the safety module's trip: what is not measured, or stops for another reason, does not pass."""

import asyncio
import math

import numpy as np
import pytest

from backend.bring_up.steps import StepId
from backend.bring_up.tension import let_go, near_pretension, peaks
from backend.bring_up.work import Finding
from backend.faults import Fault
from backend.loop.commands import Stop
from backend.loop.mode import Mode
from plant.breakage import Breakage, Broken, Sensor
from tests.bring_up.rigs import BroughtUpRig, played

BEFORE = (StepId.ZERO, StepId.DIRECTION)
NAN = math.nan


@pytest.mark.parametrize("F", [(NAN, 10.0), (10.0, NAN), (NAN, NAN)])
def test_no_number_is_neither_the_pretension_nor_a_tendon_let_go_nor_within_bounds(F: tuple[float, float]) -> None:
    held = np.array([10.0, 10.0])
    assert near_pretension(held)
    assert not near_pretension(np.array(F))
    assert let_go(held, np.array([2.0, 2.0]))
    assert not let_go(held, np.array(F) - 8.0)
    highest, apart = peaks(np.array([held, F]))
    assert math.isnan(highest)
    assert math.isnan(apart)


def test_a_load_cell_that_is_lost_at_the_trip_has_not_seen_the_motors_let_go() -> None:
    rig = BroughtUpRig()

    def lose(phase: str) -> None:
        if phase == "waiting for the trip":
            rig.rig.inject(Broken(Breakage.SATURATION, Sensor.F_B))

    async def mend(words: str) -> None:
        if "Set the module's limit back" in words:
            rig.rig.inject(None)

    rig.in_phase, rig.meanwhile = lose, mend
    *_, finding = played(rig, *BEFORE, StepId.SAFETY_MODULE)
    assert not finding.passed, finding.text


def test_a_loop_that_stopped_for_another_reason_is_not_reset() -> None:
    """Somebody presses STOP while the step waits for the module."""
    rig = BroughtUpRig()

    async def press(words: str) -> None:
        if "Lower the tension limit" in words:
            await rig.loop.send(Stop(Fault.STOP_PRESSED))

    rig.meanwhile = press

    async def work() -> tuple[Finding, Mode]:
        for step in BEFORE:
            assert (await rig.do(step)).passed
        finding = await rig.do(StepId.SAFETY_MODULE)
        await rig.loop.advance(0.01)
        return finding, rig.mode

    try:
        finding, mode = asyncio.run(work())
    finally:
        rig.loop.close()
    assert not finding.passed
    assert "not because of the safety module" in finding.text
    assert mode is Mode.TRIPPED
    assert not any("Set the module's limit back" in words for words in rig.asked)
