"""Experiments and identifications while they run: prediction, progress, pause and dry run."""

import asyncio
import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from backend.analysis.evaluation import Evaluation
from backend.auth.authentication import BEARER, User
from backend.control.motion_primitives import ZERO_VOLTS_S
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.execution.progress import ProgressCallback, RunPhase
from backend.execution.runner import ExperimentRig, NotReadyError, RunRequest, create_run
from backend.execution.simulation import _ProgressFile
from backend.experiments.forecast import ExpectedDuration, Stage
from backend.experiments.library import build_ready_plan, find_experiment
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import Accepted, SetMode
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.supervisor import LoopClient, LoopExitedError
from backend.recording.reader import read_envelope, read_samples
from backend.sample import INDEX, NAMES
from backend.schemas.identification import ActuatorRequest, IdentificationRequest, MotorRequest, SpringRequest
from backend.schemas.run import PlannedSignals
from backend.schemas.session import Role
from backend.schemas.state import TaskView
from backend.services import jobs, messages
from backend.services.banks import StoredBanks
from backend.services.jobs import Pause, ScheduledRun, make_progress_callback
from backend.services.queue import DryRuns
from backend.services.runs import read_planned_run as planned_in
from backend.services.state import LiveState
from backend.storage import banks, runs
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.storage.runs import EndState, Run
from backend.workers import WorkerProcess
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, InProcessWorker, Parts, stepped
from tests.refusals import refused

# Predictions of an identification compared with the run of the loop: length, progress and bank.

ORDER = ActuatorRequest(tensions_N=[10.0, 40.0], bits=5, periods=2, settle_s=1.0)
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


