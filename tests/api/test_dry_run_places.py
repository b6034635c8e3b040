"""A place for a dry run comes back whatever becomes of it."""

import asyncio
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from backend.auth.authentication import BEARER, User
from backend.errors import RequestRejectedError
from backend.execution.progress import RunPhase
from backend.execution.runner import RunRequest
from backend.execution.simulation import _ProgressFile
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.schemas.session import Role
from backend.services.queue import DryRuns
from backend.workers import WorkerProcess
from plant.parameters import load_parameters

OTHER = User("another", Role.VIEWER, BEARER)
VIEWER = User("viewer", Role.VIEWER, BEARER)


def test_one_that_finds_no_room_on_the_disk_gives_its_place_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    order = RunRequest(build_ready_plan("tracking"), LoopSettings(), VIEWER.name)

    async def whole() -> None:
        dry_runs = DryRuns(WorkerProcess(lambda _cause: None))
        for _ in range(3):  # a place that was kept would be refused as the person's second
            with pytest.raises(FileNotFoundError):
                await dry_runs.play(load_parameters("ideal"), order, (), VIEWER, stays)

    asyncio.run(whole())


class Halfway(WorkerProcess):
    """Work in a process that has played 3 s of an experiment and goes on."""

    async def run(self, work: Callable[..., Any], *arguments: Any, **_none: Any) -> Any:
        folder = arguments[-1]
        progress = _ProgressFile(folder)
        progress(RunPhase.PROGRAM, 3.0)
        await asyncio.Event().wait()


def test_progress_is_that_of_ones_own_until_one_leaves() -> None:
    order = RunRequest(build_ready_plan("tracking"), LoopSettings(), VIEWER.name)
    left = asyncio.Event()

    async def is_disconnected() -> bool:
        return left.is_set()

    async def whole() -> None:
        dry_runs = DryRuns(Halfway(lambda _cause: None))
        assert not (await dry_runs.progress(VIEWER)).under_way
        playing = asyncio.ensure_future(dry_runs.play(load_parameters("ideal"), order, (), VIEWER, is_disconnected))
        while (told := await dry_runs.progress(VIEWER)).doing is not RunPhase.PROGRAM:
            await asyncio.sleep(0.01)
        assert (told.under_way, told.played_s) == (True, 3.0)
        assert told.duration_s == order.plan.program().duration_s
        assert not (await dry_runs.progress(OTHER)).under_way
        left.set()
        with pytest.raises(RequestRejectedError):
            await playing
        assert not (await dry_runs.progress(VIEWER)).under_way

    asyncio.run(whole())


async def stays() -> bool:
    return False
