"""Status of the steps, from stored results and the current wiring, and the results that are active."""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import NamedTuple

from backend.commissioning import messages
from backend.commissioning.procedure import StepFinding
from backend.commissioning.steps import ALTERNATIVES, STEP, STEPS, CommissioningStep, StepId
from backend.storage import Database, NewStepResult, StoredStepResult, commissioning
from plant import (
    NO_COMMISSIONING,
    CellCalibration,
    CommissioningResults,
    PlantChoice,
    PlantError,
    PlantKind,
    Wiring,
    load_wiring_choice,
    wiring_fingerprint,
)


class StepState(StrEnum):
    """State of a step."""

    NEVER = "never"
    CURRENT = "current"
    OUT_OF_DATE = "out_of_date"
    FAILED = "failed"


class StepStatus(NamedTuple):
    """State of a step with its reason; ``aged``: the result is only older than its validity."""

    state: StepState
    why: str
    aged: bool = False


class StoredResults(NamedTuple):
    """Newest result of each step, and the number of the newest failed wiring test; 0 for none."""

    results: Mapping[str, StoredStepResult]
    test_failed: int


def determine_step_status(
    step: CommissioningStep, result: StoredStepResult | None, fingerprint: str, loop_started: datetime
) -> StepStatus:
    """Return the status of a step.

    ``fingerprint`` is that of the current wiring, ``loop_started`` the start of the current control loop.
    """
    if result is None:
        return StepStatus(StepState.NEVER, messages.step_never_executed())
    if not result.passed:
        return StepStatus(StepState.FAILED, messages.last_execution_failed())
    if result.fingerprint != fingerprint:
        return StepStatus(StepState.OUT_OF_DATE, messages.wiring_changed_since())
    if step.id in ALTERNATIVES and result.at < loop_started:
        return StepStatus(StepState.OUT_OF_DATE, messages.encoders_lost_zero())
    if step.id is StepId.CALIBRATE and (other := _find_missing_cell(result)):
        return StepStatus(StepState.NEVER, messages.load_cell_not_calibrated(tendon=other))
    if datetime.now(UTC) - result.at > timedelta(days=step.holds_days):
        return StepStatus(StepState.OUT_OF_DATE, messages.validity_elapsed(days=step.holds_days), aged=True)
    return StepStatus(StepState.CURRENT, messages.valid_after_execution(days=step.holds_days))


def determine_statuses(
    stored: StoredResults, wiring: Wiring | None, loop_started: datetime
) -> dict[StepId, StepStatus]:
    """Return the status of all steps of a wiring; None for an unreadable wiring file.

    A wiring test that fails after the direction step makes that out of date. A table in the wiring file replaces tare
    and calibration. Homing exists only if the wiring file has the position of the end switch; homing and the zero by
    hand replace each other.
    """
    fingerprint = "" if wiring is None else wiring_fingerprint(wiring)
    found = {
        step.id: determine_step_status(step, stored.results.get(step.id), fingerprint, loop_started) for step in STEPS
    }
    if found[StepId.DIRECTION].state is StepState.CURRENT and _is_contradicted(stored):
        found[StepId.DIRECTION] = StepStatus(StepState.OUT_OF_DATE, messages.wiring_test_failed_since())
    if _has_tables(wiring) and found[StepId.CALIBRATE].state is StepState.NEVER:
        tables = StepStatus(StepState.CURRENT, messages.calibrated_by_tables())
        found |= {StepId.TARE: tables, StepId.CALIBRATE: tables}
    if wiring is None or math.isnan(wiring.end_switch.position):
        del found[StepId.HOME]
        return found
    return found | {
        step: StepStatus(StepState.CURRENT, messages.zero_set_by(step=STEP[other].title))
        for step, other in ALTERNATIVES.items()
        if found[step].state in _REPLACEABLE and found[other].state is StepState.CURRENT
    }


_REPLACEABLE = (StepState.NEVER, StepState.OUT_OF_DATE)


def _has_tables(wiring: Wiring | None) -> bool:
    return wiring is not None and bool(wiring.load_cell_A.table and wiring.load_cell_B.table)


def _is_contradicted(stored: StoredResults) -> bool:
    return stored.results[StepId.DIRECTION].id < stored.test_failed


def find_blocking_steps(step: CommissioningStep, states: Mapping[StepId, StepStatus]) -> str:
    """Return the steps that must come first, as text; empty if the step can start."""
    if step.id not in states:
        return messages.no_end_switch_position()
    missing = [_format_title(need, states) for need in _collect_needs(step) if not _is_satisfied(need, states[need])]
    return messages.other_steps_first(steps=", ".join(missing)) if missing else ""


def _is_satisfied(step: StepId, found: StepStatus) -> bool:
    return found.state is StepState.CURRENT or (found.aged and step in (StepId.TARE, StepId.CALIBRATE))


