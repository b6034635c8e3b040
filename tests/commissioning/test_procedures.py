"""Steps of the commissioning on a virtual card: passes, rejections and findings."""

import asyncio
import math
from typing import Any

import numpy as np
import pytest

from backend.commissioning import messages
from backend.commissioning.procedure import Rows, StepFinding
from backend.commissioning.procedures import (
    DRIVEN_MIN_V,
    TURNED_BACK_MIN_RAD,
    compute_peaks,
    find_uncut_drive,
    has_tension_fallen,
    is_near_pretension,
)
from backend.commissioning.session import collect_values
from backend.commissioning.steps import STEPS, WEIGHT_MAX_N, StepId
from backend.control.motion_primitives import PRETENSION_N
from backend.errors import OutOfRangeError
from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import (
    Accepted,
    Inject,
    Refused,
    SetMode,
    SimulateManualInput,
    Stop,
    SwitchDrives,
    TryModule,
)
from backend.realtime.messages import safety_module_requires_pretension
from backend.realtime.modes import MODE_CODE, HomingEnd, Mode
from backend.sample import INDEX
from plant.interface import InjectedFault, InjectedFaultKind, MotorCommand, Sensor
from plant.manual_input import ManualInput
from plant.message import Message
from plant.messages import directions_not_proven
from tests.commissioning.rigs import WIRING, CommissionedRig, played, with_entries

# Every step on a virtual card: correct wiring passes, and the responsible step finds each error.


def test_a_rig_with_correct_wiring_passes_every_step() -> None:
    wiring = with_entries(end_switch={"position": 0.4})
    findings = dict(zip(StepId, played(CommissionedRig(wiring, wiring), *(step.id for step in STEPS)), strict=True))
    assert [finding.text for finding in findings.values() if not finding.passed] == []
    # The pretension of 10 N, as the load cells' own figures say it.
    tensions = {figure.words: figure.value for figure in findings[StepId.PRETENSION].figures}
    for tendon in "AB":
        assert tensions[messages.tension_of_tendon(tendon=tendon)] == pytest.approx(10.0, abs=0.3)


def why(finding: StepFinding) -> Message:
    """The message of a step that has failed."""
    assert not finding.passed
    assert isinstance(finding.text, Message), finding.text
    return finding.text


def problems(finding: StepFinding) -> list[Message]:
    message = why(finding)
    assert message.code == "several_problems", message
    found = message.values["problems"]
    assert isinstance(found, tuple)
    return list(found)


WRONG_BY_HAND: dict[str, tuple[dict[str, dict[str, Any]], str, set[tuple[str, ...]]]] = {
    "signs": (
        {"encoder_q": {"direction": -1.0}, "encoder_B": {"direction": -1.0}, "load_cell_A": {"slope": -10.0}},
        "wrong_sign_of_sensor",
        {("encoder_q.direction",), ("encoder_B.direction",), ("load_cell_A.slope",)},
    ),
    "swapped": (
        {
            "load_cell_A": {"channel": "ai1"},
            "load_cell_B": {"channel": "ai0"},
            "encoder_A": {"counter": "ctr2"},
            "encoder_B": {"counter": "ctr1"},
        },
        "other_sensor_moved",
        {("load_cell_A.channel", "load_cell_B.channel"), ("encoder_A.counter", "encoder_B.counter")},
    ),
}
"""Independent errors, so that one test of 20 s finds all of them."""


@pytest.mark.parametrize("case", WRONG_BY_HAND)
def test_the_wiring_test_reports_exactly_the_wiring_errors(case: str) -> None:
    entries, code, named = WRONG_BY_HAND[case]
    (finding,) = played(CommissionedRig(with_entries(WIRING, **entries)), StepId.WIRING_TEST)
    found = problems(finding)
    assert {problem.code for problem in found} == {code}, finding.text
    assert {
        tuple(sorted(str(value) for name, value in problem.values.items() if name in ("entry", "other_entry")))
        for problem in found
    } == named, finding.text


