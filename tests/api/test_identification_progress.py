"""What the state tells of identifications while they run, against the samples of their loop; a pause between two."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from backend.control.motion_primitives import ZERO_VOLTS_S
from backend.errors import RequestRejectedError
from backend.execution.progress import RunPhase
from backend.experiments.forecast import Stage
from backend.realtime.commands import Accepted, SetMode
from backend.realtime.modes import Mode
from backend.recording.reader import read_samples
from backend.schemas.identification import ActuatorRequest, IdentificationRequest, MotorRequest, SpringRequest
from backend.schemas.run import PlannedSignals
from backend.schemas.state import TaskView
from backend.services.runs import read_planned_run as planned_in
from backend.storage import runs
from backend.storage.database import Database, open_database
from backend.storage.runs import EndState
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

SIGNALS = ("theta_A_ref", "theta_B_ref", "u_A", "F_A")
ACTUATOR = ActuatorRequest(tension_N=20.0, bits=4, periods=2, settle_s=1.5)
TWO = ActuatorRequest(tensions_N=[12.0, 20.0], bits=4, periods=1, settle_s=1.0)
MOTOR = MotorRequest(kind="motor", u_low=3.0, u_high=6.0, levels=2)
SPRING = SpringRequest(kind="spring", F_low=4.0, F_high=40.0, sweep_s=3.0, cycles=1)


@dataclass(frozen=True)
class Seen:
    """What was shown of an order while it ran, its first run, and how long each run took [s], by its number."""

    run: int
    tasks: list[TaskView]

    def played(self, run: int) -> list[TaskView]:
        return [task for task in self.tasks if task.run == run and task.phase is RunPhase.PROGRAM]


async def pretension(parts: Parts) -> None:
    assert isinstance(await parts.supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
    await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)


async def follow(
    parts: Parts, order: IdentificationRequest, at_each: Callable[[TaskView], None] = lambda _task: None
) -> Seen:
    run = await parts.ordered_runs.start_identification(order, OPERATOR.name)
    tasks: list[TaskView] = []
    while (task := parts.live_state.task) is not None:
        if not tasks or task != tasks[-1]:
            tasks.append(task)
            at_each(task)
        await asyncio.sleep(0)
    return Seen(run, tasks)


def recorded(database: Database, run: int) -> dict[str, np.ndarray]:
    with database.reading() as session:
        return dict(read_samples(session, run, SIGNALS).columns)


def end_of(database: Database, run: int) -> EndState:
    with database.reading() as session:
        return EndState(runs.get(session, run).end_state)


def told_right(seen: Seen, run: int, samples: int) -> None:
    """The time left is right from the order on: within 5 % of the run's length or 1 s."""
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


def run_of(tmp_path: Path, order: IdentificationRequest) -> tuple[Seen, dict[str, np.ndarray], PlannedSignals]:
    database = open_database(tmp_path)
    seen: list[Seen] = []

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


def test_an_actuator_is_told_to_be_excited_when_its_samples_are(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, ACTUATOR)
    told_right(seen, seen.run, columns["u_A"].size)
    jumps = np.flatnonzero(np.abs(np.diff(columns["theta_A_ref"])) > 0.5)
    arrived = np.flatnonzero(columns["theta_B_ref"] == 0.0)[0]
    for task in seen.played(seen.run):
        assert task.part is not None
        assert (task.part.title, task.part.number, task.part.of) == ("20 N", 1, 1)
        at = round(task.part.t / T_s)
        if abs(at - jumps[0]) > 5 and abs(at - arrived) > 5:
            stage = Stage.EXCITING if at > jumps[0] else Stage.SETTLING if at > arrived else Stage.TRAVELLING
            assert task.part.doing is stage
    told = line(planned, "theta_A_ref")
    at = np.minimum(np.rint(np.array(planned.t) / T_s).astype(int) - 1, columns["u_A"].size - 1)
    beside = np.abs(told - columns["theta_A_ref"][at])
    # a chip that jumps a tick apart aside, what is asked for differs by the trim of the force loop alone
    assert np.mean(beside > 1.0) < 0.3
    assert np.median(beside) < 0.2
    assert [part.title for part in planned.parts] == ["20 N, on the way", "20 N, settling", "20 N, exciting"]


