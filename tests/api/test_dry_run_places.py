"""A place for a dry run comes back whatever becomes of it."""

import asyncio
import tempfile
from pathlib import Path

import pytest

from backend.access.people import BEARER, Person
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.runner import Order
from backend.messages.session import Role
from backend.offload import Offload
from backend.operating.dry_runs import DryRuns
from plant.parameters import load_parameters

VIEWER = Person("viewer", Role.VIEWER, BEARER)


def test_one_that_finds_no_room_on_the_disk_gives_its_place_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    order = Order(ready_plan("tracking"), LoopSettings(), VIEWER.name)

    async def whole() -> None:
        dry_runs = DryRuns(Offload(lambda _cause: None))
        for _ in range(3):  # a place that was kept would be refused as the person's second
            with pytest.raises(FileNotFoundError):
                await dry_runs.play(load_parameters("ideal"), order, (), VIEWER, stays)

    asyncio.run(whole())


async def stays() -> bool:
    return False