SENSORS = {"encoder_q": "counter", "encoder_A": "counter", "encoder_B": "counter"} | dict.fromkeys(
    ("load_cell_A", "load_cell_B"), "channel"
)


@pytest.mark.parametrize("dead", [("encoder_q", "load_cell_A"), ("encoder_A", "load_cell_B"), ("encoder_B",)])
def test_the_wiring_test_finds_dead_sensors(dead: tuple[str, ...]) -> None:
    """The sensors are not connected although the wiring file contains them."""
    nowhere = {section: {SENSORS[section]: "ctr3" if SENSORS[section] == "counter" else "ai7"} for section in dead}
    (finding,) = played(CommissionedRig(WIRING, with_entries(WIRING, **nowhere)), StepId.WIRING_TEST)
    entries = {problem.values["entry"] for problem in problems(finding) if problem.code == "sensor_did_not_move"}
    assert entries == {f"{section}.{SENSORS[section]}" for section in dead}, finding.text


NOT_TURNED = ("motor_did_not_turn", {"motor": "B"})
WRONG_WITH_VOLTAGE = [
    ("motor sign A", {"motor_A": {"gain": -1.0}}, [("wrong_sign_of_motor", {"motor": "A"})]),
    ("motor sign B", {"motor_B": {"gain": -1.0}}, [("wrong_sign_of_motor", {"motor": "B"})]),
    (
        "swapped motors",
        {"motor_A": {"channel": "ao1"}, "motor_B": {"channel": "ao0"}},
        [("motors_exchanged", {"driven": "A", "turned": "B"})],
    ),
    ("encoder sign", {"encoder_A": {"direction": -1.0}}, [("wrong_sign_of_motor_encoder", {"motor": "A"})]),
    (
        "both signs of one motor",
        {"motor_A": {"gain": -1.0}, "encoder_A": {"direction": -1.0}},
        [("wrong_sign_of_motor", {"motor": "A"}), ("wrong_sign_of_motor_encoder", {"motor": "A"})],
    ),
    ("dead motor", {"motor_B": {"channel": "ao3"}}, [NOT_TURNED]),
]


@pytest.mark.parametrize(
    ("entries", "named"), [case[1:] for case in WRONG_WITH_VOLTAGE], ids=[case[0] for case in WRONG_WITH_VOLTAGE]
)
def test_the_direction_step_reports_errors_before_any_loop_is_closed(
    entries: dict[str, dict[str, Any]], named: list[tuple[str, dict[str, str]]]
) -> None:
    rig = CommissionedRig(with_entries(WIRING, **entries))
    played_steps = played_and_refused(rig)
    zero, direction, before, after = played_steps
    assert zero.passed
    assert "zero" in before.reason
    found = [(problem.code, problem.values) for problem in problems(direction)]
    assert all(problem in found for problem in named), direction.text
    assert "direction" in after.reason
    # The joint's encoder is wired rightly in all of these.
    assert rig.joint_moved > 0.0 or named == [NOT_TURNED]
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
def test_more_than_two_weights_check_the_linearity_of_a_load_cell(true: dict[str, Any], passed: bool) -> None:
    rig = CommissionedRig(WIRING, with_entries(load_cell_B=true))
    finding = asyncio.run(rig.do(StepId.CALIBRATE, "B", weight_1_N=5.0, weight_2_N=25.0, weight_3_N=15.0))
    rig.loop.close()
    assert finding.passed is passed, finding.text
    hung = [messages.hang_weight(weight_N=F, tendon="B") for F in (5.0, 15.0, 25.0)]
    assert [words for words in rig.asked if getattr(words, "code", "") == "hang_weight"] == hung
    if passed:
        (cell,) = finding.calibrations
        assert cell.tendon == "B"
        assert (cell.slope, cell.offset) == pytest.approx((9.4, -0.22), rel=2e-3)
    else:
        assert why(finding).code == "load_cell_not_linear"
        assert why(finding).values["tendon"] == "B"


