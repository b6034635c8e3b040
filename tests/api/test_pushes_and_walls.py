"""Simulated pushes and obstacles, through the service and in replays."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest

from backend.auth.authentication import User
from backend.auth.control_lease import LOST_S, POLL_S, ControlLease, ControlReleased
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.experiments.library import experiments_by_name
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import RunEnded, RunProgram
from backend.realtime.messages import (
    plant_without_obstacles,
    plant_without_push,
    plant_without_shaft_load,
    push_not_in_mode,
)
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from backend.recording.reader import read_samples
from backend.sample import INDEX
from backend.scene.model import Pose, SceneMirror
from backend.schemas.session import Role
from backend.schemas.state import PushRequest, WallOrder, WallView
from backend.schemas.tuning import TuningRequest
from backend.services import messages
from backend.services.actuator import set_obstacle
from backend.services.jobs import list_experiment_kinds
from backend.services.runs import ReplayView
from backend.storage import events
from backend.storage.database import Database, open_database
from plant.dynamics import Obstacle
from plant.interface import PlantChoice, PlantKind
from plant.parameters import load_parameters
from plant.quantity import Angle
from tests.api.conftest import problem, wait_for
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.cli.test_report import sinew
from tests.e2e.service import Service
from tests.recording.stand_in import new_run
from tests.refusals import refused

# A push on the joint by command: on a simulated plant only, and released when control is lost.

ANA = User("Ana", Role.OPERATOR, "a")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


async def in_run(parts: Parts) -> None:
    await parts.actuator.set_mode(Mode.PRETENSION, OPERATOR.name)
    await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
    await parts.actuator.set_mode(Mode.RUN, OPERATOR.name)


def applied_push(parts: Parts) -> float:
    row = parts.supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX["F_push"]])


def test_a_push_ends_as_soon_as_the_page_is_silent(database: Database) -> None:
    async def lost(parts: Parts) -> None:
        await in_run(parts)
        now = 100.0
        control = ControlLease(
            parts.events, parts.actuator.stop_after_operator_loss, parts.actuator.log_control_change, lambda: now
        )
        parts.events.subscribe(ControlReleased, lambda _: parts.actuator.release_push())
        control.take(ANA, is_page=True)
        await parts.actuator.push(PushRequest(F_push=6.0, duration_s=10.0), ANA.name)
        for _ in range(round((LOST_S + 3 * POLL_S) / POLL_S)):
            assert applied_push(parts) in (0.0, 6.0)
            now += POLL_S
            await control.check()
            await parts.supervisor.advance(0.01)
        assert parts.live_state.mode is Mode.RUN  # long before the soft stop
        for _ in range(100):
            await parts.supervisor.advance(0.01)
            if applied_push(parts) == 0.0:
                break
        assert applied_push(parts) == 0.0

    stepped(database, load_parameters("ideal"), lost)
    with database.reading() as session:
        texts = [event.text for event in events.find(session)]
    assert messages.push_started(F_push=6.0, duration_s=10.0) in texts
    assert messages.push_without_operator() in texts


def test_experiments_with_pushes_are_offered_on_simulated_plants_only(database: Database) -> None:
    async def offered(parts: Parts) -> None:
        def why_not(kind: PlantKind) -> dict[str, str]:
            tuning, offers = parts.live_state.tuning.view(0.0), experiments_by_name().values()
            return {one.name: one.why_not for one in list_experiment_kinds(offers, LoopSettings(), tuning, kind)}

        assert set(why_not(PlantKind.VIRTUAL_CARD).values()) == set(why_not(PlantKind.SIMULATOR).values()) == {""}
        for kind in (PlantKind.RIG, PlantKind.REPLAY):
            reasons = why_not(kind)
            assert reasons["compliance"] == plant_without_push()
            assert reasons["robustness"] == plant_without_shaft_load()
            assert reasons["impact"] == plant_without_obstacles()
            beyond = {"compliance", "robustness", "disturbance_battery", "impact"}
            assert {name for name, why in reasons.items() if why} == beyond

    stepped(database, load_parameters("ideal"), offered)


def test_a_push_is_bounded_and_rejected_on_other_plants(database: Database) -> None:
    async def not_possible(parts: Parts) -> None:
        reason = push_not_in_mode(mode=Mode.OFF, push_modes=(Mode.RUN, Mode.COMPLIANCE))
        with pytest.raises(RequestRejectedError, match=re.escape(reason)):
            await parts.actuator.push(PushRequest(F_push=5.0), OPERATOR.name)
        await in_run(parts)
        for push, quantity in (
            (PushRequest(F_push=31.0), "F_push"),
            (PushRequest(F_push=5.0, duration_s=11.0), "duration_s"),
        ):
            with pytest.raises(OutOfRangeError) as refused_value:
                await parts.actuator.push(push, OPERATOR.name)
            assert refused_value.value.quantity == quantity
        assert parts.state().limits.F_push_max == 30.0
        for kind, is_rig in ((PlantKind.REPLAY, False), (PlantKind.RIG, True)):
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            with refused(RequestRejectedError, "push_needs_simulated_plant", plant=kind, is_rig=is_rig):
                await parts.actuator.push(PushRequest(F_push=5.0), OPERATOR.name)
        assert parts.state().limits.F_push_max == 0.0
        await parts.supervisor.advance(0.01)
        assert applied_push(parts) == 0.0

    stepped(database, load_parameters("ideal"), not_possible)


# An obstacle for the simulated joint: set during operation, shown, removed, rejected without a simulation.

UP = WallOrder(wall=WallView(q_wall=0.05))


@pytest.fixture
def database_wall(tmp_path: Path) -> Iterator[Database]:
    database = open_database(tmp_path)
    yield database
    database.close()


def pressed(parts: Parts) -> float:
    row = parts.supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX["F_wall"]])


def test_an_obstacle_is_set_shown_logged_and_removed_during_operation(database_wall: Database) -> None:
    async def session(parts: Parts) -> None:
        await in_run(parts)
        assert parts.state().wall is None
        assert await set_obstacle(parts.actuator, UP, "Ana") == UP
        assert parts.live_state.wall == Obstacle(1.0, 0.05, 20000.0, 1.0)
        assert parts.state().wall == UP.wall
        await parts.actuator.set_references(0.08, 10.0, "Ana")
        await parts.supervisor.advance(1.5)
        assert pressed(parts) < -1.0
        await set_obstacle(parts.actuator, WallOrder(wall=None), "Ana")
        await parts.supervisor.advance(0.2)
        assert (pressed(parts), parts.state().wall) == (0.0, None)
        with pytest.raises(RequestRejectedError, match=r"at 0\.05\srad: move it below that angle first"):
            await set_obstacle(parts.actuator, UP, "Ana")
        assert parts.live_state.wall is None

    stepped(database_wall, load_parameters("ideal"), session)
    with database_wall.reading() as session_of_database:
        texts = [event.text for event in events.find(session_of_database)]
    assert f"obstacle above {Angle(0.05)}, 2e+04 N/m, 1 s/m" in texts
    assert "no obstacle" in texts


def test_the_obstacle_of_a_program_replaces_that_of_the_operator_temporarily(database_wall: Database) -> None:
    async def session(parts: Parts) -> None:
        await in_run(parts)
        below = WallView(q_wall=-0.5, side="below", k_wall=1e4, c_wall=0.0)
        await set_obstacle(parts.actuator, WallOrder(wall=below), "Ana")
        walls = (Obstacle(1.0, 0.3, 2e4, 1.0),)
        segments = (Segment(0.2, 0.0, 10.0), Segment(0.3, 0.0, 10.0, wall=1))
        await parts.supervisor.send(RunProgram(Program(Law.CASCADE, segments, walls=walls)))
        seen = []
        for _ in range(80):
            await parts.supervisor.advance(0.01)
            seen.append(parts.state().wall)
        above = WallView(q_wall=0.3)
        assert [wall for n, wall in enumerate(seen) if n == 0 or seen[n - 1] != wall] == [below, above, below]

    stepped(database_wall, load_parameters("ideal"), session)


def test_an_obstacle_is_bounded_and_rejected_without_a_simulation(database_wall: Database) -> None:
    async def session(parts: Parts) -> None:
        limits = parts.state().limits
        await in_run(parts)
        for k_wall, c_wall in ((limits.k_wall_min, 0.0), (limits.k_wall_max, limits.c_wall_max)):
            await set_obstacle(
                parts.actuator, WallOrder(wall=WallView(q_wall=1.0, k_wall=k_wall, c_wall=c_wall)), "Ana"
            )
        for wall, quantity in (
            (WallView(q_wall=2.0), "q_wall"),
            (WallView(q_wall=0.5, k_wall=4e4), "k_wall"),
            (WallView(q_wall=0.5, k_wall=1.0), "k_wall"),
            (WallView(q_wall=0.5, k_wall=1.001 * limits.k_wall_max), "k_wall"),
            (WallView(q_wall=0.5, c_wall=1.001 * limits.c_wall_max), "c_wall"),
            (WallView(q_wall=0.5, c_wall=-1.0), "c_wall"),
        ):
            with pytest.raises(OutOfRangeError) as out_of_range:
                await set_obstacle(parts.actuator, WallOrder(wall=wall), "Ana")
            assert out_of_range.value.path == ("wall", quantity)
        for kind in (PlantKind.REPLAY, PlantKind.RIG):
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            offered = parts.state().limits
            assert (offered.k_wall_min, offered.k_wall_max, offered.c_wall_max) == (0.0, 0.0, 0.0)
            for order in (UP, WallOrder(wall=None)):
                with refused(RequestRejectedError, "obstacle_needs_simulated_plant", plant=kind):
                    await set_obstacle(parts.actuator, order, "Ana")

    stepped(database_wall, load_parameters("ideal"), session)


@pytest.mark.live
def test_obstacles_are_set_over_http_and_from_the_command_line(service: Service, running: httpx.Client) -> None:
    order = {"wall": {"q_wall": 0.9, "side": "above", "k_wall": 10000.0, "c_wall": 2.0}}
    assert running.put("/api/wall", json=order).json() == order
    assert wait_for(running, "wall", order["wall"])
    refused = running.put("/api/wall", json={"wall": {"q_wall": 0.9, "k_wall": 1e9}})
    assert (refused.status_code, problem(refused)["unit"]) == (422, "N/m")
    up = sinew("wall", "up", "60deg", "--stiffness", "5000", "--json", folder=service.data)
    assert json.loads(up.stdout)["wall"] == {
        "q_wall": pytest.approx(1.0472, abs=1e-4),
        "side": "above",
        "k_wall": 5000.0,
        "c_wall": 1.0,
    }
    below = sinew("wall", "up", "-0.4", "--below", folder=service.data)
    assert "obstacle below -22.9183°" in below.stdout
    assert "is not a number" in sinew("wall", "up", "far", folder=service.data).stderr
    down = sinew("wall", "down", folder=service.data)
    assert "no obstacle" in down.stdout
    assert wait_for(running, "wall", None)["wall"] is None


# Replays draw the obstacle at the time of its recorded force.

LAB = load_parameters("lab")
WHO = "Ana"


class StageStub:
    """Replaces the 3D view: stores the last drawn obstacle."""

    def __init__(self) -> None:
        self.wall: Obstacle | None = None
        self.pose: Pose | None = None

    def show_wall(self, wall: Obstacle | None) -> None:
        self.wall = wall

    def show(self, pose: Pose) -> None:
        self.pose = pose


def drawn_at(replay: ReplayView, run: int, moments: list[float]) -> list[tuple[Obstacle | None, bool]]:
    """Return for each moment [s] the obstacle in the replay's 3D view, and whether it is drawn pressed."""
    mirror, stage, drawn = SceneMirror(LAB, replay.get_row, replay.get_wall), StageStub(), []
    for t in moments:
        replay.show(run, t)
        mirror._step(stage)  # type: ignore[arg-type]  # it has what is asked of a stage
        assert stage.pose is not None
        drawn.append((stage.wall, stage.pose.pressed))
    return drawn


