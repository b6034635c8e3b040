"""What a form shows is what it sends, what runs, what is stored and what the report says, whatever was before.

The form is filled here as the page fills it (``frontend/src/pages/experiments/order.ts``, whose own tests compare what
stands in its boxes with what it sends): each setting from the operator's tuning in force, else from its default.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.api.schemas.experiment import ExperimentRequest, SettingValue, SettingView
from backend.api.schemas.identification import ActuatorRequest, MotorRequest, SpringRequest
from backend.api.schemas.tuning import TuningRequest
from backend.experiments.tuning_choice import NAMES, TuningChoice
from backend.reports.build import build_report
from backend.reports.document import Table, exact
from backend.reports.source import load_source
from backend.storage import Database, banks, open_database, runs
from backend.storage.banks import BankEntry
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

IDEAL = load_parameters("ideal")
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}
WHO = OPERATOR.name
SHORT: dict[str, dict[str, SettingValue]] = {
    "tracking": {"q_duration_s": 0.5, "S_duration_s": 0.5},
    "compliance": {"profile": "steps", "pushes": 2, "hold_s": 0.5},
    "sequence": {"segments": json.dumps([{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}])},
}
STATES = ["fresh", "bank in force", "after an experiment", "after a restart"]
Form = dict[str, SettingValue]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def shown(settings: list[SettingView], parts: Parts) -> Form:
    """What stands in the boxes of a form before anybody has touched it."""
    state = parts.picture.state()
    tuning = state.own_tuning or state.tuning
    in_force = {name: getattr(tuning, name) for name in NAMES if name != "bank"}
    in_force["bank"] = 0 if tuning.bank is None else tuning.bank.id
    boxes = {setting.name: in_force.get(setting.name, setting.default) for setting in settings}
    assert None not in boxes.values()
    return {name: value for name, value in boxes.items() if value is not None}


async def bring(parts: Parts, state: str) -> TuningChoice:
    """Bring the service into a state and return the operator's tuning in it."""
    if state in ("bank in force", "after an experiment"):
        with parts.database.session() as session:
            bank = banks.add(session, "forms", [BankEntry(10.55, MODEL), BankEntry(12.43, MODEL)], WHO)
        await parts.bench.retuning.use_bank(bank, WHO)
        await parts.bench.retuning.set(TuningRequest(lam_q=0.6, b=0.25, interpolate=True), WHO)
    if state == "after an experiment":
        other = {**SHORT["sequence"], "lam_q": 0.9, "lam_S": 0.8, "b": 1.0, "bank": 0, "interpolate": False}
        await parts.tasks.start_experiment(ExperimentRequest(name="sequence", settings=other), WHO)
        await parts.ended()
    return parts.picture.tuning.choice


def stored_as(database: Database, run: int) -> Form:
    with database.reading() as session:
        settings = runs.get(session, run).settings
    return {**settings["plan"], **settings["loop"]}


def reported(database: Database, run: int) -> dict[str, str]:
    """What the report prints of each setting, by its meaning."""
    tables = [block for section in build_report(load_source(database, run)).sections for block in section.blocks]
    table = next(block for block in tables if isinstance(block, Table) and block.caption == "Settings of the run.")
    return {row[0]: row[2] for row in table.rows}


def printed(value: SettingValue) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return exact(value) if isinstance(value, float) else str(value)


@pytest.mark.parametrize("state", STATES)
def test_an_experiment_is_what_its_form_shows(database: Database, state: str) -> None:
    async def work(parts: Parts) -> None:
        own = await bring(parts, "fresh" if state == "after a restart" else state)
        for kind in parts.tasks.experiment_kinds():
            form = shown(kind.settings, parts) | SHORT[kind.name]
            assert TuningChoice.of(form) == own
            order = ExperimentRequest(name=kind.name, settings=form)
            run = await parts.tasks.start_experiment(order, WHO)
            await parts.ended()
            view = await parts.library.experiment(run)
            assert (view.status, view.settings, stored_as(database, run)) == ("completed", form, form)
            told = reported(database, run)
            assert {box.meaning: told[box.meaning] for box in kind.settings} == {
                box.meaning: printed(form[box.name]) for box in kind.settings
            }
            queued = await parts.tasks.queue.add(order, WHO)
            assert queued.items[-1].settings == form
            assert parts.picture.tuning.choice == own

    if state == "after a restart":
        stepped(database, IDEAL, lambda parts: bring(parts, "after an experiment"))
    stepped(database, IDEAL, work)


@pytest.mark.parametrize("state", ["fresh", "after an experiment"])
def test_an_identification_is_what_its_form_shows(database: Database, state: str) -> None:
    short: Form = {"bits": 6}

    async def work(parts: Parts) -> None:
        own = await bring(parts, state)
        kind = next(kind for kind in parts.tasks.identification_kinds() if kind.kind == "actuator")
        form = {box.name: box.default for box in kind.settings} | short
        run = await parts.tasks.start_identification(ActuatorRequest.model_validate(form), WHO)
        await parts.ended()
        assert stored_as(database, run) == {**form, **own.document(), "seed": 0}
        assert (await parts.library.identification(run)).settings == stored_as(database, run)
        told = reported(database, run)
        assert {box.meaning: told[box.meaning] for box in kind.settings} == {
            box.meaning: printed(form[box.name]) for box in kind.settings
        }
        assert parts.picture.tuning.choice == own

    stepped(database, IDEAL, work)


@pytest.mark.parametrize(
    ("name", "request_type"), [("actuator", ActuatorRequest), ("motor", MotorRequest), ("spring", SpringRequest)]
)
def test_the_boxes_of_an_identification_are_those_of_its_order(
    database: Database, name: str, request_type: type[ActuatorRequest | MotorRequest | SpringRequest]
) -> None:
    """What the page leaves at its default is the default of the service too, and no box is missing on either side."""

    async def work(parts: Parts) -> None:
        kind = next(kind for kind in parts.tasks.identification_kinds() if kind.kind == name)
        boxes = {box.name: box.default for box in kind.settings}
        assert request_type(kind=name).model_dump(exclude={"kind", "tensions_N"}) == boxes

    stepped(database, IDEAL, work)


def test_a_viewers_dry_run_is_what_the_form_shows(database: Database) -> None:
    async def left() -> bool:
        return False

    async def work(parts: Parts) -> None:
        await bring(parts, "bank in force")
        kind = next(kind for kind in parts.tasks.experiment_kinds() if kind.name == "sequence")
        form = shown(kind.settings, parts) | SHORT["sequence"]
        played = await parts.tasks.dry_run(ExperimentRequest(name="sequence", settings=form), OPERATOR, left)
        assert (played.status, played.settings) == ("completed", form)

    stepped(database, IDEAL, work)