def test_a_tare_stores_the_volts_without_load() -> None:
    true = with_entries(load_cell_A={"offset": 0.31}, load_cell_B={"offset": -0.22})
    rig = CommissionedRig(WIRING, true)
    (finding,) = played(rig, StepId.TARE)
    assert finding.passed, finding.text
    # 1 s of noise of 5 mV leaves 0.2 mV.
    assert [found.offset for found in finding.calibrations] == pytest.approx([0.31, -0.22], abs=1e-3)
    noise = {figure.words: figure.value for figure in finding.figures}[messages.noise_of_load_cell(tendon="A")]
    assert noise == pytest.approx(0.05, rel=0.2)


def test_homing_reports_its_findings_and_withdraws_contradicted_directions() -> None:
    wiring = with_entries(end_switch={"position": 0.4})
    rig = CommissionedRig(wiring, with_entries(end_switch={"position": 0.4}, motor_A={"gain": -1.0}))
    rig.rig.prove_directions(proven=True)
    (finding,) = played(rig, StepId.HOME)
    assert (why(finding).code, why(finding).values["cause"]) == ("not_homed", HomingEnd.MOTOR_OFF)
    assert directions_not_proven() in rig.rig.unproven


def test_homing_uses_the_configured_position_of_the_end_switch() -> None:
    wiring = with_entries(end_switch={"position": 0.9})
    rig = CommissionedRig(wiring, wiring)
    (finding,) = played(rig, StepId.ZERO)
    assert finding.passed, finding.text
    assert finding.figures[0].value == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("step", "broken"),
    [
        (StepId.WIRING_TEST, InjectedFault(InjectedFaultKind.SWAPPED_LOAD_CELLS)),
        (
            StepId.DIRECTION,
            InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.F_B),
        ),  # it fails before a motor can be tested
    ],
)
def test_a_step_that_contradicts_the_wiring_withdraws_the_proof_at_once(step: StepId, broken: InjectedFault) -> None:
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
    assert directions_not_proven() in after.reason


# Pretension and trip of the safety module: invalid readings and other stops do not pass.

NAN = math.nan


@pytest.mark.parametrize("F", [(NAN, 10.0), (10.0, NAN), (NAN, NAN)])
def test_nan_readings_fail_the_checks_of_pretension_release_and_bounds(F: tuple[float, float]) -> None:
    held = np.array([10.0, 10.0])
    assert is_near_pretension(held)
    assert not is_near_pretension(np.array(F))
    assert has_tension_fallen(held, np.array([2.0, 2.0]))
    assert not has_tension_fallen(held, np.array(F) - 8.0)
    assert (
        find_uncut_drive(
            2.0 * np.array([DRIVEN_MIN_V, DRIVEN_MIN_V]), -2.0 * np.array([TURNED_BACK_MIN_RAD, TURNED_BACK_MIN_RAD])
        )
        is None
    )
    motors = [motor for motor, force in zip("AB", F, strict=True) if math.isnan(force)]
    without_volts, not_turned = find_uncut_drive(np.array(F), held - 20.0), find_uncut_drive(held, np.array(F) - 20.0)
    assert without_volts is not None
    assert (without_volts.code, without_volts.values["motor"]) == ("voltage_too_low", motors[0])
    assert not_turned is not None
    assert (not_turned.code, not_turned.values["motor"]) == ("drive_not_disabled", motors[0])
    highest, apart = compute_peaks(np.array([held, F]))
    assert math.isnan(highest)
    assert math.isnan(apart)


