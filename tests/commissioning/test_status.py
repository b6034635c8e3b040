"""Stored results of the commissioning: which are active, and when they are out of date."""

import asyncio
import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import plant
from backend.banks.builder import build_tuning_command
from backend.banks.tuning_settings import compute_default_tuning
from backend.commissioning import messages, status
from backend.commissioning.procedure import MeasuredNumber, StepFinding
from backend.commissioning.session import BlockedError, CommissioningSession, DriveLockout, OperatorDialog
from backend.commissioning.status import StepState, find_blocking_steps
from backend.commissioning.steps import STEP, STEPS, StepId
from backend.realtime.ipc import Setup
from backend.realtime.supervisor import Supervisor
from backend.storage.commissioning import StoredStepResult
from backend.storage.database import open_database
from plant.calibration import CellCalibration, CommissioningResults, apply_calibration, wiring_fingerprint
from plant.factory import make_plant
from plant.interface import PlantChoice, PlantKind
from plant.message import Message
from plant.messages import load_cells_not_measured
from plant.rig import Rig
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.commissioning.rigs import PARAMETERS, WIRING, with_entries
from tests.refusals import refused

PASSED = StepFinding(True, "well", (MeasuredNumber("joint", 0.1, "rad"), MeasuredNumber("nothing", None, "N")))
FAILED = StepFinding(False, "not well")


def steps_before(step: StepId, states: Mapping[StepId, status.StepStatus]) -> str:
    """The steps that must come first."""
    blocked = find_blocking_steps(STEP[step], states)
    assert isinstance(blocked, Message), blocked
    assert blocked.code == "other_steps_first"
    return str(blocked.values["steps"])


