"""The pause between two runs of a request: requests, ends and messages."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from backend.analysis.evaluation import Evaluation
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.execution.progress import ProgressCallback, RunPhase
from backend.execution.runner import ExperimentRig, NotReadyError, RunRequest, create_run
from backend.realtime.commands import SetMode
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.supervisor import LoopClient, LoopExitedError
from backend.sample import INDEX, NAMES
from backend.schemas.identification import ActuatorRequest
from backend.schemas.state import TaskView
from backend.services import jobs
from backend.services.jobs import Pause, describe_runs_not_started
from backend.services.state import LiveState
from backend.storage import runs
from backend.storage.database import open_database
from backend.storage.runs import EndState, Run
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

THREE = ActuatorRequest(tensions_N=[12.0, 16.0, 20.0], bits=4, periods=1, settle_s=1.0)


class FakeLoop:
    """A loop whose newest sample is in the next of these modes each time it is advanced; it dies where none is left."""

    def __init__(self, *modes: Mode, at_each: Callable[[int], None] = lambda _advanced: None) -> None:
        self.ring = self
        self.advanced = 0
        self._modes, self._at_each = modes, at_each

    def newest(self) -> np.ndarray:
        row = np.zeros(len(NAMES))
        row[INDEX["mode"]] = MODE_CODE[self._modes[self.advanced - 1]]
        return row

    async def advance(self, _seconds: float) -> None:
        if self.advanced == len(self._modes):
            raise LoopExitedError("the loop process was killed")
        self.advanced += 1
        self._at_each(self.advanced)


class Present:
    """Of the present state what a pause knows of."""

    def __init__(self) -> None:
        self.task: TaskView | None = TaskView(
            kind="actuator_identification",
            run=7,
            elapsed_s=1.0,
            duration_s=9.0,
            phase=RunPhase.PROGRAM,
            part=None,
            number=1,
        )


def paused(following: int) -> tuple[Pause, Present]:
    live_state = Present()
    pause = Pause(cast(LiveState, live_state), lambda: None)
    pause.begin(following)
    if following:
        pause.request(True)
    return pause, live_state


def wait(pause: Pause, loop: FakeLoop) -> int:
    """Wait for its end; how often it was shown."""
    shown: list[None] = []
    asyncio.run(pause.wait_until_resumed(cast(LoopClient, loop), lambda: shown.append(None)))
    return len(shown)


def test_pause_lasts_until_resumed_and_counts_the_next_run() -> None:
    pause, live_state = paused(2)
    assert live_state.task is not None
    assert live_state.task.pause_wanted
    loop = FakeLoop(*[Mode.PRETENSION] * 5, at_each=lambda advanced: pause.request(False) if advanced == 3 else None)
    assert (wait(pause, loop), loop.advanced, pause.remaining_runs) == (3, 3, 1)


def test_next_run_starts_at_once_without_pause() -> None:
    pause, _ = paused(1)
    pause.request(False)
    loop = FakeLoop()
    assert (wait(pause, loop), loop.advanced, pause.remaining_runs) == (0, 0, 0)
    with pytest.raises(RequestRejectedError, match="no run of the same order follows"):
        pause.request(True)  # the last run is being prepared: what is shown is still the one before it
    assert not pause.is_requested


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        (Mode.OFF, "the motors were switched off in its pause"),
        (Mode.STOPPING, "it was stopped softly in its pause"),
        (Mode.TRIPPED, "a fault or STOP took the motors in its pause"),
    ],
)
def test_pause_ends_the_request_if_the_motors_are_switched_off(mode: Mode, why: str) -> None:
    pause, _ = paused(2)
    loop = FakeLoop(Mode.PRETENSION, mode, Mode.PRETENSION)
    with pytest.raises(NotReadyError, match=why) as ended:
        wait(pause, loop)
    assert (ended.value.mode, loop.advanced, pause.remaining_runs) == (mode, 2, 2)


def test_a_loop_that_dies_ends_it() -> None:
    pause, _ = paused(1)
    with pytest.raises(LoopExitedError, match="was killed"):
        wait(pause, FakeLoop(Mode.PRETENSION))


def test_pause_is_refused_without_a_remaining_run() -> None:
    pause, live_state = paused(1)
    pause.begin(0)
    assert not pause.is_requested
    with pytest.raises(RequestRejectedError, match="no run of the same order follows"):
        pause.request(True)
    live_state.task = None
    with pytest.raises(RequestRejectedError, match="nothing is under way"):
        pause.request(True)


def test_runs_not_started_are_counted() -> None:
    assert describe_runs_not_started(7, LoopExitedError("it died."), 2) == (
        "The order ended after run 7: it died; 2 runs were not begun. Order them anew."
    )


async def at_once(_station: ExperimentRig, _plan: Any, _run: Run) -> Evaluation:
    return Evaluation(None, None, "nothing was played")


def ended_behind_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, dies: bool) -> tuple[list[str], Mode]:
    """What is said of an order whose loop dies in its pause, or whose second run is refused; the mode that is left."""
    database = open_database(tmp_path)
    created: list[Run] = []

    def second_refused(station: ExperimentRig, order: RunRequest) -> Run:
        if created:
            raise OutOfRangeError("q", 1.2, -1.0, 1.0, "rad")
        created.append(create_run(station, order))
        return created[0]

    async def order(parts: Parts) -> tuple[list[str], Mode]:
        await parts.supervisor.send(SetMode(Mode.PRETENSION))
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)

        async def died(_seconds: float) -> None:
            raise LoopExitedError("the loop process was killed")

        async def complete(
            _station: ExperimentRig,
            _order: RunRequest,
            run: Run,
            _show: ProgressCallback,
            over: Callable[[], Awaitable[None]],
        ) -> Run:
            if dies:
                parts.ordered_runs.pause.request(True)
                monkeypatch.setattr(parts.supervisor, "advance", died)
            await over()
            with database.session() as session:
                return runs.end(session, run.id, EndState.COMPLETED, "")

        monkeypatch.setattr(jobs, "execute_run", complete)
        monkeypatch.setattr(jobs, "evaluate_closed_run", at_once)
        await parts.ordered_runs.start_identification(THREE, OPERATOR.name)
        await parts.ended()
        monkeypatch.undo()
        await parts.supervisor.advance(0.1)  # a stop that was begun would show by now
        return parts.ordered_runs.problems, parts.live_state.mode

    monkeypatch.setattr(jobs, "create_run", second_refused)
    try:
        return stepped(database, load_parameters("ideal"), order)
    finally:
        database.close()


@pytest.mark.parametrize("dies", [True, False])
def test_end_between_two_runs_leaves_the_first_complete_and_stops_nothing(
    dies: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (said, *_of_results), mode = ended_behind_the_first(tmp_path, monkeypatch, dies=dies)
    assert mode is Mode.PRETENSION
    why = "the loop process was killed" if dies else OutOfRangeError("q", 1.2, -1.0, 1.0, "rad")
    assert said == f"The order ended after run 1: {why}; 2 runs were not begun. Order them anew."