FREE = (Stage.EXCITING, Stage.BRAKING)


def stages(u: np.ndarray, free: np.ndarray) -> np.ndarray:
    """What samples of voltage steps say is done: excited by a voltage that stays, braked from then on, or neither."""
    true = np.full(u.size, str(Stage.TRAVELLING), dtype=object)
    for begin, end in zip(*(np.flatnonzero(np.diff(free.astype(int)) == way) + 1 for way in (1, -1)), strict=False):
        driven = begin + round(ZERO_VOLTS_S / T_s)
        over = driven + int(np.argmax(u[driven:end] != u[driven]))
        true[driven:over], true[over:end] = str(Stage.EXCITING), str(Stage.BRAKING)
    return true


def test_a_motor_is_told_to_have_the_voltage_that_its_samples_have(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, MOTOR)
    told_right(seen, seen.run, columns["u_A"].size)
    free = np.isnan(columns["theta_A_ref"])
    true = stages(columns["u_A"], np.append(free[:-1], False))
    assert np.count_nonzero(np.diff((true == str(Stage.EXCITING)).astype(int)) == 1) == 4
    for task in seen.played(seen.run):
        assert task.part is not None
        assert task.part.of == 4
        at = round(task.part.t / T_s)
        near = true[max(0, at - 1000) : at + 1000]  # a second is what may be told early or late
        assert str(task.part.doing if task.part.doing in FREE else Stage.TRAVELLING) in near
    titles = {task.part.number: task.part.title for task in seen.played(seen.run) if task.part}
    assert titles == {1: "3 V", 2: "−3 V", 3: "6 V", 4: "−6 V"}
    told = line(planned, "u_A")
    whole_s = columns["u_A"].size * T_s
    for volts in (3.0, -3.0, 6.0, -6.0):
        driven = np.flatnonzero((columns["u_A"] == volts) & free) * T_s
        asked = np.array(planned.t)[told == volts]
        assert asked[0] == pytest.approx(driven[0], abs=0.05 * whole_s)
        assert asked[-1] == pytest.approx(driven[-1], abs=0.05 * whole_s)


def test_springs_are_told_to_be_at_the_tension_that_their_samples_have(tmp_path: Path) -> None:
    seen, columns, planned = run_of(tmp_path, SPRING)
    told_right(seen, seen.run, columns["u_A"].size)
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


def test_the_next_tension_waits_for_a_pause_to_be_over_and_no_run_is_under_way_meanwhile(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    waited: list[tuple[Mode, int | None]] = []

    async def ordered(parts: Parts) -> None:
        await pretension(parts)
        pause = parts.ordered_runs.pause
        with pytest.raises(RequestRejectedError, match="nothing is under way"):
            pause.request(True)

        def at_each(task: TaskView) -> None:
            if task.phase is RunPhase.PROGRAM and task.number == 1 and not task.pause_wanted:
                pause.request(True)
            if task.phase is RunPhase.PROGRAM and task.number == 2:
                with pytest.raises(RequestRejectedError, match="no run of the same order follows"):
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
                with pytest.raises(RequestRejectedError, match="go on, or stop softly; legal now: stopping, off"):
                    await parts.actuator.set_mode(mode, OPERATOR.name)
            pause.request(False)

        resumed = asyncio.create_task(goes_on())
        seen = await follow(parts, TWO, at_each)
        await resumed
        assert {task.part.title for task in seen.played(seen.run + 1) if task.part} == {"20 N"}
        second = [task.part for task in seen.played(seen.run + 1) if task.part]
        assert {(part.number, part.of) for part in second} == {(2, 2)}
        assert [end_of(database, seen.run + place) for place in (0, 1)] == [EndState.COMPLETED] * 2
        told_right(seen, seen.run + 1, recorded(database, seen.run + 1)["u_A"].size)

    try:
        stepped(database, load_parameters("ideal"), ordered)
    finally:
        database.close()
    assert {mode for mode, _ in waited} == {Mode.PRETENSION}


def test_an_order_that_is_aborted_in_its_pause_ends_there_with_what_it_has(tmp_path: Path) -> None:
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
            f"The order ended after run {seen.run}: it was stopped softly in its pause; 1 run was not begun."
            " Order it anew."
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
