"""What a bring-up keeps belongs to the wiring that the loop drove, and is kept whole."""

import asyncio
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import plant
from backend.api.bring_up import BringUp
from backend.api.errors import ApiError
from backend.bring_up import standing
from backend.bring_up.steps import StepId
from backend.bring_up.work import Finding
from backend.loop.supervisor import Supervisor
from backend.storage import open_database
from plant.choice import PlantChoice, PlantKind
from plant.parameters import load_parameters
from plant.wiring import load_wiring
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
        parts.bench.brought_up = standing.brought_up_of(database, parts.supervisor.setup.plant)
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


def test_a_changed_wiring_file_is_tried_by_no_step_and_starts_unproven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database, file = open_database(tmp_path), tmp_path / "rig.toml"
    said = (Path(plant.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")
    file.write_text(said, encoding="utf-8")
    for step in (StepId.WIRING_TEST, StepId.DIRECTION):
        standing.keep(database, step, load_wiring(str(file)), Finding(True, "well"), "Ada")
    started: list[bool] = []

    async def restart(supervisor: Supervisor) -> None:
        started.append(supervisor.setup.brought_up.directions_proven)

    async def work(parts: Parts) -> None:
        choice = PlantChoice(PlantKind.VIRTUAL_CARD, str(file))
        parts.bench.brought_up = standing.brought_up_of(database, choice)
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=choice, brought_up=parts.bench.brought_up)
        bring_up = BringUp(parts.bench, parts.supervisor, database, IDEAL)
        assert (await bring_up.view()).steps[0].blocked == ""
        parts.supervisor.dead = True
        await parts.bench.reset("Ada")
        file.write_text(said.replace("gain = { value = 1.0", "gain = { value = -1.0", 1), encoding="utf-8")
        parts.supervisor.dead = False
        assert "the wiring file has changed since the loop was started" in (await bring_up.view()).steps[0].blocked
        with pytest.raises(ApiError, match="the wiring file has changed since the loop was started"):
            await bring_up.start(StepId.WIRING_TEST, {}, "Ada")
        parts.supervisor.dead = True
        await parts.bench.reset("Ada")
        assert started == [True, False]
        parts.supervisor.dead = False
        assert (await bring_up.view()).steps[0].blocked == ""

    monkeypatch.setattr(Supervisor, "restart", restart)
    try:
        stepped(database, IDEAL, work)
    finally:
        database.close()