def _format_title(step: StepId, states: Mapping[StepId, StepStatus]) -> str:
    """Return the title of a step, with the step that can replace it."""
    other = ALTERNATIVES.get(step)
    if other in states and other:
        return messages.either_step(step=STEP[step].title, other=STEP[other].title)
    return STEP[step].title


def _collect_needs(step: CommissioningStep) -> list[StepId]:
    needed = set(step.needs).union(*(_collect_needs(STEP[need]) for need in step.needs)) - {ALTERNATIVES.get(step.id)}
    return [other.id for other in STEPS if other.id in needed]


def store_result(database: Database, step: StepId, wiring: Wiring, finding: StepFinding, who: str) -> StoredStepResult:
    """Store the result of a step; if it disproves the directions, also store a failed direction step."""
    if finding.disproves_directions:
        found = messages.finding_of_step(step=STEP[step].title, finding=finding.text)
        store_result(database, StepId.DIRECTION, wiring, StepFinding(False, found), who)
    new = NewStepResult(
        step=step,
        wiring=wiring.title,
        fingerprint=wiring_fingerprint(wiring),
        passed=finding.passed,
        text=finding.text,
        who=who,
        figures=[asdict(figure) for figure in finding.figures],
        calibrations=[
            {**asdict(found), "source": messages.calibrated_by(source=found.source, who=who)}
            for found in finding.calibrations
            if finding.passed
        ],
    )
    with database.session() as session:
        return commissioning.add(session, new)


def load_newest_results(database: Database) -> dict[str, StoredStepResult]:
    """Return the newest result of each step.

    For load cells calibrated one by one, the result has both calibrations and the older date.
    """
    with database.reading() as session:
        results = commissioning.newest(session)
        last = results.get(StepId.CALIBRATE)
        if last is not None and (other := _find_missing_cell(last)):
            for before in reversed(commissioning.passed_with(session, last.fingerprint)):
                of_other = [found for found in before.calibrations if found["tendon"] == other]
                if before.step == StepId.CALIBRATE and of_other:
                    both = [*of_other, *last.calibrations]
                    return results | {StepId.CALIBRATE: replace(last, at=before.at, calibrations=both)}
    return results


def _find_missing_cell(result: StoredStepResult) -> str:
    """Return the load cell without a calibration, "A" or "B"; empty if both have one."""
    cells = {found["tendon"] for found in result.calibrations}
    return "AB".replace(cells.pop(), "") if len(cells) == 1 else ""


def load_results(database: Database) -> StoredResults:
    """Return the stored results of all steps."""
    with database.reading() as session:
        test_failed = commissioning.last_failure(session, StepId.WIRING_TEST)
    return StoredResults(load_newest_results(database), test_failed)


def load_commissioning_results(database: Database, wiring: Wiring) -> CommissioningResults:
    """Return the active results for a wiring: calibrations, and whether directions and load cells are known.

    Directions are proven if the direction step is current and no later wiring test has failed. A load cell is measured
    after a tare and a calibration of any age, or by a table in the wiring file.
    """
    fingerprint = wiring_fingerprint(wiring)
    with database.reading() as session:
        passed = commissioning.passed_with(session, fingerprint)
    cells = {found["tendon"]: CellCalibration(**found) for result in passed for found in result.calibrations}
    by_step = {
        step: {found["tendon"] for result in passed if result.step == step for found in result.calibrations}
        for step in (StepId.TARE, StepId.CALIBRATE)
    }
    tables = {tendon for tendon, cell in (("A", wiring.load_cell_A), ("B", wiring.load_cell_B)) if cell.table}
    measured = {"A", "B"} <= tables | (by_step[StepId.TARE] & by_step[StepId.CALIBRATE])
    direction = determine_statuses(load_results(database), wiring, datetime.now(UTC))[StepId.DIRECTION].state
    return CommissioningResults(tuple(cells.values()), direction is StepState.CURRENT, measured, fingerprint)


def find_for_next_start(database: Database, plant: PlantChoice, known: CommissioningResults) -> CommissioningResults:
    """Return the commissioning results for the next control loop, which reads the wiring file again.

    ``known`` are the current results. They are returned if there is no rig, or if its wiring file has not changed.
    """
    if plant.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        return known
    try:
        wiring = load_wiring_choice(plant)
    except PlantError:
        return NO_COMMISSIONING  # the loop reports the error when it starts
    # an unchanged wiring needs no access to the database, so a start does not wait for it
    return known if wiring_fingerprint(wiring) == known.wired else load_commissioning_results(database, wiring)


def find_completed_commissioning(database: Database, plant: PlantChoice) -> CommissioningResults:
    """Return the active commissioning results for a plant. Raises PlantError."""
    if plant.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        return NO_COMMISSIONING
    return load_commissioning_results(database, load_wiring_choice(plant))
