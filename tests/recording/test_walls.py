"""Which walls a run keeps: those that stood in its samples, whenever that was told."""

from backend.models.run import MAX_WALL_CHANGES, StoredWall, build_stored_wall, find_wall_at, merge_wall_changes
from backend.realtime.commands import WallChanged
from backend.recording.recorder import ObstacleChanges
from backend.storage.database import Database
from plant.dynamics import Obstacle
from tests.recording.stand_in import Writer, new_run, recorder_of, stored_run

ABOVE, BELOW = Obstacle(1.0, 0.3, 2e4, 1.0), Obstacle(-1.0, -0.4, 5e3, 0.0)
DOWN = StoredWall(0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_run_keeps_what_stood_in_its_samples_and_the_next_one_what_stands(database: Database, writer: Writer) -> None:
    recorder = recorder_of(writer, database)
    first, second, third = (new_run(database).id for _ in range(3))
    recorder.on_event(WallChanged(100, 0, BELOW))
    recorder.on_event(WallChanged(200, 0, ABOVE))
    writer.write(500)  # of no run: what stood last stands when the first begins, at 500
    writer.write(700, run=first)
    recorder.drain()
    recorder.on_event(WallChanged(900, 0, None))  # told late: nothing of that second is stored yet
    recorder.on_event(WallChanged(1250, 0, BELOW))  # in the second run's samples, told while the first is recorded
    writer.write(600, run=second)
    recorder.drain()
    recorder.on_event(WallChanged(1850, 0, None))  # between the second and the third
    writer.write(100)
    writer.write(2500, run=third)
    recorder.drain()
    recorder.on_event(WallChanged(2950, 0, ABOVE))  # in a second that is stored already: told too late, and kept
    writer.write(1100, run=third)
    writer.write(1)
    recorder.drain()
    kept = [stored_run(database, run).set_to.walls for run in (first, second, third)]
    assert kept[0] == (build_stored_wall(0.0, ABOVE), build_stored_wall(0.4, None))
    assert kept[1] == (build_stored_wall(0.05, BELOW),)
    assert kept[2] == (build_stored_wall(1.05, ABOVE),)


def test_a_run_without_walls_and_one_of_a_new_loop_keep_none(database: Database, writer: Writer) -> None:
    recorder = recorder_of(writer, database)
    first, second = new_run(database).id, new_run(database).id
    writer.write(300, run=first)
    writer.write(1)
    recorder.on_event(WallChanged(301, 0, ABOVE))
    recorder.drain()
    assert stored_run(database, first).set_to.walls is None
    assert "walls" not in stored_run(database, first).settings
    recorder.follow(writer.ring)  # another process: nothing stands in its plant's way
    recorder._position = writer.ring.count
    recorder._drain()
    recorder._position = writer.ring.count
    writer.write(300, run=second)
    writer.write(1)
    recorder.drain()
    assert stored_run(database, second).set_to.walls is None


def test_what_stands_at_a_moment() -> None:
    changes = merge_wall_changes(
        [build_stored_wall(0.5, ABOVE), build_stored_wall(0.2, BELOW)],
        [build_stored_wall(0.9, None), build_stored_wall(0.5, BELOW)],
    )
    assert [find_wall_at(changes, t) for t in (0.1, 0.2, 0.5, 0.899, 0.9, 5.0)] == [
        None,
        BELOW,
        BELOW,
        BELOW,
        None,
        None,
    ]
    many = merge_wall_changes((), [build_stored_wall(float(t), ABOVE) for t in range(MAX_WALL_CHANGES + 10)])
    assert len(many) == MAX_WALL_CHANGES
    assert find_wall_at(many, MAX_WALL_CHANGES - 2.0) == ABOVE
    assert find_wall_at(many, MAX_WALL_CHANGES + 5.0) is None


def test_many_changes_before_a_run_leave_the_last() -> None:
    walls = ObstacleChanges()
    for tick in range(12_000):
        walls.add(WallChanged(tick, 0, ABOVE if tick % 2 else None))
    walls.begin(20_000)
    assert walls.until(21_000) == [build_stored_wall(0.0, ABOVE)]
    walls.discard_until(21_000)
    assert walls.until(22_000) == []