def test_results_take_effect_with_their_wiring_only(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    cell = CellCalibration("A", 10.7, 0.31, "calibrated")
    other = with_entries(motor_A={"gain": -1.0})
    assert status.load_commissioning_results(database, WIRING).calibrations == ()
    status.store_result(database, StepId.CALIBRATE, WIRING, StepFinding(True, "well", (), (cell,)), "Ada")
    status.store_result(database, StepId.DIRECTION, WIRING, PASSED, "Ada")
    found = status.load_commissioning_results(database, WIRING)
    assert found.directions_proven
    in_force = apply_calibration(WIRING, found.calibrations)
    assert (in_force.load_cell_A.slope, in_force.load_cell_A.offset) == (10.7, 0.31)
    assert in_force.sources["load_cell_A.slope"] == "calibrated by Ada"
    assert in_force.load_cell_B == WIRING.load_cell_B
    assert status.load_commissioning_results(database, other) == CommissioningResults(wired=wiring_fingerprint(other))
    status.store_result(database, StepId.WIRING_TEST, WIRING, FAILED, "Ada")
    assert not status.load_commissioning_results(database, WIRING).directions_proven
    # What was changed for it to pass again may have exchanged the motors.
    status.store_result(database, StepId.WIRING_TEST, WIRING, PASSED, "Ada")
    assert not status.load_commissioning_results(database, WIRING).directions_proven
    states = status.determine_statuses(status.load_results(database), WIRING, datetime.now(UTC))
    assert states[StepId.DIRECTION][:2] == (StepState.OUT_OF_DATE, messages.wiring_test_failed_since())
    status.store_result(database, StepId.DIRECTION, WIRING, PASSED, "Ada")
    assert status.load_commissioning_results(database, WIRING).directions_proven
    database.close()


def test_a_step_that_disproves_the_directions_stores_their_failure(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    status.store_result(database, StepId.DIRECTION, WIRING, PASSED, "Ada")
    status.store_result(database, StepId.HOME, WIRING, FAILED, "Bo")
    assert status.load_commissioning_results(database, WIRING).directions_proven
    status.store_result(database, StepId.HOME, WIRING, replace(FAILED, disproves_directions=True), "Bo")
    assert not status.load_commissioning_results(database, WIRING).directions_proven
    told = status.load_newest_results(database)[StepId.DIRECTION]
    assert (told.passed, told.text, told.who) == (
        False,
        messages.finding_of_step(step="Homing", finding=FAILED.text),
        "Bo",
    )
    database.close()


def test_a_step_is_out_of_date_by_age_by_wiring_and_after_a_restart(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    begun = datetime.now(UTC) - timedelta(seconds=1)
    wired, other = wiring_fingerprint(WIRING), wiring_fingerprint(with_entries(encoder_q={"direction": -1.0}))
    zero = status.store_result(database, StepId.ZERO, WIRING, PASSED, "Ada")
    step = STEP[StepId.ZERO]
    assert status.load_newest_results(database)[StepId.ZERO] == zero
    assert zero.figures[1] == {"words": "nothing", "value": None, "unit": "N"}
    database.close()

    def state(stored: StoredStepResult | None = zero, wiring: str = wired, started: datetime = begun) -> StepState:
        return status.determine_step_status(step, stored, wiring, started).state

    assert state() is StepState.CURRENT
    assert state(None) is StepState.NEVER
    assert state(replace(zero, passed=False)) is StepState.FAILED
    assert state(wiring=other) is StepState.OUT_OF_DATE
    assert state(started=datetime.now(UTC)) is StepState.OUT_OF_DATE
    old = zero.at - timedelta(days=step.holds_days)
    assert state(replace(zero, at=old), started=old - timedelta(days=1)) is StepState.OUT_OF_DATE


def test_homing_and_the_manual_zero_replace_each_other(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    homed = with_entries(end_switch={"position": 0.4})
    before = [StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.ZERO, StepId.DIRECTION]
    for step in before:
        status.store_result(database, step, homed, PASSED, "Ada")
    begun = datetime.now(UTC)

    def states() -> dict[StepId, status.StepStatus]:
        return status.determine_statuses(status.load_results(database), homed, begun)

    # The loop has been started since: homing needs no zero, pretension does.
    assert (states()[StepId.ZERO].state, states()[StepId.HOME].state) == (StepState.OUT_OF_DATE, StepState.NEVER)
    assert find_blocking_steps(STEP[StepId.HOME], states()) == ""
    assert messages.either_step(step="Zero", other="Homing") in steps_before(StepId.PRETENSION, states())
    status.store_result(database, StepId.HOME, homed, FAILED, "Ada")
    assert states()[StepId.HOME].state is StepState.FAILED
    assert messages.either_step(step="Zero", other="Homing") in steps_before(StepId.PRETENSION, states())
    status.store_result(database, StepId.HOME, homed, PASSED, "Ada")
    assert (states()[StepId.ZERO].state, states()[StepId.HOME].state) == (StepState.CURRENT, StepState.CURRENT)
    assert find_blocking_steps(STEP[StepId.PRETENSION], states()) == ""
    without = status.determine_statuses(status.load_results(database), WIRING, begun)
    assert StepId.HOME not in without
    missing = find_blocking_steps(STEP[StepId.HOME], without)
    assert isinstance(missing, Message)
    assert missing.code == "no_end_switch_position"
    database.close()


def test_calibration_is_complete_when_both_load_cells_are_calibrated(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    cells = {tendon: CellCalibration(tendon, 10.0, 0.0, "calibrated") for tendon in "AB"}
    begun, wired, step = datetime.now(UTC), wiring_fingerprint(WIRING), STEP[StepId.CALIBRATE]

    def calibrated_one(tendon: str) -> tuple[StoredStepResult, StepState, str]:
        kept = status.store_result(database, step.id, WIRING, StepFinding(True, "well", (), (cells[tendon],)), "Ada")
        newest = status.load_newest_results(database)[step.id]
        return kept, *status.determine_step_status(step, newest, wired, begun)[:2]

    first, state, why = calibrated_one("A")
    assert state is StepState.NEVER
    assert why == messages.load_cell_not_calibrated(tendon="B")
    assert calibrated_one("A")[1] is StepState.NEVER
    second, state, _ = calibrated_one("B")
    assert state is StepState.CURRENT
    newest = status.load_newest_results(database)[step.id]
    assert {found["tendon"] for found in newest.calibrations} == {"A", "B"}
    assert first.at < newest.at < second.at  # of the older of the two
    database.close()


@pytest.mark.parametrize("step", [step.id for step in STEPS if step.needs])
def test_a_step_waits_for_its_preceding_steps(step: StepId) -> None:
    never = dict.fromkeys(StepId, status.StepStatus(StepState.NEVER, ""))
    done = dict.fromkeys(StepId, status.StepStatus(StepState.CURRENT, ""))
    assert all(STEP[need].title in steps_before(step, never) for need in STEP[step].needs)
    assert find_blocking_steps(STEP[step], done) == ""
    untested = done | {StepId.WIRING_TEST: status.StepStatus(StepState.FAILED, "")}
    assert steps_before(step, untested) == "Wiring test"


CELLS = tuple(CellCalibration(tendon, 10.7, 0.31, "measured") for tendon in "AB")
MEASURED = StepFinding(True, "well", (), CELLS)
TABLE = ((-1.0, -10.0), (9.0, 90.0))


def test_pretension_requires_both_load_cells_tared_and_calibrated(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    begun = datetime.now(UTC)

    def standings() -> dict[StepId, status.StepStatus]:
        return status.determine_statuses(status.load_results(database), WIRING, begun)

    for step in (StepId.WIRING_TEST, StepId.ZERO, StepId.DIRECTION):
        status.store_result(database, step, WIRING, PASSED, "Ada")
    assert steps_before(StepId.PRETENSION, standings()) == "Tare, Calibration"
    status.store_result(database, StepId.TARE, WIRING, MEASURED, "Ada")
    status.store_result(database, StepId.CALIBRATE, WIRING, StepFinding(True, "well", (), CELLS[:1]), "Ada")
    assert steps_before(StepId.PRETENSION, standings()) == "Calibration"
    assert not status.load_commissioning_results(database, WIRING).load_cells_measured
    status.store_result(database, StepId.CALIBRATE, WIRING, StepFinding(True, "well", (), CELLS[1:]), "Ada")
    assert find_blocking_steps(STEP[StepId.PRETENSION], standings()) == ""
    assert status.load_commissioning_results(database, WIRING).load_cells_measured
    assert not status.load_commissioning_results(database, with_entries(motor_A={"gain": -1.0})).load_cells_measured
    # Older than it should be: the values in force are still those that were measured.
    old = dict(status.load_results(database).results)
    old[StepId.TARE] = replace(old[StepId.TARE], at=begun - timedelta(days=3))
    aged = status.determine_statuses(status.StoredResults(old, 0), WIRING, begun)
    assert aged[StepId.TARE].state is StepState.OUT_OF_DATE
    assert find_blocking_steps(STEP[StepId.PRETENSION], aged) == ""
    status.store_result(database, StepId.TARE, WIRING, FAILED, "Ada")
    assert steps_before(StepId.PRETENSION, standings()) == "Tare"
    database.close()


def test_tables_in_the_wiring_file_count_as_calibration_and_tare(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    table = {"slope": math.nan, "offset": math.nan, "table": TABLE}
    wiring = with_entries(load_cell_A=table, load_cell_B=table)
    for step in (StepId.WIRING_TEST, StepId.ZERO, StepId.DIRECTION):
        status.store_result(database, step, wiring, PASSED, "Ada")
    states = status.determine_statuses(status.load_results(database), wiring, datetime.now(UTC) - timedelta(seconds=1))
    assert find_blocking_steps(STEP[StepId.PRETENSION], states) == ""
    assert status.load_commissioning_results(database, wiring).load_cells_measured
    of_one = with_entries(load_cell_A=table)
    assert not status.load_commissioning_results(database, of_one).load_cells_measured
    database.close()


@pytest.mark.parametrize("measured", [False, True])
def test_pretension_of_a_rig_requires_calibrated_load_cells(measured: bool) -> None:
    """The shipped slopes are placeholders. A virtual card with matching wiring may be driven without calibration."""
    other = with_entries(motor_A={"gain": -1.0})
    simulator = Simulator(PARAMETERS, 0)
    rig = VirtualRig(WIRING, simulator, None, other, directions_proven=True, load_cells_measured=measured)
    rig.open()
    rig.read()
    rig.zero(0.0, 0.0, 0.0)
    assert (rig.unready == load_cells_not_measured()) is not measured
    assert (rig.unready == "") is measured
    rig.close()
    assert VirtualRig(WIRING, Simulator(PARAMETERS, 0)).unready == ""


def test_a_rig_uses_the_results_of_the_wiring_file_that_it_has_read(tmp_path: Path) -> None:
    """The wiring file changes between the check of the directions and the start of the loop."""
    file, choice = tmp_path / "rig.toml", PlantChoice(PlantKind.RIG, str(tmp_path / "rig.toml"))
    said = (Path(plant.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")
    file.write_text(said, encoding="utf-8")
    cells = tuple(CellCalibration(tendon, 10.7, 0.31, "calibrated") for tendon in "AB")
    known = CommissioningResults(cells, True, True, wiring_fingerprint(load_wiring(str(file))))

    def made() -> Rig:
        rig = make_plant(choice, PARAMETERS, 0, None, known)
        assert isinstance(rig, Rig)
        return rig

    assert (made().unproven, made().wired, made().wiring.load_cell_A.slope) == ("", known.wired, 10.7)
    file.write_text(said.replace("gain = { value = 1.0", "gain = { value = -1.0", 1), encoding="utf-8")
    assert made().unproven == load_cells_not_measured()
    assert made().wired == wiring_fingerprint(load_wiring(str(file))) != known.wired
    assert made().wiring.load_cell_A.slope == 10.0


def test_a_zero_is_valid_for_one_day(tmp_path: Path) -> None:
    database, begun = open_database(tmp_path), datetime.now(UTC)
    zero = status.store_result(database, StepId.ZERO, WIRING, PASSED, "Ada")
    wired = wiring_fingerprint(WIRING)
    assert status.determine_step_status(STEP[StepId.ZERO], zero, wired, begun).why == (
        messages.valid_after_execution(days=1)
    )
    database.close()


def test_commands_reject_a_changed_wiring_file(tmp_path: Path) -> None:
    database, file = open_database(tmp_path), tmp_path / "rig.toml"
    said = (Path(plant.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")
    file.write_text(said, encoding="utf-8")
    tuning = build_tuning_command(PARAMETERS, compute_default_tuning(PARAMETERS).tuning, None)
    known = status.load_commissioning_results(database, load_wiring(str(file)))
    supervisor = Supervisor(Setup(PlantChoice(PlantKind.VIRTUAL_CARD, str(file)), PARAMETERS.name, 0, tuning, known))
    person = OperatorDialog("Ada", lambda _words: asyncio.sleep(0.0), lambda _phase: None)
    hands = DriveLockout(database, supervisor.setup.plant)
    at_rig = CommissioningSession(database, supervisor, PARAMETERS, person, load_wiring(str(file)), hands)
    at_rig.require_startable(StepId.WIRING_TEST)
    file.write_text(said.replace("gain = { value = 1.0", "gain = { value = -1.0", 1), encoding="utf-8")
    with refused(BlockedError, "wiring_file_changed"):
        at_rig.require_startable(StepId.WIRING_TEST)
    database.close()