def agrees(database: Database, run: int, walls: list[Obstacle | None]) -> None:
    """Check that the view draws one of ``walls`` after the other with the recorded force."""
    with database.reading() as session:
        samples = read_samples(session, run, ("F_wall", "q"))
    F_wall, q = samples.columns["F_wall"], samples.columns["q"]
    # except ticks in which a program changes its obstacle: the view still has the previous one
    every = list(range(7, len(samples.t), 20))
    drawn = drawn_at(ReplayView(database), run, [float(samples.t[k]) for k in every])
    assert [wall for n, (wall, _) in enumerate(drawn) if n == 0 or drawn[n - 1][0] != wall] == walls
    pressed = 0
    for k, (wall, is_pressed) in zip(every, drawn, strict=True):
        assert is_pressed == (abs(F_wall[k]) >= 0.1)
        if F_wall[k] != 0.0:
            pressed += 1
            assert wall is not None
            assert np.sign(F_wall[k]) == -wall.side
            # the depth at which its stiffness gives that force: plus a count of the encoder and the damping
            assert wall.side * (q[k] - wall.q_wall) == pytest.approx(abs(F_wall[k]) / (wall.k_wall * 0.075), abs=2e-3)
    assert pressed > 20


def test_replay_draws_obstacles_that_were_set_during_operation(database: Database) -> None:
    above, below = WallView(q_wall=0.3), WallView(q_wall=-0.2, side="below", k_wall=5000.0)
    runs: list[int] = []

    async def session(parts: Parts) -> None:
        await in_run(parts)
        run = parts.state().recording_run
        assert run is not None
        runs.append(run)
        await parts.supervisor.advance(0.1)
        for wall, q_ref in ((above, 0.4), (None, 0.0), (below, -0.3), (None, 0.0)):
            await set_obstacle(parts.actuator, WallOrder(wall=wall), WHO)
            await parts.actuator.set_references(q_ref, 10.0, WHO)
            await parts.supervisor.advance(2.0)
        await set_obstacle(parts.actuator, WallOrder(wall=above), WHO)
        await parts.actuator.set_mode(Mode.PRETENSION, WHO)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        await parts.actuator.set_mode(Mode.COMPLIANCE, WHO)
        second = parts.state().recording_run
        assert second is not None
        runs.append(second)
        await parts.supervisor.advance(1.5)

    stepped(database, LAB, session)
    up, down = Obstacle(1.0, 0.3, 20000.0, 1.0), Obstacle(-1.0, -0.2, 5000.0, 1.0)
    agrees(database, runs[0], [None, up, None, down, None])
    # an obstacle that exists at the start of the run is drawn from its first sample on
    assert drawn_at(ReplayView(database), runs[1], [0.0, 1.0]) == [(up, False), (up, False)]


