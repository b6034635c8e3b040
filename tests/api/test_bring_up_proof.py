"""What a bring-up keeps is kept whole."""

import asyncio
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.api.bring_up import BringUp
from backend.api.errors import ApiError
from backend.bring_up import standing
from backend.bring_up.steps import StepId
from backend.storage import open_database
from plant.choice import PlantChoice, PlantKind
from plant.parameters import load_parameters
from tests.api.stepped_service import Parts, stepped

IDEAL = load_parameters("ideal")


def test_a_step_whose_result_is_being_kept_is_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a person nor the end of the service gives it up any more: the loop may be starting anew with it."""
    database = open_database(tmp_path)
    let_go, keep = threading.Event(), standing.keep

    def slowly(*arguments: Any) -> standing.StepResult:
        assert let_go.wait(60.0)
        return keep(*arguments)

    async def work(parts: Parts) -> None:
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(PlantKind.VIRTUAL_CARD))
        bring_up = BringUp(parts.bench, parts.supervisor, database, IDEAL)
        await bring_up.start(StepId.WIRING_TEST, {}, "Ada")  # it fails: a simulator has no drives to take away
        while (running := (await bring_up.view()).steps[0].running) and running.phase != "keeping the result":
            await asyncio.sleep(0.0)
        with pytest.raises(ApiError, match="Wiring test is over, and its result is being kept"):
            await bring_up.cancel()
        closing_down = asyncio.create_task(bring_up.close())
        await asyncio.sleep(0.0)
        let_go.set()
        await closing_down
        assert standing.newest(database)[StepId.WIRING_TEST].who == "Ada"

    monkeypatch.setattr(standing, "keep", slowly)
    try:
        stepped(database, IDEAL, work)
    finally:
        let_go.set()
        database.close()
