"""Status of the steps: their stored results against the wiring of today, and what takes effect of them."""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import NamedTuple

from backend.commissioning.procedure import StepFinding
from backend.commissioning.steps import ALTERNATIVES, STEP, STEPS, CommissioningStep, StepId
from backend.storage import Database, NewStepResult, StoredStepResult, commissioning
from backend.units import counted
from plant import (
    NOT_BROUGHT_UP,
    BroughtUp,
    CellCalibration,
    PlantChoice,
    PlantError,
    PlantKind,
    Wiring,
    load_wiring_choice,
    wiring_fingerprint,
)


class StepState(StrEnum):
    """How a step stands."""

    NEVER = "never"
    CURRENT = "current"
    OUT_OF_DATE = "out_of_date"
    FAILED = "failed"


class StepStatus(NamedTuple):
    """A state, and how it comes about; ``aged``: what it found holds as ever, it is only older than it should be."""

    state: StepState
    why: str
    aged: bool = False


class Kept(NamedTuple):
    """The newest result of each step, and the number of the newest wiring test that failed; 0 for none."""

    results: Mapping[str, StoredStepResult]
    test_failed: int


def standing(
    step: CommissioningStep, result: StoredStepResult | None, wired: str, loop_started: datetime
) -> StepStatus:
    """Tell how a step stands with the wiring ``wired`` (its fingerprint) under a loop started at ``loop_started``."""
    if result is None:
        return StepStatus(StepState.NEVER, "it has never been done")
    if not result.passed:
        return StepStatus(StepState.FAILED, "it was done last without success")
    if result.fingerprint != wired:
        return StepStatus(StepState.OUT_OF_DATE, "the wiring file has changed since")
    if step.id in ALTERNATIVES and result.at < loop_started:
        return StepStatus(StepState.OUT_OF_DATE, "the loop has been started since: the encoders have lost their zero")
    if step.id is StepId.CALIBRATE and (other := _missing_cell(result)):
        return StepStatus(StepState.NEVER, f"load cell {other} has not been calibrated with this wiring")
    days = counted(step.holds_days, "day")
    if datetime.now(UTC) - result.at > timedelta(days=step.holds_days):
        return StepStatus(StepState.OUT_OF_DATE, f"it holds good for {days}", aged=True)
    return StepStatus(StepState.CURRENT, f"it holds good for {days} from when it was done")


def states(kept: Kept, wiring: Wiring | None, loop_started: datetime) -> dict[StepId, StepStatus]:
    """Tell how all steps stand that a wiring has, None for one that cannot be read.

    Directions that were proven before a wiring test failed have to be proven anew. A table of the wiring file is a
    calibration, and has its zero in itself. There is no homing without a position of the end switch, and where there
    is, it does for the zero by hand, and that for it.
    """
    wired = "" if wiring is None else wiring_fingerprint(wiring)
    found = {step.id: standing(step, kept.results.get(step.id), wired, loop_started) for step in STEPS}
    if found[StepId.DIRECTION].state is StepState.CURRENT and _contradicted(kept):
        found[StepId.DIRECTION] = StepStatus(StepState.OUT_OF_DATE, "a wiring test has failed since")
    if _by_tables(wiring) and found[StepId.CALIBRATE].state is StepState.NEVER:
        tables = StepStatus(StepState.CURRENT, "both load cells are calibrated by tables of the wiring file")
        found |= {StepId.TARE: tables, StepId.CALIBRATE: tables}
    if wiring is None or math.isnan(wiring.end_switch.position):
        del found[StepId.HOME]
        return found
    return found | {
        step: StepStatus(StepState.CURRENT, f"{STEP[other].title} has set it")
        for step, other in ALTERNATIVES.items()
        if found[step].state in _NOT_DONE and found[other].state is StepState.CURRENT
    }


_NOT_DONE = (StepState.NEVER, StepState.OUT_OF_DATE)


def _by_tables(wiring: Wiring | None) -> bool:
    return wiring is not None and bool(wiring.load_cell_A.table and wiring.load_cell_B.table)


def _contradicted(kept: Kept) -> bool:
    return kept.results[StepId.DIRECTION].id < kept.test_failed


def find_blocking_steps(step: CommissioningStep, states: Mapping[StepId, StepStatus]) -> str:
    """Return what has to come before a step, and before that; empty where nothing has."""
    if step.id not in states:
        return "the wiring file says no end_switch.position: where the switch holds the joint has to be known"
    missing = [_titled(need, states) for need in _all_needs(step) if not _stands(need, states[need])]
    return f"first: {', '.join(missing)}" if missing else ""


def _stands(step: StepId, found: StepStatus) -> bool:
    return found.state is StepState.CURRENT or (found.aged and step in (StepId.TARE, StepId.CALIBRATE))


