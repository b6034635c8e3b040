"""Every step on a virtual card: correct wiring passes, and the responsible step finds each error."""

import asyncio
from typing import Any

import numpy as np
import pytest

from backend.commissioning.steps import STEPS, StepId
from backend.realtime.commands import Refused, SetMode, SwitchDrives
from backend.realtime.modes import MODE_CODE, Mode
from backend.sample import INDEX
from plant.interface import InjectedFault, InjectedFaultKind, Sensor
from tests.commissioning.rigs import WIRING, CommissionedRig, played, with_entries


def test_a_rig_with_correct_wiring_passes_every_step() -> None:
    wiring = with_entries(end_switch={"position": 0.4})
    findings = dict(zip(StepId, played(CommissionedRig(wiring, wiring), *(step.id for step in STEPS)), strict=True))
    assert [finding.text for finding in findings.values() if not finding.passed] == []
    # The pretension of 10 N, as the load cells' own figures say it.
    tensions = {figure.words: figure.value for figure in findings[StepId.PRETENSION].figures}
    assert tensions["tension of tendon A"] == pytest.approx(10.0, abs=0.3)
    assert tensions["tension of tendon B"] == pytest.approx(10.0, abs=0.3)


WRONG_BY_HAND: dict[str, tuple[dict[str, dict[str, Any]], tuple[str, ...]]] = {
    "signs": (
        {"encoder_q": {"direction": -1.0}, "encoder_B": {"direction": -1.0}, "load_cell_A": {"slope": -10.0}},
        ("encoder_q.direction", "encoder_B.direction", "load_cell_A.slope"),
    ),
    "swapped": (
        {
            "load_cell_A": {"channel": "ai1"},
            "load_cell_B": {"channel": "ai0"},
            "encoder_A": {"counter": "ctr2"},
            "encoder_B": {"counter": "ctr1"},
        },
        ("load_cell_A.channel and load_cell_B.channel", "encoder_A.counter and encoder_B.counter"),
    ),
}
"""Independent errors, so that one test of 20 s finds all of them."""


@pytest.mark.parametrize("case", WRONG_BY_HAND)
def test_the_wiring_test_names_what_is_wired_wrongly_and_nothing_else(case: str) -> None:
    entries, named = WRONG_BY_HAND[case]
    (finding,) = played(CommissionedRig(with_entries(WIRING, **entries)), StepId.WIRING_TEST)
    assert not finding.passed
    assert all(entry in finding.text for entry in named), finding.text
    assert {section for section in SENSORS if section in finding.text} == {*entries}


SENSORS = {"encoder_q": "counter", "encoder_A": "counter", "encoder_B": "counter"} | dict.fromkeys(
    ("load_cell_A", "load_cell_B"), "channel"
)


@pytest.mark.parametrize("dead", [("encoder_q", "load_cell_A"), ("encoder_A", "load_cell_B"), ("encoder_B",)])
def test_the_wiring_test_finds_dead_sensors(dead: tuple[str, ...]) -> None:
    """Sensors are not connected although the wiring file has them."""
    nowhere = {section: {SENSORS[section]: "ctr3" if SENSORS[section] == "counter" else "ai7"} for section in dead}
    (finding,) = played(CommissionedRig(WIRING, with_entries(WIRING, **nowhere)), StepId.WIRING_TEST)
    assert not finding.passed
    for section in SENSORS:
        found = f"did not move: look at its cable and at {section}" in finding.text
        assert found is (section in dead), finding.text


WRONG_WITH_VOLTAGE = [
    ("motor sign A", {"motor_A": {"gain": -1.0}}, ["motor_A.gain"]),
    ("motor sign B", {"motor_B": {"gain": -1.0}}, ["motor_B.gain"]),
    ("swapped motors", {"motor_A": {"channel": "ao1"}, "motor_B": {"channel": "ao0"}}, ["motor_A.channel and motor_B"]),
    ("encoder sign", {"encoder_A": {"direction": -1.0}}, ["encoder_A.direction"]),
    (
        "both signs of one motor",
        {"motor_A": {"gain": -1.0}, "encoder_A": {"direction": -1.0}},
        ["motor_A.gain", "encoder_A.direction"],
    ),
    ("dead motor", {"motor_B": {"channel": "ao3"}}, ["motor_B.channel"]),
]


@pytest.mark.parametrize(
    ("entries", "named"), [case[1:] for case in WRONG_WITH_VOLTAGE], ids=[case[0] for case in WRONG_WITH_VOLTAGE]
)
def test_the_direction_step_names_it_before_any_loop_is_closed(
    entries: dict[str, dict[str, Any]], named: list[str]
) -> None:
    rig = CommissionedRig(with_entries(WIRING, **entries))
    played_steps = played_and_refused(rig)
    zero, direction, before, after = played_steps
    assert zero.passed
    assert "zero" in before.reason
    assert not direction.passed
    assert all(entry in direction.text for entry in named), direction.text
    assert "direction" in after.reason
    # The joint's encoder is wired rightly in all of these.
    assert rig.joint_moved > 0.0 or "motor_B.channel" in named
    assert rig.joint_moved < 0.1
    assert rig.most_volts <= 1.0