def test_replay_draws_obstacles_of_a_program_and_none_without_records(database: Database) -> None:
    first, second = Obstacle(1.0, 0.3, 2e4, 1.0), Obstacle(-1.0, -0.25, 1e4, 0.5)
    runs: list[int] = []

    async def session(parts: Parts) -> None:
        await in_run(parts)
        # The joint meets the obstacles at speed, so that few samples have a force near the threshold of the view.
        await parts.actuator.tuning_service.apply(TuningRequest(motion="time-optimal"), WHO)
        bare = parts.state().recording_run
        assert bare is not None
        runs.append(bare)
        await parts.supervisor.advance(0.5)
        runs.append(new_run(database).id)
        ended: list[RunEnded] = []
        parts.supervisor.listen(lambda event: ended.append(event) if isinstance(event, RunEnded) else None)
        segments = (
            Segment(0.5, 0.0, 10.0),
            Segment(2.0, 0.35, 10.0, wall=1),
            Segment(1.0, 0.0, 10.0, wall=2),
            Segment(2.0, -0.3, 10.0, wall=3),
            Segment(1.0, 0.0, 10.0, wall=2),
        )
        await parts.supervisor.send(RunProgram(Program(Law.CASCADE, segments, walls=(first, None, second)), runs[-1]))
        await parts.supervisor.advance_until(lambda: any(event.run == runs[-1] for event in ended), 20.0)
        await parts.supervisor.advance(0.5)

    stepped(database, LAB, session)
    agrees(database, runs[1], [None, first, None, second, None])
    assert {wall for wall, _ in drawn_at(ReplayView(database), runs[0], [0.0, 0.2, 0.4])} == {None}
