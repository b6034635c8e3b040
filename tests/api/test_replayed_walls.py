"""Replays draw the wall that stood: beside the force that the recording has of it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from backend.realtime.commands import RunEnded, RunProgram
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from backend.recording.reader import read_samples
from backend.scene.model import Pose, SceneMirror
from backend.schemas.state import WallOrder, WallView
from backend.schemas.tuning import TuningRequest
from backend.services.actuator import set_obstacle
from backend.services.runs import ReplayView
from backend.storage.database import Database, open_database
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from tests.api.stepped_service import Parts, stepped
from tests.api.test_push import in_run
from tests.recording.stand_in import new_run

LAB = load_parameters("lab")
WHO = "Ana"


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


class Drawn:
    """Stands in for the stage: what was drawn last."""

    def __init__(self) -> None:
        self.wall: Obstacle | None = None
        self.pose: Pose | None = None

    def show_wall(self, wall: Obstacle | None) -> None:
        self.wall = wall

    def show(self, pose: Pose) -> None:
        self.pose = pose


def drawn_at(replay: ReplayView, run: int, moments: list[float]) -> list[tuple[Obstacle | None, bool]]:
    """Return for each moment [s] the wall in the replay's 3D view, and whether it is drawn pressed."""
    mirror, stage, drawn = SceneMirror(LAB, replay.get_row, replay.get_wall), Drawn(), []
    for t in moments:
        replay.show(run, t)
        mirror._step(stage)  # type: ignore[arg-type]  # it has what is asked of a stage
        assert stage.pose is not None
        drawn.append((stage.wall, stage.pose.pressed))
    return drawn


def agrees(database: Database, run: int, walls: list[Obstacle | None]) -> None:
    """The wall in the view is one after the other of ``walls``, and bears all the force that was recorded."""
    with database.reading() as session:
        samples = read_samples(session, run, ("F_wall", "q"))
    F_wall, q = samples.columns["F_wall"], samples.columns["q"]
    # beside the ticks in which a program changes its wall: what these read of it is still the one before
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
            # as deep as its stiffness lets that force: a count of the encoder and the damping on top
            assert wall.side * (q[k] - wall.q_wall) == pytest.approx(abs(F_wall[k]) / (wall.k_wall * 0.075), abs=2e-3)
    assert pressed > 20


def test_walls_put_up_in_flight(database: Database) -> None:
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
    # what stood when the run began stands in it from its first sample on
    assert drawn_at(ReplayView(database), runs[1], [0.0, 1.0]) == [(up, False), (up, False)]


def test_walls_of_a_program_and_a_run_that_keeps_none(database: Database) -> None:
    first, second = Obstacle(1.0, 0.3, 2e4, 1.0), Obstacle(-1.0, -0.25, 1e4, 0.5)
    runs: list[int] = []

    async def session(parts: Parts) -> None:
        await in_run(parts)
        # The joint meets the walls at speed, so that few samples read a force near that of a contact in the view.
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
