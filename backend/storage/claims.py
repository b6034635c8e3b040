"""Claim of a service on its database, with a heartbeat, for any path or URL.

The lock of a data folder does not protect a database elsewhere, and the lock of a database server ends with a
connection. A service therefore writes its identity into the database, and counts a heartbeat every second. A process
that finds a claim asks the kernel whether the claiming process is alive, if both see the same processes; otherwise
(another machine, a container) it waits for a heartbeat. No clocks are compared.
"""

import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, Engine, insert, text
from sqlalchemy.exc import SQLAlchemyError

from backend import __version__
from backend.storage import messages
from backend.storage.orm import SettingRow
from backend.storage.stations import StationTakenError

HEARTBEAT_S = 1.0
"""Period of the heartbeat [s]."""

LIFE_S = 10.0
"""Time without a heartbeat after which a claim is void [s]; the write lock of another program may delay one by 5 s."""

_POLL_S = 0.1
_SETTING = "service_claim"
_PROC = Path("/proc")


@dataclass(frozen=True)
class Claim:
    """Service that uses a database: key, version, host, and process.

    ``process`` and ``began`` identify the process as the kernel of ``seen_by`` counts.
    """

    key: str
    version: str
    host: str
    process: int
    began: str
    seen_by: str
    beat: int = 0

    @property
    def describe(self) -> str:
        """Description of the service for people."""
        return messages.service_of_claim(version=self.version, process=self.process, host=self.host)


def own_claim() -> Claim:
    """Return the claim of this process."""
    me = os.getpid()
    return Claim(
        key=secrets.token_hex(8),
        version=__version__,
        host=socket.gethostname(),
        process=me,
        began=_began(me),
        seen_by=_seen_by(),
    )


class HeldClaim:
    """The claim of this service.

    ``run`` renews it in a thread; ``problem`` says why it is lost, "" while held.
    """

    def __init__(self, engine: Engine, station: str) -> None:
        """Claim the database for a station.

        Raises StationTakenError while another service has it.
        """
        self._engine, self._station, self._claim = engine, station, own_claim()
        self._over, self._problem = threading.Event(), ""
        found = _read_claim(engine, station)
        if found is not None and is_alive(engine, station, found):
            raise StationTakenError(station, found.describe)
        with engine.begin() as connection:
            now = _load_claim(connection, station)
            if now is not None and now != found:
                raise StationTakenError(station, now.describe)
            _write(connection, station, self._claim)

    def problem(self) -> str:
        """Return why the claim is lost, "" while it is held."""
        return self._problem

    def run(self) -> None:
        """Count a heartbeat once a second until ``end``; a failed one is retried."""
        while not self._over.wait(HEARTBEAT_S):
            with suppress(SQLAlchemyError):  # a database that cannot be written is reported by the writers of data
                self.renew()

    def end(self) -> None:
        """End ``run``."""
        self._over.set()

    def renew(self) -> None:
        """Count a heartbeat, or record that another service has the claim."""
        with self._engine.begin() as connection:
            now = _load_claim(connection, self._station)
            if now is None or now.key != self._claim.key:
                by = "another service" if now is None else now.describe
                self._problem = messages.claim_lost(service=by, life_s=LIFE_S)
                return
            self._claim = replace(self._claim, beat=self._claim.beat + 1)
            _write(connection, self._station, self._claim)

    def release(self) -> None:
        """Release the claim if it is still held."""
        self.end()
        with suppress(SQLAlchemyError), self._engine.begin() as connection:
            now = _load_claim(connection, self._station)
            if now is not None and now.key == self._claim.key:
                _delete(connection, self._station)


def describe_claim(engine: Engine) -> str:
    """Return the description of the service that uses a database, "" for none.

    Of any schema and any station.
    """
    try:
        with engine.connect() as connection:
            rows = connection.execute(text("SELECT station, value FROM setting WHERE name = :name"), {"name": _SETTING})
            found = [(str(station), _parse_claim(value)) for station, value in rows]
    except SQLAlchemyError:  # of a schema before stations, which no service has claimed
        return ""
    alive = (claim for station, claim in found if claim is not None and is_alive(engine, station, claim))
    return next((claim.describe for claim in alive), "")


def is_alive(engine: Engine, station: str, claim: Claim) -> bool:
    """Return whether the service of a claim is alive.

    At once if its process is visible, else after at most LIFE_S.
    """
    if claim.seen_by and claim.seen_by == _seen_by():
        return _began(claim.process) == claim.began
    end = time.monotonic() + LIFE_S
    while time.monotonic() < end:
        now = _read_claim(engine, station)
        if now is None:
            return False
        if now != claim:
            return True
        time.sleep(_POLL_S)
    return False


def _read_claim(engine: Engine, station: str) -> Claim | None:
    with engine.connect() as connection:
        return _load_claim(connection, station)


def _load_claim(connection: Connection, station: str) -> Claim | None:
    of_station = {"name": _SETTING, "station": station}
    found = connection.scalar(text("SELECT value FROM setting WHERE name = :name AND station = :station"), of_station)
    return _parse_claim(found)


def _parse_claim(value: object) -> Claim | None:
    """Return the claim of a row; None if it is invalid, so that it blocks nobody."""
    with suppress(TypeError, ValueError):
        document = json.loads(value) if isinstance(value, str) else value
        if isinstance(document, Mapping):
            return Claim(**document)
    return None


def _write(connection: Connection, station: str, claim: Claim) -> None:
    _delete(connection, station)
    row = {"name": _SETTING, "station": station, "who": "service", "value": asdict(claim), "at": datetime.now(UTC)}
    connection.execute(insert(SettingRow).values(row))


def _delete(connection: Connection, station: str) -> None:
    of_station = {"name": _SETTING, "station": station}
    connection.execute(text("DELETE FROM setting WHERE name = :name AND station = :station"), of_station)


def _seen_by() -> str:
    """Return the kernel and its process namespace, which give a process id a meaning.

    "" if unknown.
    """
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {os.readlink(_PROC / 'self/ns/pid')}"
    except OSError:
        return ""


def _began(process: int) -> str:
    """Return the start of a process in ticks since boot; "" if there is none."""
    try:
        stat = (_PROC / str(process) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    state, *rest = stat[stat.rindex(")") + 2 :].split()
    return "" if state == "Z" else rest[18]