def test_consecutive_runs_match_their_predicted_duration_and_range(tmp_path: Path) -> None:
    database = open_database(tmp_path)

    async def ordered(parts: Parts) -> None:
        assert isinstance(await parts.supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        prediction = await parts.ordered_runs.predict_identification(ORDER, asyncio.to_thread)
        began = parts.supervisor.ring.count
        seen: list[TaskView] = []
        first = await parts.ordered_runs.start_identification(ORDER, OPERATOR.name)
        while parts.live_state.task is not None:
            if not seen or parts.live_state.task != seen[-1]:
                seen.append(parts.live_state.task)
            await asyncio.sleep(0)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        took_s = (parts.supervisor.ring.count - began) / 1000.0
        # The service checks ten times a second whether a run has ended, and whether the next one can start.
        assert prediction.duration_s == pytest.approx(took_s, abs=0.6)
        for run in (first, first + 1):
            shown = [task for task in seen if task.run == run]
            elapsed = [task.elapsed_s for task in shown]
            assert elapsed == sorted(elapsed)
            played = [task for task in shown if task.phase is RunPhase.PROGRAM]
            assert len({task.duration_s for task in played}) == 1
            assert shown[0].duration_s == pytest.approx(played[0].duration_s, abs=0.3)
            assert played[-1].elapsed_s == pytest.approx(played[-1].duration_s, abs=0.3)
            view = parts.identifications.load_identification(run)
            assert view.estimate is not None, view.message
        with database.reading() as session:
            ends = [read_envelope(session, run, 1, ("q",)) for run in (first, first + 1)]
        furthest = max(float(envelope.maximum["q"].max()) for envelope in ends)
        assert prediction.q_high - 0.06 < furthest < prediction.q_high
        view = parts.identifications.load_identification(first)
        with database.session() as session:
            entries = [BankEntry(8.24, MODEL, view.estimate), BankEntry(12.43, MODEL)]
            bank = banks.add(session, "bench", entries, OPERATOR.name)
        banks_of = StoredBanks(database, InProcessWorker(lambda _cause: None), lambda: parts.live_state.tuning)
        made, imported = banks_of.load_bank(bank.id).entries
        # θ_B = 0: both springs share the travel of motor A, so that the joint is at x/r_j, x = 23.49 mm at 10 N.
        assert made.q_nominal == pytest.approx(0.02349 / 0.075, abs=2e-3)
        assert imported.q_nominal is None

    try:
        stepped(database, load_parameters("ideal"), ordered)
    finally:
        database.close()


# The displayed stage of identifications compared with the samples of their loop; a pause between two runs.

SIGNALS = ("theta_A_ref", "theta_B_ref", "u_A", "F_A")
ACTUATOR = ActuatorRequest(tension_N=20.0, bits=4, periods=2, settle_s=1.5)
TWO = ActuatorRequest(tensions_N=[12.0, 20.0], bits=4, periods=1, settle_s=1.0)
MOTOR = MotorRequest(kind="motor", u_low=3.0, u_high=6.0, levels=2)
SPRING = SpringRequest(kind="spring", F_low=4.0, F_high=40.0, sweep_s=3.0, cycles=1)


@dataclass(frozen=True)
class ShownTasks:
    """The displayed views of a request while it ran, its first run, and the length of each run [s] by number."""

    run: int
    tasks: list[TaskView]

    def played(self, run: int) -> list[TaskView]:
        return [task for task in self.tasks if task.run == run and task.phase is RunPhase.PROGRAM]


async def pretension(parts: Parts) -> None:
    assert isinstance(await parts.supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
    await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)


async def follow(
    parts: Parts, order: IdentificationRequest, at_each: Callable[[TaskView], None] = lambda _task: None
) -> ShownTasks:
    run = await parts.ordered_runs.start_identification(order, OPERATOR.name)
    tasks: list[TaskView] = []
    while (task := parts.live_state.task) is not None:
        if not tasks or task != tasks[-1]:
            tasks.append(task)
            at_each(task)
        await asyncio.sleep(0)
    return ShownTasks(run, tasks)


def recorded(database: Database, run: int) -> dict[str, np.ndarray]:
    with database.reading() as session:
        return dict(read_samples(session, run, SIGNALS).columns)


def end_of(database: Database, run: int) -> EndState:
    with database.reading() as session:
        return EndState(runs.get(session, run).end_state)


def check_time_left(seen: ShownTasks, run: int, samples: int) -> None:
    """Check that the displayed time left is correct: within 5 % of the run's length or 1 s."""
    took_s = samples * T_s
    within = max(1.0, 0.05 * took_s)
    shown = seen.played(run)
    assert len(shown) > 5
    for task in shown:
        assert task.part is not None
        assert task.duration_s - task.elapsed_s == pytest.approx(took_s - task.part.t, abs=within)
    of_the_way = [task for task in seen.tasks if task.run == run and task.phase is RunPhase.STARTING]
    assert all(task.duration_s == pytest.approx(took_s, abs=within) for task in of_the_way)


def planned_of(database: Database, run: int) -> PlannedSignals:
    return planned_in(database, run)


def line(planned: PlannedSignals, name: str) -> np.ndarray:
    values = next(one.values for one in planned.lines if one.name == name)
    return np.array([np.nan if value is None else value for value in values])


def run_of(tmp_path: Path, order: IdentificationRequest) -> tuple[ShownTasks, dict[str, np.ndarray], PlannedSignals]:
    database = open_database(tmp_path)
    seen: list[ShownTasks] = []

    async def ordered(parts: Parts) -> None:
        await pretension(parts)
        seen.append(await follow(parts, order))

    try:
        stepped(database, load_parameters("lab"), ordered)
        run = seen[0].run
        assert end_of(database, run) is EndState.COMPLETED
        return seen[0], recorded(database, run), planned_of(database, run)
    finally:
        database.close()


def test_the_stage_of_an_actuator_identification_matches_its_samples(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, ACTUATOR)
    check_time_left(seen, seen.run, columns["u_A"].size)
    jumps = np.flatnonzero(np.abs(np.diff(columns["theta_A_ref"])) > 0.5)
    arrived = np.flatnonzero(columns["theta_B_ref"] == 0.0)[0]
    for task in seen.played(seen.run):
        assert task.part is not None
        assert (task.part.title, task.part.number, task.part.of) == ("20 N", 1, 1)
        at = round(task.part.t / T_s)
        if abs(at - jumps[0]) > 5 and abs(at - arrived) > 5:
            stage = Stage.EXCITING if at > jumps[0] else Stage.SETTLING if at > arrived else Stage.TRAVELLING
            assert task.part.doing is stage
    predicted = line(planned, "theta_A_ref")
    at = np.minimum(np.rint(np.array(planned.t) / T_s).astype(int) - 1, columns["u_A"].size - 1)
    difference = np.abs(predicted - columns["theta_A_ref"][at])
    # except for a jump that is one tick apart, the reference differs only by the trim of the force loop
    assert np.mean(difference > 1.0) < 0.3
    assert np.median(difference) < 0.2
    assert [part.title for part in planned.parts] == [
        f"20 N, {stage}" for stage in (Stage.TRAVELLING, Stage.SETTLING, Stage.EXCITING)
    ]


FREE = (Stage.EXCITING, Stage.BRAKING)


def stages(u: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the stage by sample of voltage steps: excited by a constant voltage, then braked, or neither."""
    true = np.full(u.size, str(Stage.TRAVELLING), dtype=object)
    for begin, end in zip(*(np.flatnonzero(np.diff(free.astype(int)) == way) + 1 for way in (1, -1)), strict=False):
        driven = begin + round(ZERO_VOLTS_S / T_s)
        over = driven + int(np.argmax(u[driven:end] != u[driven]))
        true[driven:over], true[over:end] = str(Stage.EXCITING), str(Stage.BRAKING)
    return true


def test_the_stage_of_a_motor_identification_matches_its_samples(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, MOTOR)
    check_time_left(seen, seen.run, columns["u_A"].size)
    free = np.isnan(columns["theta_A_ref"])
    true = stages(columns["u_A"], np.append(free[:-1], False))
    assert np.count_nonzero(np.diff((true == str(Stage.EXCITING)).astype(int)) == 1) == 4
    for task in seen.played(seen.run):
        assert task.part is not None
        assert task.part.of == 4
        at = round(task.part.t / T_s)
        near = true[max(0, at - 1000) : at + 1000]  # the display may be a second early or late
        assert str(task.part.doing if task.part.doing in FREE else Stage.TRAVELLING) in near
    titles = {task.part.number: task.part.title for task in seen.played(seen.run) if task.part}
    assert titles == {1: "3 V", 2: "−3 V", 3: "6 V", 4: "−6 V"}
    predicted = line(planned, "u_A")
    whole_s = columns["u_A"].size * T_s
    for volts in (3.0, -3.0, 6.0, -6.0):
        driven = np.flatnonzero((columns["u_A"] == volts) & free) * T_s
        asked = np.array(planned.t)[predicted == volts]
        assert asked[0] == pytest.approx(driven[0], abs=0.05 * whole_s)
        assert asked[-1] == pytest.approx(driven[-1], abs=0.05 * whole_s)


def test_the_stage_of_a_spring_identification_matches_its_samples(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, SPRING)
    check_time_left(seen, seen.run, columns["u_A"].size)
    up = int(np.argmax(columns["theta_A_ref"]))
    for task in seen.played(seen.run):
        assert task.part is not None
        at = round(task.part.t / T_s)
        if task.part.doing is Stage.WINDING and abs(at - up) > 5:
            assert (task.part.title, task.part.number) == (("40 N", 2) if at < up else ("4 N", 3))
    t, F = np.array(planned.t), line(planned, "F_A")
    assert t[int(np.argmax(F))] == pytest.approx(up * T_s, abs=0.01)
    assert (F.max(), F[-1]) == pytest.approx((40.0, 4.0), abs=1e-3)
    at = np.minimum(np.rint(t / T_s).astype(int) - 1, columns["u_A"].size - 1)
    assert line(planned, "theta_A_ref") == pytest.approx(columns["theta_A_ref"][at], abs=0.007)


def test_a_pause_delays_the_next_tension_and_no_run_is_active_meanwhile(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    waited: list[tuple[Mode, int | None]] = []

    async def ordered(parts: Parts) -> None:
        await pretension(parts)
        pause = parts.ordered_runs.pause
        with refused(RequestRejectedError, "no_run_to_pause"):
            pause.request(True)

        def at_each(task: TaskView) -> None:
            if task.phase is RunPhase.PROGRAM and task.number == 1 and not task.pause_wanted:
                pause.request(True)
            if task.phase is RunPhase.PROGRAM and task.number == 2:
                with refused(RequestRejectedError, "no_further_run_to_pause"):
                    pause.request(True)
            state = parts.state()
            if task.phase is RunPhase.PAUSED:
                assert (task.number, task.following, task.part) == (1, 1, None)
                waited.append((state.mode, state.recording_run))

        async def goes_on() -> None:
            while not waited:
                await asyncio.sleep(0)
            await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
            assert parts.live_state.task is not None
            assert parts.live_state.task.phase is RunPhase.PAUSED
            assert parts.state().legal_modes == [Mode.STOPPING, Mode.OFF]
            for mode in (Mode.RUN, Mode.COMPLIANCE):
                with refused(
                    RequestRejectedError,
                    "illegal_mode",
                    reason=messages.request_is_paused(),
                    legal=["stopping", "off"],
                ):
                    await parts.actuator.set_mode(mode, OPERATOR.name)
            pause.request(False)

        resumed = asyncio.create_task(goes_on())
        seen = await follow(parts, TWO, at_each)
        await resumed
        assert {task.part.title for task in seen.played(seen.run + 1) if task.part} == {"20 N"}
        second = [task.part for task in seen.played(seen.run + 1) if task.part]
        assert {(part.number, part.of) for part in second} == {(2, 2)}
        assert [end_of(database, seen.run + place) for place in (0, 1)] == [EndState.COMPLETED] * 2
        check_time_left(seen, seen.run + 1, recorded(database, seen.run + 1)["u_A"].size)

    try:
        stepped(database, load_parameters("ideal"), ordered)
    finally:
        database.close()
    assert {mode for mode, _ in waited} == {Mode.PRETENSION}


def test_a_request_aborted_in_its_pause_ends_with_the_completed_runs(tmp_path: Path) -> None:
    database = open_database(tmp_path)

    async def ordered(parts: Parts) -> None:
        await pretension(parts)
        stopping: list[asyncio.Task[object]] = []

        def at_each(task: TaskView) -> None:
            if task.phase is RunPhase.PROGRAM and not task.pause_wanted:
                parts.ordered_runs.pause.request(True)
            if task.phase is RunPhase.PAUSED and not stopping:
                stopping.append(asyncio.create_task(parts.supervisor.send(SetMode(Mode.STOPPING))))

        seen = await follow(parts, TWO, at_each)
        await asyncio.gather(*stopping)
        assert {task.run for task in seen.tasks} == {seen.run}
        assert parts.ordered_runs.problems == [
            messages.runs_not_started(run=seen.run, reason=messages.stopped_softly_in_pause(), count=1)
        ]
        evaluated = [task for task in seen.tasks if task.phase is RunPhase.EVALUATION]
        assert {(task.following, task.pause_wanted) for task in evaluated} == {(0, False)}
        assert end_of(database, seen.run) is EndState.COMPLETED
        view = parts.identifications.load_identification(seen.run)
        assert view.estimate is not None

    try:
        stepped(database, load_parameters("ideal"), ordered)
    finally:
        database.close()


# The pause between two runs of a request: requests, ends and messages.

THREE = ActuatorRequest(tensions_N=[12.0, 16.0, 20.0], bits=4, periods=1, settle_s=1.0)


class FakeLoop:
    """A loop whose newest sample has the next of these modes at each advance; it dies after the last."""

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


class PauseState:
    """The part of the live state that a pause reads."""

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


def paused(following: int) -> tuple[Pause, PauseState]:
    live_state = PauseState()
    pause = Pause(cast(LiveState, live_state), lambda: None)
    pause.begin(following)
    if following:
        pause.request(True)
    return pause, live_state


def wait(pause: Pause, loop: FakeLoop) -> int:
    """Wait for the end of the pause; return how often it was shown."""
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
    with refused(RequestRejectedError, "no_further_run_to_pause"):
        pause.request(True)  # the last run is being prepared: the previous run is still shown
    assert not pause.is_requested


@pytest.mark.parametrize(
    ("mode", "code"),
    [
        (Mode.OFF, "motors_switched_off_in_pause"),
        (Mode.STOPPING, "stopped_softly_in_pause"),
        (Mode.TRIPPED, "tripped_in_pause"),
    ],
)
def test_pause_ends_the_request_if_the_motors_are_switched_off(mode: Mode, code: str) -> None:
    pause, _ = paused(2)
    loop = FakeLoop(Mode.PRETENSION, mode, Mode.PRETENSION)
    with pytest.raises(NotReadyError) as ended:
        wait(pause, loop)
    assert (ended.value.message.code, ended.value.mode) == (code, mode)
    assert (loop.advanced, pause.remaining_runs) == (2, 2)


def test_an_exit_of_the_loop_ends_the_pause() -> None:
    pause, _ = paused(1)
    with pytest.raises(LoopExitedError, match="was killed"):
        wait(pause, FakeLoop(Mode.PRETENSION))


def test_pause_is_refused_without_a_remaining_run() -> None:
    pause, live_state = paused(1)
    pause.begin(0)
    assert not pause.is_requested
    with refused(RequestRejectedError, "no_further_run_to_pause"):
        pause.request(True)
    live_state.task = None
    with refused(RequestRejectedError, "no_run_to_pause"):
        pause.request(True)


def test_runs_not_started_are_counted() -> None:
    several = messages.runs_not_started(run=7, reason="it died.", count=2)
    assert "it died; 2 runs were" in several
    assert "it died; 1 run was" in messages.runs_not_started(run=7, reason="it died", count=1)


async def at_once(_station: ExperimentRig, _plan: Any, _run: Run) -> Evaluation:
    return Evaluation(None, None, "nothing was played")


def end_after_first_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, dies: bool) -> tuple[list[str], Mode]:
    """Return the problems and mode of a request whose loop dies in the pause, or whose second run is rejected."""
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
        await parts.supervisor.advance(0.1)  # a stop would be visible by now
        return parts.ordered_runs.problems, parts.live_state.mode

    monkeypatch.setattr(jobs, "create_run", second_refused)
    try:
        return stepped(database, load_parameters("ideal"), order)
    finally:
        database.close()


@pytest.mark.parametrize("dies", [True, False])
def test_end_between_two_runs_leaves_the_first_run_completed(
    dies: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (message, *_of_results), mode = end_after_first_run(tmp_path, monkeypatch, dies=dies)
    assert mode is Mode.PRETENSION
    why = "the loop process was killed" if dies else OutOfRangeError("q", 1.2, -1.0, 1.0, "rad")
    assert message == messages.runs_not_started(run=1, reason=str(why), count=2)


# The displayed name of a run: an experiment document by its title, those of the paper by their kind.


@pytest.mark.parametrize(
    ("name", "kind", "title"), [("hold_at_rest", "experiment", "Hold at rest"), ("tracking", "tracking", "")]
)
def test_an_experiment_document_is_named_by_its_title(name: str, kind: str, title: str) -> None:
    plan = find_experiment(name).default_plan
    live_state: Any = SimpleNamespace(task=None)
    order = ScheduledRun(plan, run=14, expected=ExpectedDuration(before_s=2.0, program_s=30.0))
    make_progress_callback(live_state, order, cast(Any, SimpleNamespace(remaining_runs=0, is_requested=False)))(
        RunPhase.PRETENSION, 1.5
    )
    task = live_state.task
    assert (task.kind, task.title, task.run, task.elapsed_s, task.duration_s) == (kind, title, 14, 1.5, 32.0)


# The slot of a dry run is freed after every outcome.

OTHER = User("another", Role.VIEWER, BEARER)
VIEWER = User("viewer", Role.VIEWER, BEARER)


def test_a_dry_run_that_fails_for_lack_of_disk_space_frees_its_slot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    order = RunRequest(build_ready_plan("tracking"), LoopSettings(), VIEWER.name)

    async def whole() -> None:
        dry_runs = DryRuns(WorkerProcess(lambda _cause: None))
        for _ in range(3):  # a slot that is not freed would be rejected as the person's second
            with pytest.raises(FileNotFoundError):
                await dry_runs.play(load_parameters("ideal"), order, (), VIEWER, stays)

    asyncio.run(whole())


class HalfwayWorker(WorkerProcess):
    """A worker that has executed 3 s of an experiment and continues."""

    async def run(self, work: Callable[..., Any], *arguments: Any, **_none: Any) -> Any:
        folder = arguments[-1]
        progress = _ProgressFile(folder)
        progress(RunPhase.PROGRAM, 3.0)
        await asyncio.Event().wait()


def test_progress_of_a_dry_run_is_shown_to_its_person_until_disconnect() -> None:
    order = RunRequest(build_ready_plan("tracking"), LoopSettings(), VIEWER.name)
    left = asyncio.Event()

    async def is_disconnected() -> bool:
        return left.is_set()

    async def whole() -> None:
        dry_runs = DryRuns(HalfwayWorker(lambda _cause: None))
        assert not (await dry_runs.progress(VIEWER)).under_way
        playing = asyncio.ensure_future(dry_runs.play(load_parameters("ideal"), order, (), VIEWER, is_disconnected))
        while (progress := await dry_runs.progress(VIEWER)).doing is not RunPhase.PROGRAM:
            await asyncio.sleep(0.01)
        assert (progress.under_way, progress.played_s) == (True, 3.0)
        assert progress.duration_s == order.plan.program().duration_s
        assert not (await dry_runs.progress(OTHER)).under_way
        left.set()
        with refused(RequestRejectedError, "computation_cancelled"):
            await playing
        assert not (await dry_runs.progress(VIEWER)).under_way

    asyncio.run(whole())


async def stays() -> bool:
    return False
