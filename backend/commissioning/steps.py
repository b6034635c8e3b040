"""Steps of the commissioning: what each needs, how it stands, how long it holds."""

import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.realtime.commands import Accepted, Command, Refused, SimulateManualInput
from backend.realtime.program import MODES, Mode
from backend.realtime.supervisor import LoopClient
from backend.sample import INDEX
from backend.storage import commissioning
from backend.storage.commissioning import NewStepResult, StoredStepResult
from backend.storage.database import Database
from backend.units import counted
from plant.calibration import NOT_BROUGHT_UP, BroughtUp, CellCalibration, fingerprint
from plant.factory import wiring_of_choice
from plant.interface import PlantChoice, PlantKind, T_s
from plant.manual_input import NO_HAND, ManualInput
from plant.parameters import PlantParameters
from plant.wiring import Wiring

# Steps ---------------------------------------------------------------------------------------------
#
# The steps of bringing a rig up: what each is called, asks for and needs, and for how long it holds
# good.


class StepId(StrEnum):
    """The steps, in their order."""

    WIRING_TEST = "wiring_test"
    TARE = "tare"
    CALIBRATE = "calibrate"
    ZERO = "zero"
    DIRECTION = "direction"
    HOME = "home"
    PRETENSION = "pretension"
    SAFETY_MODULE = "safety_module"


@dataclass(frozen=True)
class Input:
    """One number that a step asks for, with its bounds in its unit."""

    name: str
    words: str
    unit: str
    default: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class CommissioningStep:
    """``holds_days`` tells for how long a result holds good; ``needs`` what has to be passed before."""

    id: StepId
    title: str
    instruction: str
    holds_days: float
    needs: tuple[StepId, ...] = ()
    inputs: tuple[Input, ...] = ()


WEIGHT_MAX_N = 45.0
"""Heaviest known weight [N]: within what load cells and springs of 50 N bear."""

MORE_WEIGHTS = tuple(Input(f"weight_{n}_N", "further weight", "N", 15.0, 0.0, WEIGHT_MAX_N) for n in range(3, 10))
"""What a calibration takes beside the two weights that it asks for."""

