import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import NullPool, create_engine, text

from backend.storage import Database, open_database


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """URL of a PostgreSQL server of our own, reachable through a socket in its folder only."""
    programs = [shutil.which("pg_ctl"), *map(str, Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))]
    pg_ctl = next((program for program in programs if program), None)
    if pg_ctl is None:
        pytest.skip("PostgreSQL is not installed")
    user = "nobody" if os.geteuid() == 0 else None  # the server refuses to run as root
    with tempfile.TemporaryDirectory() as folder:
        if user is not None:
            shutil.chown(folder, user)

        def control(*arguments: str) -> None:
            command = [pg_ctl, "-D", f"{folder}/data", "-w", "-s", *arguments]
            subprocess.run(command, user=user, cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=60)

        control("initdb", "-o", "--auth=trust --username=sinew --no-sync")
        control("start", "-l", f"{folder}/log", "-o", f"-c listen_addresses='' -c fsync=off -k {folder}")
        yield f"postgresql+psycopg://sinew@/postgres?host={folder}"
        control("stop", "-m", "immediate")


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    """An empty database, on each of the two kinds in use."""
    url = None
    if request.param == "postgresql":
        server = request.getfixturevalue("postgres")
        name = f"test_{tmp_path.name.lower()}".translate({ord(c): "_" for c in "[]-"})[:60]
        with create_engine(server, isolation_level="AUTOCOMMIT", poolclass=NullPool).connect() as connection:
            connection.execute(text(f"DROP DATABASE IF EXISTS {name}"))
            connection.execute(text(f"CREATE DATABASE {name}"))
        url = server.replace("/postgres?", f"/{name}?")
    opened = open_database(tmp_path, url)
    yield opened
    opened.close()


@pytest.fixture
def sqlite(tmp_path: Path) -> Iterator[Database]:
    """An empty SQLite database in ``tmp_path``."""
    opened = open_database(tmp_path)
    yield opened
    opened.close()
