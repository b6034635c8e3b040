"""A PostgreSQL server for tests: the machine's programs, a folder of its own, reachable through a socket there only."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import NullPool, create_engine, text


@contextmanager
def postgres_server() -> Iterator[str]:
    """Yield the URL of a server's database ``postgres``; skip the test where PostgreSQL is not installed."""
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
        try:
            yield f"postgresql+psycopg://sinew@/postgres?host={folder}"
        finally:
            control("stop", "-m", "immediate")


def new_database(server: str, name: str) -> str:
    """Make an empty database, in the place of one of that name, and return its URL."""
    with create_engine(server, isolation_level="AUTOCOMMIT", poolclass=NullPool).connect() as connection:
        connection.execute(text(f"DROP DATABASE IF EXISTS {name}"))
        connection.execute(text(f"CREATE DATABASE {name}"))
    return server.replace("/postgres?", f"/{name}?")
