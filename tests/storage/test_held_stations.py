"""One service works for a station, and another may as soon as it does not, however it ended."""

import pytest
from sqlalchemy import Connection, NullPool, create_engine, text

from backend.storage.stations import HeldStation, StationTakenError


def test_one_service_for_each_station_of_a_server(postgres: str) -> None:
    engines = [create_engine(postgres, poolclass=NullPool) for _ in range(3)]
    first, other = HeldStation(engines[0], "rig-a"), HeldStation(engines[1], "rig-b")
    with pytest.raises(StationTakenError, match="another service works on this database as station rig-a"):
        HeldStation(engines[2], "rig-a")
    first.release()
    HeldStation(engines[2], "rig-a").release()
    other.release()


def test_a_station_is_free_before_its_connection_has_ended(postgres: str) -> None:
    engine, other = (create_engine(postgres) for _ in range(2))
    held = HeldStation(engine, "rig-a")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Connection, "invalidate", lambda self: None)
        patch.setattr(Connection, "close", lambda self: None)
        held.release()
    HeldStation(other, "rig-a").release()
    engine.dispose()
    other.dispose()


def test_a_lock_of_a_service_that_was_killed_is_let_go(postgres: str) -> None:
    engine, other = (create_engine(postgres) for _ in range(2))
    held = HeldStation(engine, "rig-a")
    with other.connect() as connection:
        connection.execute(text("SELECT pg_terminate_backend(pid, 5000) FROM pg_locks WHERE locktype = 'advisory'"))
    HeldStation(other, "rig-a").release()
    held.release()
    engine.dispose()
    other.dispose()