def _titled(step: StepId, states: Mapping[StepId, StepStatus]) -> str:
    """Return what a step is called, and what does for it where there is such a one."""
    other = ALTERNATIVES.get(step)
    return f"{STEP[step].title} or {STEP[other].title}" if other in states and other else STEP[step].title


def _all_needs(step: CommissioningStep) -> list[StepId]:
    needed = set(step.needs).union(*(_all_needs(STEP[need]) for need in step.needs)) - {ALTERNATIVES.get(step.id)}
    return [other.id for other in STEPS if other.id in needed]


def keep(database: Database, step: StepId, wiring: Wiring, finding: StepFinding, who: str) -> StoredStepResult:
    """Store what a step came to; what disproves the directions stands as a failure of theirs too."""
    if finding.disproves_directions:
        keep(database, StepId.DIRECTION, wiring, StepFinding(False, f"{STEP[step].title}: {finding.text}"), who)
    new = NewStepResult(
        step=step,
        wiring=wiring.title,
        fingerprint=wiring_fingerprint(wiring),
        passed=finding.passed,
        text=finding.text,
        who=who,
        figures=[asdict(figure) for figure in finding.figures],
        calibrations=[
            {**asdict(found), "source": f"{found.source} by {who}"} for found in finding.calibrations if finding.passed
        ],
    )
    with database.session() as session:
        return commissioning.add(session, new)


def newest(database: Database) -> dict[str, StoredStepResult]:
    """Return the newest result of each step; of load cells calibrated one by one both, and the older date."""
    with database.reading() as session:
        results = commissioning.newest(session)
        last = results.get(StepId.CALIBRATE)
        if last is not None and (other := _missing_cell(last)):
            for before in reversed(commissioning.passed_with(session, last.fingerprint)):
                of_other = [found for found in before.calibrations if found["tendon"] == other]
                if before.step == StepId.CALIBRATE and of_other:
                    both = [*of_other, *last.calibrations]
                    return results | {StepId.CALIBRATE: replace(last, at=before.at, calibrations=both)}
    return results


def _missing_cell(result: StoredStepResult) -> str:
    """Return the load cell that a calibration of a single one leaves; empty where it was not of a single one."""
    cells = {found["tendon"] for found in result.calibrations}
    return "AB".replace(cells.pop(), "") if len(cells) == 1 else ""


def kept(database: Database) -> Kept:
    """Return what is kept of all steps."""
    with database.reading() as session:
        test_failed = commissioning.last_failure(session, StepId.WIRING_TEST)
    return Kept(newest(database), test_failed)


def in_effect(database: Database, wiring: Wiring) -> BroughtUp:
    """Return what takes effect with a wiring: the newest calibration of each cell, and what is known of the rig.

    Directions are proven while the direction step is current and no later wiring test has failed. A load cell is
    measured by a tare and a calibration, however old, or by the table of the wiring file.
    """
    wired = wiring_fingerprint(wiring)
    with database.reading() as session:
        passed = commissioning.passed_with(session, wired)
    cells = {found["tendon"]: CellCalibration(**found) for result in passed for found in result.calibrations}
    by_step = {
        step: {found["tendon"] for result in passed if result.step == step for found in result.calibrations}
        for step in (StepId.TARE, StepId.CALIBRATE)
    }
    tables = {tendon for tendon, cell in (("A", wiring.load_cell_A), ("B", wiring.load_cell_B)) if cell.table}
    measured = {"A", "B"} <= tables | (by_step[StepId.TARE] & by_step[StepId.CALIBRATE])
    direction = states(kept(database), wiring, datetime.now(UTC))[StepId.DIRECTION].state
    return BroughtUp(tuple(cells.values()), direction is StepState.CURRENT, measured, wired)


def find_for_next_start(database: Database, plant: PlantChoice, known: BroughtUp) -> BroughtUp:
    """Return what the next loop starts with: what was found with the wiring file that it will read.

    ``known`` is what holds so far; where there is no rig, or its wiring is that of before, it stays.
    """
    if plant.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        return known
    try:
        wiring = load_wiring_choice(plant)
    except PlantError:
        return NOT_BROUGHT_UP  # the loop says itself why it does not start
    # a start with the wiring of before waits for no database
    return known if wiring_fingerprint(wiring) == known.wired else in_effect(database, wiring)


def find_completed_commissioning(database: Database, plant: PlantChoice) -> BroughtUp:
    """Return what takes effect of earlier bring-ups for what is to be driven. Raises PlantError."""
    if plant.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        return NOT_BROUGHT_UP
    return in_effect(database, load_wiring_choice(plant))
