"""A wall in the simulated joint's way: ordered in flight, shown, taken away, refused where nothing is simulated."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from backend.errors import OutOfRangeError, RequestRejectedError
from backend.realtime.commands import RunProgram
from backend.realtime.program import Law, Program, Segment
from backend.sample import INDEX
from backend.schemas.state import WallOrder, WallView
from backend.services.actuator import set_obstacle
from backend.storage import events
from backend.storage.database import Database, open_database
from plant.dynamics import Obstacle
from plant.interface import PlantChoice, PlantKind
from plant.parameters import load_parameters
from plant.quantity import Angle
from tests.api.conftest import problem, wait_for
from tests.api.stepped_service import Parts, stepped
from tests.api.test_push import in_run
from tests.cli.test_report import sinew
from tests.e2e.service import Service

UP = WallOrder(wall=WallView(q_wall=0.05))


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = open_database(tmp_path)
    yield database
    database.close()


def pressed(parts: Parts) -> float:
    row = parts.supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX["F_wall"]])


def test_it_is_put_up_in_flight_shown_noted_and_taken_away(database: Database) -> None:
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
        with pytest.raises(RequestRejectedError, match=r"in a wall at 0\.05\srad: bring it below that first"):
            await set_obstacle(parts.actuator, UP, "Ana")
        assert parts.live_state.wall is None

    stepped(database, load_parameters("ideal"), session)
    with database.reading() as session_of_database:
        told = [event.text for event in events.find(session_of_database)]
    assert f"wall above {Angle(0.05)}, 2e+04 N/m, 1 s/m" in told
    assert "no wall" in told


def test_a_programs_wall_is_shown_while_it_stands_and_the_operators_after_it(database: Database) -> None:
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

    stepped(database, load_parameters("ideal"), session)


def test_it_is_bounded_and_refused_where_nothing_is_simulated(database: Database) -> None:
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
            with pytest.raises(OutOfRangeError) as refused:
                await set_obstacle(parts.actuator, WallOrder(wall=wall), "Ana")
            assert refused.value.path == ("wall", quantity)
        for kind in (PlantKind.REPLAY, PlantKind.RIG):
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            offered = parts.state().limits
            assert (offered.k_wall_min, offered.k_wall_max, offered.c_wall_max) == (0.0, 0.0, 0.0)
            for order in (UP, WallOrder(wall=None)):
                with pytest.raises(RequestRejectedError, match=f"what is simulated, and what is driven is the {kind}"):
                    await set_obstacle(parts.actuator, order, "Ana")

    stepped(database, load_parameters("ideal"), session)


@pytest.mark.live
def test_over_http_and_from_the_command_line(service: Service, running: httpx.Client) -> None:
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
    assert "a wall stands below -22.9183°" in below.stdout
    assert "is no number" in sinew("wall", "up", "far", folder=service.data).stderr
    down = sinew("wall", "down", folder=service.data)
    assert "no wall stands in the joint's way" in down.stdout
    assert wait_for(running, "wall", None)["wall"] is None