def test_a_load_cell_lost_at_the_trip_does_not_prove_the_release() -> None:
    rig = CommissionedRig()

    def lose(phase: str) -> None:
        if phase == messages.waiting_for_trip():
            rig.rig.inject(InjectedFault(InjectedFaultKind.SATURATION, Sensor.F_B))

    async def mend(words: str) -> None:
        if words == messages.restore_limit_of_module():
            rig.rig.inject(None)

    rig.in_phase, rig.meanwhile = lose, mend
    (finding,) = played(rig, StepId.SAFETY_MODULE)
    assert not finding.passed, finding.text


def test_a_loop_that_stopped_for_another_reason_is_not_reset() -> None:
    """A person presses STOP while the step waits for the safety module."""
    rig = CommissionedRig()

    async def press(words: str) -> None:
        if words == messages.lower_limit_of_module(pretension_N=PRETENSION_N):
            await rig.loop.send(Stop(Fault.STOP_PRESSED))

    rig.meanwhile = press

    async def work() -> tuple[StepFinding, Mode]:
        finding = await rig.do(StepId.SAFETY_MODULE)
        await rig.loop.advance(0.01)
        return finding, rig.mode

    try:
        finding, mode = asyncio.run(work())
    finally:
        rig.loop.close()
    assert why(finding).code == "stopped_without_module"
    assert mode is Mode.TRIPPED
    assert messages.restore_limit_of_module() not in rig.asked


@pytest.mark.parametrize(("cuts", "motor"), [((False, False), "A"), ((True, False), "B")])
def test_a_safety_module_that_signals_without_disabling_is_detected(cuts: tuple[bool, bool], motor: str) -> None:
    """Zero volts from the loop release the motors too, so only the time before that counts."""
    rig = CommissionedRig()
    rig.simulator.module_cuts = cuts
    tripped_at: list[float] = []
    write = rig.rig.write

    def watched(command: MotorCommand) -> None:
        write(command)
        newest = rig.loop.ring.newest()
        if rig.rig.card_state().safety_tripped and not tripped_at and newest is not None:
            tripped_at.append(newest[INDEX["tick"]] + 1)

    rig.rig.write = watched  # type: ignore[method-assign]  # when it trips is in no sample

    async def work() -> tuple[StepFinding, Rows]:
        first = rig.loop.ring.count
        finding = await rig.do(StepId.SAFETY_MODULE)
        await rig.loop.advance(0.01)
        return finding, rig.loop.ring.read(first, rig.loop.ring.capacity)[1]

    try:
        finding, rows = asyncio.run(work())
        assert rig.mode is Mode.TRIPPED
    finally:
        rig.loop.close()
    reason = why(finding).values["reason"]
    assert isinstance(reason, Message)
    assert (reason.code, reason.values["motor"]) == ("drive_not_disabled", motor)
    # It was driven for 0.3 s after the trip and not longer, with little voltage.
    stopped = int(np.argmax(rows[:, INDEX["mode"]] == MODE_CODE[Mode.TRIPPED]))
    assert rows[stopped, INDEX["tick"]] - tripped_at[0] == pytest.approx(300, abs=2)
    volts = rows[:, [INDEX["u_A"], INDEX["u_B"]]]
    assert np.abs(volts[stopped - 300 : stopped]).max() <= 1.0
    assert not volts[stopped:].any()
    assert rows[:, [INDEX["F_A"], INDEX["F_B"]]].max() < 13.0


