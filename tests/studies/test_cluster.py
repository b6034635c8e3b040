"""A study on a Dask cluster: an identical table, and no lost points if a worker is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from backend.storage.database import Database, open_database
from backend.studies.cluster import ClusterExecutor, use_cluster
from backend.studies.executor import ExecutorUnavailableError
from backend.studies.point import LOST, Point, StudyBase
from backend.studies.runner import run_study, use_local_processes
from tests.refusals import refused
from tests.studies import studying
from tests.studies.studying import begun, in_folder, table

pytest.importorskip("distributed")
ROOT = Path(__file__).parents[2]


class Cluster:
    """A scheduler and two workers, each in its own process."""

    def __init__(self, folder: Path, stack: ExitStack, **environment: str) -> None:
        self._folder, self._stack, self._environment = folder, stack, environment
        place = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place)
        )
        while not place.exists():
            time.sleep(0.02)
        while not (content := place.read_text()).endswith("}"):
            time.sleep(0.02)
        self.address = str(json.loads(content)["address"])
        self.workers = [self.worker(), self.worker()]

    def worker(self) -> subprocess.Popen[bytes]:
        alone = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self._folder))
        return self._start("worker", self.address, *alone)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **self._environment}
        command = [sys.executable, "-m", "dask", *words]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(tmp_path, stack)


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return open_database(tmp_path / "data")


def test_a_cluster_computes_the_same_table_bit_for_bit(database: Database, cluster: Cluster) -> None:
    here, there = begun(database), begun(database)
    assert run_study(database, here, use_local_processes(2))
    assert run_study(database, there, use_cluster(cluster.address))
    assert len(table(database, here)) == 16
    assert repr(table(database, here)) == repr(table(database, there))


def test_a_killed_cluster_worker_loses_no_points(database: Database, cluster: Cluster, tmp_path: Path) -> None:
    study = begun(database)

    class Losing(ClusterExecutor):
        def submit(self, point: Point) -> None:
            super().submit(point)
            if point.number == 5:  # from point 4 on they wait: both workers have a point
                cluster.workers[0].send_signal(signal.SIGKILL)
                cluster.workers[0].wait()
                (tmp_path / "go").touch()

    def losing(base: StudyBase) -> ClusterExecutor:
        return Losing(in_folder(base, tmp_path), cluster.address, studying.patient)

    assert run_study(database, study, losing)
    assert [(row.number, row.state) for row in table(database, study)] == [(n, "completed") for n in range(16)]


def test_a_point_that_kills_its_worker_is_reported_and_recomputed_on_request(
    database: Database, tmp_path: Path
) -> None:
    study = begun(database)
    with ExitStack() as stack:
        strict = Cluster(tmp_path, stack, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0")
        assert run_study(database, study, use_cluster(strict.address, studying.die_always))
        assert table(database, study)[5].state == LOST
        assert run_study(database, study, use_cluster(strict.address, studying.quick), again=True)
    assert {row.state for row in table(database, study)} == {"completed"}


def test_workers_of_another_version_do_not_change_the_table(database: Database, cluster: Cluster) -> None:
    study = begun(database)

    def other(base: StudyBase) -> ClusterExecutor:
        return ClusterExecutor(replace(base, software="99.0"), cluster.address)

    with pytest.raises(ExecutorUnavailableError) as caught:
        run_study(database, study, other)
    message = caught.value.message
    assert (message.code, message.values["error"]) == ("workers_cannot_compute", "OtherSoftwareError")
    assert "99.0" in str(message.values["reason"])
    assert table(database, study) == []


def test_a_missing_scheduler_is_reported(database: Database) -> None:
    with refused(ExecutorUnavailableError, "no_scheduler", address="tcp://127.0.0.1:1"):
        run_study(database, begun(database), use_cluster("tcp://127.0.0.1:1"))