def played_and_refused(rig: CommissionedRig) -> tuple[Any, Any, Refused, Refused]:
    async def work() -> tuple[Any, Any, Refused, Refused]:
        await rig.loop.advance(0.01)
        before = await rig.loop.send(SetMode(Mode.PRETENSION))
        zero = await rig.do(StepId.ZERO)
        first = rig.loop.ring.count
        direction = await rig.do(StepId.DIRECTION)
        after = await rig.loop.send(SetMode(Mode.PRETENSION))
        _, rows, _ = rig.loop.ring.read(first, rig.loop.ring.capacity)
        moving = rows[np.argmax(rows[:, INDEX["mode"]] == MODE_CODE[Mode.IDENTIFY]) :, INDEX["q"]]
        rig.joint_moved = float(np.abs(moving - moving[0]).max())
        rig.most_volts = float(np.abs(rows[:, [INDEX["u_A"], INDEX["u_B"]]]).max())
        assert isinstance(before, Refused)
        assert isinstance(after, Refused)
        return zero, direction, before, after

    try:
        return asyncio.run(work())
    finally:
        rig.loop.close()


def test_two_weights_give_slope_and_offset_of_the_card() -> None:
    """The real load cells differ from the wiring file by 7 % and 0.31 V."""
    true = with_entries(load_cell_A={"slope": 10.7, "offset": 0.31}, load_cell_B={"slope": 9.4, "offset": -0.22})
    (finding,) = played(CommissionedRig(WIRING, true), StepId.CALIBRATE, weight_1_N=5.0, weight_2_N=25.0)
    assert finding.passed, finding.text
    A, B = finding.calibrations
    assert (A.slope, B.slope) == pytest.approx((10.7, 9.4), rel=2e-3)
    assert (A.offset, B.offset) == pytest.approx((0.31, -0.22), rel=2e-3)


BENT = {
    "slope": float("nan"),
    "offset": float("nan"),
    "table": ((-10.0, -100.0), (1.0, 17.0), (2.0, 25.0), (10.0, 90.0)),
}


@pytest.mark.parametrize(("true", "passed"), [({"slope": 9.4, "offset": -0.22}, True), (BENT, False)])
def test_more_weights_show_whether_one_load_cell_has_a_line(true: dict[str, Any], passed: bool) -> None:
    rig = CommissionedRig(WIRING, with_entries(load_cell_B=true))
    finding = asyncio.run(rig.do(StepId.CALIBRATE, "B", weight_1_N=5.0, weight_2_N=25.0, weight_3_N=15.0))
    rig.loop.close()
    assert finding.passed is passed, finding.text
    hung = [words.partition(",")[0] for words in rig.asked if words.startswith("Hang")]
    assert hung == [f"Hang {F} N on load cell B" for F in (5, 15, 25)]
    if passed:
        (cell,) = finding.calibrations
        assert cell.tendon == "B"
        assert (cell.slope, cell.offset) == pytest.approx((9.4, -0.22), rel=2e-3)
    else:
        assert "off its line by" in finding.text


def test_a_tare_takes_the_volts_without_load() -> None:
    true = with_entries(load_cell_A={"offset": 0.31}, load_cell_B={"offset": -0.22})
    rig = CommissionedRig(WIRING, true)
    (finding,) = played(rig, StepId.TARE)
    assert finding.passed, finding.text
    # 1 s of noise of 5 mV leaves 0.2 mV.
    assert [found.offset for found in finding.calibrations] == pytest.approx([0.31, -0.22], abs=1e-3)
    noise = {figure.words: figure.value for figure in finding.figures}["noise of load cell A"]
    assert noise == pytest.approx(0.05, rel=0.2)


def test_homing_reports_its_findings_and_withdraws_contradicted_directions() -> None:
    wiring = with_entries(end_switch={"position": 0.4})
    rig = CommissionedRig(wiring, with_entries(end_switch={"position": 0.4}, motor_A={"gain": -1.0}))
    rig.rig.prove_directions(proven=True)
    (finding,) = played(rig, StepId.HOME)
    assert not finding.passed
    assert "a motor did not go where it was sent: do the direction step again" in finding.text
    assert "directions are not proven" in rig.rig.unproven


def test_homing_takes_the_end_switch_for_where_it_is() -> None:
    wiring = with_entries(end_switch={"position": 0.9})
    rig = CommissionedRig(wiring, wiring)
    (finding,) = played(rig, StepId.ZERO)
    assert finding.passed, finding.text
    assert finding.figures[0].value == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("step", "broken"),
    [
        (StepId.WIRING_TEST, InjectedFault(InjectedFaultKind.SWAPPED_LOAD_CELLS)),
        (StepId.DIRECTION, InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.F_B)),  # it fails before a motor is tried
    ],
)
def test_a_step_that_contradicts_the_wiring_withdraws_at_once_what_was_proven(
    step: StepId, broken: InjectedFault
) -> None:
    """After all steps have passed, a part fails: the next pretension is rejected at once, not only after a restart."""
    rig = CommissionedRig()

    async def work() -> tuple[str, Any, Any]:
        await rig.loop.advance(0.01)
        ready = rig.rig.unready
        rig.rig.inject(broken)
        finding = await rig.do(step)
        await rig.loop.send(SwitchDrives(on=True))
        return ready, finding, await rig.loop.send(SetMode(Mode.PRETENSION))

    try:
        ready, finding, after = asyncio.run(work())
    finally:
        rig.loop.close()
    assert ready == ""
    assert not finding.passed
    assert isinstance(after, Refused)
    assert "directions are not proven" in after.reason