def test_the_other_checks_are_armed_while_the_loop_continues_to_command() -> None:
    rig = CommissionedRig()

    async def work() -> tuple[Refused, float, float]:
        await rig.loop.advance(0.01)
        early = await rig.loop.send(TryModule())
        assert isinstance(early, Refused)
        await rig.loop.send(SetMode(Mode.PRETENSION))
        await rig.loop.advance(12.0)
        assert isinstance(await rig.loop.send(TryModule()), Accepted)
        await rig.loop.send(SimulateManualInput(ManualInput(F_limit=5.0)))
        await rig.loop.advance(0.1)
        assert rig.mode is Mode.PRETENSION
        assert rig.rig.card_state().safety_tripped
        assert rig.rig.card_state().u_A > 0.0
        rig.rig.inject(InjectedFault(InjectedFaultKind.JUMP, Sensor.Q))
        await rig.loop.advance(0.002)
        newest = rig.loop.ring.newest()
        assert newest is not None
        return early, newest[INDEX["fault"]], newest[INDEX["u_A"]]

    try:
        early, fault, u_A = asyncio.run(work())
    finally:
        rig.loop.close()
    assert early.reason == safety_module_requires_pretension()
    assert fault == FAULT_CODE[Fault.SENSOR_JUMP]
    assert u_A == 0.0


# Rejections of tare and calibration, with quantity, value, bound with unit, and remedy.

REFUSED: dict[str, tuple[dict[str, dict[str, Any]], str, dict[str, object]]] = {
    "wrong sign": (
        {"load_cell_A": {"slope": -9.4}},
        "wrong_sign_of_load_cell",
        {"tendon": "A", "slope": pytest.approx(-9.4, abs=0.1), "wiring_slope": 10.0},
    ),
    "saturated": (
        {"load_cell_B": {"slope": 1.5}},
        "load_cell_saturated",
        {"tendon": "B", "voltage": pytest.approx(10.0, abs=0.005), "maximum_V": pytest.approx(9.99, abs=0.005)},
    ),
    "dead": (
        {"load_cell_A": {"channel": "ai7"}},
        "weights_not_distinguished",
        {"tendon": "A", "difference_V": pytest.approx(0.0, abs=5e-6), "lightest_N": 5.0, "heaviest_N": 25.0},
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_invalid_calibration_is_rejected_with_its_values(case: str) -> None:
    true, code, values = REFUSED[case]
    rig = CommissionedRig(WIRING, with_entries(WIRING, **true))
    (finding,) = played(rig, StepId.CALIBRATE, weight_1_N=5.0, weight_2_N=25.0)
    assert not finding.calibrations
    assert (why(finding).code, why(finding).values) == (code, values), finding.text


@pytest.mark.parametrize("step", [StepId.TARE, StepId.CALIBRATE])
def test_a_nan_reading_is_not_accepted_as_a_load(step: StepId) -> None:
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
    assert (why(finding).code, why(finding).values) == ("invalid_load_cell", {"tendon": "A"})


@pytest.mark.parametrize(
    ("given", "label", "value", "bounds"),
    [
        ({"weight_1_N": 5.0, "weight_2_N": 9.0}, messages.heavier_weight(), 9.0, (10.0, None)),
        ({"weight_1_N": 25.0, "weight_2_N": 5.0}, messages.heavier_weight(), 5.0, (30.0, None)),
        ({"weight_2_N": WEIGHT_MAX_N + 1.0}, messages.heavier_weight(), WEIGHT_MAX_N + 1.0, (0.0, WEIGHT_MAX_N)),
        ({"weight_1_N": -1.0}, messages.lighter_weight(), -1.0, (0.0, WEIGHT_MAX_N)),
        ({"weight_2_N": NAN}, messages.heavier_weight(), NAN, (0.0, WEIGHT_MAX_N)),
    ],
)
def test_unsuitable_weights_are_rejected_before_they_are_hung(
    given: dict[str, float], label: str, value: float, bounds: tuple[float, float | None]
) -> None:
    with pytest.raises(OutOfRangeError) as caught:
        collect_values(StepId.CALIBRATE, given)
    error = caught.value
    assert (error.label, error.unit) == (label, "N")
    assert error.value == pytest.approx(value, nan_ok=True)
    assert (error.minimum, error.maximum) == bounds
    if bounds[1] is None:
        assert isinstance(error.remedy, Message)
        assert (error.remedy.code, error.remedy.values) == ("weights_too_close", {"minimum_N": 5.0})