STEPS: tuple[CommissioningStep, ...] = (
    CommissioningStep(
        StepId.WIRING_TEST,
        "Wiring test",
        "Drives off, tendons slack. Turn the joint, then each motor, and pull at each tendon, as you are asked: each "
        "sensor has to move, the right one, and to the right side.",
        holds_days=30.0,
    ),
    CommissioningStep(
        StepId.TARE,
        "Tare",
        "Both tendons slack, nothing touches the load cells: 1 s of their volts becomes their zero. The loop starts "
        "anew with it, so that the encoders lose theirs: do Zero after it.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.CALIBRATE,
        "Calibration",
        "Hang two known weights on each load cell, one after the other: slope and offset come from them. The "
        "loop starts anew with them, so that the encoders lose their zero: do Zero after it.",
        holds_days=180.0,
        needs=(StepId.WIRING_TEST,),
        inputs=(
            Input("weight_1_N", "lighter weight", "N", 5.0, 0.0, WEIGHT_MAX_N),
            Input("weight_2_N", "heavier weight", "N", 25.0, 0.0, WEIGHT_MAX_N),
        ),
    ),
    CommissioningStep(
        StepId.ZERO,
        "Zero",
        "Put the joint where its position is known, at its zero mark or at the end switch: the encoders count from "
        "there. They forget it at each start of the loop.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST,),
    ),
    CommissioningStep(
        StepId.DIRECTION,
        "Motor directions",
        "Hands off. Each motor turns a little, with 1 V at most, and back: its encoder has to rise, its tendon to get "
        "tauter, the joint to go to its side.",
        holds_days=30.0,
        needs=(StepId.WIRING_TEST, StepId.ZERO),
    ),
    CommissioningStep(
        StepId.HOME,
        "Homing",
        "Hands off. Both motors hold the tendons at 4 N and drive the joint to its end switch, slowly and with 1.5 V "
        "at most, and back to its middle: the encoders count from there. Any surprise ends it at zero volts.",
        holds_days=1.0,
        needs=(StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.PRETENSION,
        "Pretension",
        "Hands off. Both motors wind up to the pretension: both tensions have to rise together, none beyond its limit.",
        holds_days=30.0,
        needs=(StepId.TARE, StepId.CALIBRATE, StepId.ZERO, StepId.DIRECTION),
    ),
    CommissioningStep(
        StepId.SAFETY_MODULE,
        "Safety module",
        "At the pretension, lower the limit at the safety module until it trips. The loop goes on to drive both motors "
        "for 0.3 s, with 1 V at most: they have to let go all the same, as the module has cut them.",
        holds_days=30.0,
        needs=(StepId.PRETENSION,),
    ),
)

INSTEAD = {StepId.ZERO: StepId.HOME, StepId.HOME: StepId.ZERO}
"""Steps of which one does for the other: either has the encoders count from where the joint is known to be."""

STEP: dict[StepId, CommissioningStep] = {step.id: step for step in STEPS}


# Work ----------------------------------------------------------------------------------------------
#
# What a step works with: the loop that runs, its samples, and a person who is asked to do things at
# the rig.


Rows = NDArray[np.float64]
"""Samples [n, fields]."""

Signal = NDArray[np.float64]
"""One signal [n]."""

SLACK = ManualInput(q=0.0, theta_A=0.0, theta_B=0.0)
"""Joint and motors where a virtual card begins: both tendons slack."""

HAND_S = 2.0
"""A hand of this program has brought joint and motors to where they belong after so long [s]."""

BLOCK_S = 0.05
"""Readings are averaged over so long [s]: the noise of a load cell is a seventh of itself then."""


@dataclass(frozen=True)
class MeasuredNumber:
    """One number that was measured; None where it could not be."""

    words: str
    value: float | None
    unit: str


@dataclass(frozen=True)
class StepFinding:
    """What a step came to; ``calibrations`` take effect where it passed.

    ``disproves_directions`` tells that a motor or the joint did not go where the step of the directions says.
    """

    passed: bool
    text: str
    figures: tuple[MeasuredNumber, ...] = ()
    calibrations: tuple[CellCalibration, ...] = ()
    disproves_directions: bool = False


class StepFailedError(Exception):
    """A step cannot go on; the message says what was seen and what to do."""


class DirectionsDisprovedError(StepFailedError):
    """What was seen contradicts the step of the directions: it has to be done again."""


Confirmed = Callable[[str], Awaitable[None]]
"""Asks a person to do something and returns once it is confirmed."""


Switch = Callable[[bool], Awaitable[Accepted | Refused]]
"""Switches the drives on or off, and keeps whether hands may be at the rig."""


class ProcedureContext:
    """``values`` are what the person entered; ``computed`` tells that hands of this program do what is asked for.

    ``cells`` are the load cells to calibrate. ``tried_motors``: the loop takes directions for unproven since.
    """

    def __init__(
        self,
        loop: LoopClient,
        wiring: Wiring,
        parameters: PlantParameters,
        values: dict[str, float],
        *,
        computed: bool,
        confirmed: Confirmed,
        switch: Switch,
        phase: Callable[[str], None],
        cells: str = "AB",
    ) -> None:
        self.loop = loop
        self.wiring = wiring
        self.parameters = parameters
        self.values = values
        self.phase = phase
        self.computed = computed
        self.cells = cells
        self.tried_motors = False
        self._confirmed = confirmed
        self._switch = switch

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample; OFF before the first."""
        newest = self.loop.ring.newest()
        return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]

    async def send(self, command: Command) -> None:
        """Hand over a command. Raises StepFailedError with the loop's reason where it is refused."""
        _require_accepted(await self.loop.send(command))

    async def drives_off(self) -> None:
        """Take the drives away before hands are asked for; they stay off until somebody has them switched on."""
        _require_accepted(await self._switch(False))

    async def drives_on(self) -> None:
        """Give the drives back, at zero volts: only after it was confirmed that no hand is at the rig."""
        _require_accepted(await self._switch(True))

    async def ask(self, words: str, hand: ManualInput = NO_HAND) -> None:
        """Ask a person to do something and wait until it is confirmed; at a virtual card, ``hand`` does it then."""
        await self._confirmed(words)
        if self.computed and hand != NO_HAND:
            await self.send(SimulateManualInput(hand))
            await self.loop.advance(HAND_S)

    async def let_go(self) -> None:
        """Take the hands away."""
        if self.computed:
            await self.send(SimulateManualInput(NO_HAND))
            await self.loop.advance(0.1)

    async def mean(self, *names: str, seconds: float = 0.3) -> NDArray[np.float64]:
        """Return the means [len(names)] of signals over the next seconds; nan where one was no number."""
        rows = await self.recorded(seconds)
        means: NDArray[np.float64] = rows[:, [INDEX[name] for name in names]].mean(axis=0)
        return means

    async def recorded(self, seconds: float) -> NDArray[np.float64]:
        """Let the loop go on and return the samples [n, fields] from now on."""
        first = self.loop.ring.count
        await self.loop.advance(seconds)
        return self.since(first)[: round(seconds / T_s)]

    def since(self, first: int) -> NDArray[np.float64]:
        """Return the samples [n, fields] from the one numbered ``first`` on."""
        _, rows, _ = self.loop.ring.read(first, self.loop.ring.capacity)
        return rows


def _require_accepted(answer: Accepted | Refused) -> None:
    if isinstance(answer, Refused):
        raise StepFailedError(answer.reason)


def known(value: float) -> float | None:
    """Return what was measured; None where it is no number."""
    return value if math.isfinite(value) else None


def blocks(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return means of a signal over blocks of BLOCK_S."""
    length = round(BLOCK_S / T_s)
    count = max(len(rows) // length, 1)
    column = rows[: count * length, INDEX[name]]
    return np.array([part.mean() for part in np.array_split(column, count)])


# Standing ------------------------------------------------------------------------------------------
#
# How the steps stand: what is stored of them against the wiring of today, and what takes effect of
# it.


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
    if step.id in INSTEAD and result.at < loop_started:
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
    wired = "" if wiring is None else fingerprint(wiring)
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
        for step, other in INSTEAD.items()
        if found[step].state in _NOT_DONE and found[other].state is StepState.CURRENT
    }


_NOT_DONE = (StepState.NEVER, StepState.OUT_OF_DATE)


def _by_tables(wiring: Wiring | None) -> bool:
    return wiring is not None and bool(wiring.load_cell_A.table and wiring.load_cell_B.table)


def _contradicted(kept: Kept) -> bool:
    return kept.results[StepId.DIRECTION].id < kept.test_failed


def blocked_by(step: CommissioningStep, states: Mapping[StepId, StepStatus]) -> str:
    """Return what has to come before a step, and before that; empty where nothing has."""
    if step.id not in states:
        return "the wiring file says no end_switch.position: where the switch holds the joint has to be known"
    missing = [_titled(need, states) for need in _all_needs(step) if not _stands(need, states[need])]
    return f"first: {', '.join(missing)}" if missing else ""


def _stands(step: StepId, found: StepStatus) -> bool:
    return found.state is StepState.CURRENT or (found.aged and step in (StepId.TARE, StepId.CALIBRATE))


def _titled(step: StepId, states: Mapping[StepId, StepStatus]) -> str:
    """Return what a step is called, and what does for it where there is such a one."""
    other = INSTEAD.get(step)
    return f"{STEP[step].title} or {STEP[other].title}" if other in states and other else STEP[step].title


def _all_needs(step: CommissioningStep) -> list[StepId]:
    needed = set(step.needs).union(*(_all_needs(STEP[need]) for need in step.needs)) - {INSTEAD.get(step.id)}
    return [other.id for other in STEPS if other.id in needed]


def keep(database: Database, step: StepId, wiring: Wiring, finding: StepFinding, who: str) -> StoredStepResult:
    """Store what a step came to; what disproves the directions stands as a failure of theirs too."""
    if finding.disproves_directions:
        keep(database, StepId.DIRECTION, wiring, StepFinding(False, f"{STEP[step].title}: {finding.text}"), who)
    new = NewStepResult(
        step=step,
        wiring=wiring.title,
        fingerprint=fingerprint(wiring),
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
    wired = fingerprint(wiring)
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


def brought_up_of(database: Database, plant: PlantChoice) -> BroughtUp:
    """Return what takes effect of earlier bring-ups for what is to be driven. Raises PlantError."""
    if plant.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        return NOT_BROUGHT_UP
    return in_effect(database, wiring_of_choice(plant))
