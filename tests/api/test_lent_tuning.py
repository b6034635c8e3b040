"""The temporary tuning of a run, and the restored tuning of the operator."""

import asyncio
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.banks.tuning_settings import TuningSettings, compute_default_tuning
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.models.settings import SettingError
from backend.realtime.commands import Stop
from backend.reports.build import build_report
from backend.reports.run_data import load_source
from backend.schemas.experiment import ExperimentRequest
from backend.schemas.tuning import TrialRequest, TuningRequest
from backend.services.tuning_state import make_active_tuning
from backend.storage import banks, events, runs
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

IDEAL = load_parameters("ideal")
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}
SHORT = json.dumps([{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}])
LONG = json.dumps([{"duration_s": 30, "q_ref": 0.1, "S_ref": 10}])
ASKED: dict[str, Any] = {
    "lam_q": 0.7,
    "lam_S": 0.6,
    "b": 1.0,
    "interpolate": True,
    "motion": "time-optimal",
    "u_plan": 6.0,
    "bank": 0,
}
WHO = OPERATOR.name


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def bank(database: Database) -> Bank:
    """A bank that is in force at the next start, with λ of the operator's own."""
    with database.session() as session:
        made = banks.add(session, "lent", [BankEntry(10.55, MODEL)], WHO)
    return made


def own(bank: Bank) -> TuningSettings:
    return replace(compute_default_tuning(IDEAL).tuning, lam_q=0.55, lam_S=0.45, bank=bank.id)


async def started(parts: Parts, bank: Bank) -> None:
    """The operator's own tuning in force, with the bank."""
    await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.55, lam_S=0.45), WHO)
    await parts.actuator.tuning_service.use_bank(bank, WHO)
    assert parts.live_state.tuning.choice == own(bank)


def sequence(segments: str = SHORT, **settings: float | bool) -> ExperimentRequest:
    return ExperimentRequest(name="sequence", settings={"segments": segments, **settings})


def test_temporary_tuning_is_used_stored_and_reported_and_then_restored(database: Database, bank: Bank) -> None:
    during: list[TuningSettings] = []

    async def work(parts: Parts) -> int:
        await started(parts, bank)
        run = await parts.ordered_runs.start_experiment(sequence(**ASKED), WHO)
        during.append(parts.live_state.tuning.choice)
        shown = parts.state()
        assert (shown.tuning.b, shown.tuning.bank) == (1.0, None)
        assert shown.own_tuning is not None
        assert (shown.own_tuning.b, shown.own_tuning.bank and shown.own_tuning.bank.id) == (0.0, bank.id)
        with pytest.raises(RequestRejectedError, match="part of its record"):
            await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.9), WHO)
        await parts.ended()
        assert parts.live_state.tuning.choice == own(bank)
        assert parts.state().own_tuning is None
        assert parts.supervisor.setup.tuning == parts.live_state.tuning.build_command()
        await parts.actuator.tuning_service.apply(TuningRequest(), WHO)  # and it can be changed again
        view = parts.runs.load_experiment(run)
        assert {name: view.settings[name] for name in ASKED} == ASKED
        return run

    run = stepped(database, IDEAL, work)
    asked = TuningSettings(**ASKED)
    assert during == [asked]
    with database.reading() as session:
        stored = runs.get(session, run)
        told = [event.text for event in events.between(session, stored.started_at, None)]
    assert TuningSettings.from_values(stored.settings["loop"]) == asked
    assert stored.bank_id is None
    declared = {item["name"]: item["value"] for item in stored.settings["declared"]}
    assert {name: declared[name] for name in ASKED} == ASKED
    given_back = "λ_q 0.7 → 0.55 s, λ_S 0.6 → 0.45 s, b 1 → 0, bank geometry → 1, interpolate yes → no"
    assert f"after the run: {given_back}, motion time-optimal → lambda, U_plan 6 → 8.5 V" in told
    source = load_source(database, run)
    assert source.columns["lam_q"] == pytest.approx(0.7)
    facts = {fact.label: fact.text for fact in build_report(source).facts}
    assert facts["Tuning"] == "λ_q = 0.7 s, λ_S = 0.6 s, λ_motor = 0.0854 s, b = 1"
    law = "motion time-optimal within U_plan = 6 V"
    assert facts["Controller"] == f"cascade, gains from geometry, 20 N point; {law}"


def test_restart_during_an_experiment_uses_the_operators_tuning(database: Database, bank: Bank) -> None:
    async def broken_off(parts: Parts) -> None:
        await started(parts, bank)
        await parts.ordered_runs.start_experiment(sequence(LONG, **ASKED), WHO)
        await parts.ordered_runs.close()

    async def again(parts: Parts) -> TuningSettings:
        return parts.live_state.tuning.choice

    stepped(database, IDEAL, broken_off)
    assert stepped(database, IDEAL, again) == own(bank)


def test_stop_and_loop_exit_restore_the_tuning(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        await started(parts, bank)
        await parts.ordered_runs.start_experiment(sequence(LONG, **ASKED), WHO)
        while parts.live_state.mode != "experiment":
            await asyncio.sleep(0.0)
        await parts.supervisor.send(Stop())
        await parts.ended()
        assert parts.live_state.fault == "stop_pressed"
        assert parts.live_state.tuning.choice == own(bank)
        await parts.actuator.reset(WHO)
        await parts.ordered_runs.start_experiment(sequence(SHORT, **ASKED), WHO)
        parts.supervisor.dead = True
        await parts.ended()
        assert parts.live_state.tuning.choice == own(bank)
        assert (
            parts.supervisor.setup.tuning == make_active_tuning(IDEAL, own(bank), bank).build_command()
        )  # what a new loop gets

    stepped(database, IDEAL, work)


def test_failed_restore_is_reported_until_it_succeeds(database: Database, bank: Bank) -> None:
    async def until(problems: bool, parts: Parts) -> list[str]:
        while bool(found := parts.state().problems) is not problems:
            await asyncio.sleep(0.01)
        return found

    async def work(parts: Parts) -> None:
        await started(parts, bank)
        await parts.ordered_runs.start_experiment(sequence(SHORT, lam_q=0.7), WHO)
        parts.supervisor.refuses = "a gain is not a finite number"
        told = await until(True, parts)
        assert told == [
            "The operator's tuning (λ_q 0.7 → 0.55 s) is not back in force: a gain is not a finite number. It is tried "
            "again every 0.5 s. If this stays, stop softly and start the service again: it starts with the operator's "
            "tuning."
        ]
        assert parts.live_state.tuning.choice.lam_q == 0.7  # and that is what is shown as in force
        parts.supervisor.refuses = ""
        await until(False, parts)
        assert parts.live_state.tuning.choice == own(bank)
        await parts.ended()

        await parts.actuator.tuning_service.start_trial(TrialRequest(lam_q=0.8, duration_s=1.0), WHO)
        parts.supervisor.refuses = "a gain is not a finite number"
        told = await until(True, parts)
        assert told[0].startswith("The tuning before the trial (λ_q 0.8 → 0.55 s) is not back in force: a gain")
        parts.supervisor.refuses = ""
        await until(False, parts)
        assert parts.live_state.tuning.choice == own(bank)

    stepped(database, IDEAL, work)


def test_refused_tuning_changes_nothing(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        await started(parts, bank)
        for settings, refusal in (
            ({"lam_q": 0.1}, OutOfRangeError),
            ({"b": 1.5}, OutOfRangeError),
            ({"bank": 99}, UnknownRecordError),
            ({"seed": 5}, SettingError),
        ):
            with pytest.raises(refusal):
                await parts.ordered_runs.start_experiment(sequence(**settings), WHO)
            assert (parts.live_state.tuning.choice, parts.live_state.overridden_tuning) == (own(bank), None)
        await parts.actuator.tuning_service.start_trial(TrialRequest(lam_q=0.9, duration_s=60.0), WHO)
        with pytest.raises(RequestRejectedError, match="trial"):
            await parts.ordered_runs.start_experiment(sequence(), WHO)
        await parts.actuator.tuning_service.end_trial(False, WHO)

    stepped(database, IDEAL, work)


def test_queue_checks_added_experiments_and_runs_them_as_shown(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        queue = parts.ordered_runs.queue
        await started(parts, bank)
        for settings, refusal in (
            ({"bank": 99}, UnknownRecordError),
            ({"lam_q": 0.1}, OutOfRangeError),
            ({"seed": 5}, SettingError),
        ):
            with pytest.raises(refusal):
                await queue.add(sequence(**settings), WHO)
        assert queue.view().items == []
        await queue.add(sequence(bank=0), WHO)
        await queue.add(sequence(), WHO)
        await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.8), WHO)  # after they were added
        shown = [item.settings for item in queue.view().items]
        assert [(one["lam_q"], one["bank"], one["segments"]) for one in shown] == [
            (0.55, 0, SHORT),
            (0.55, bank.id, SHORT),
        ]
        first = (await queue.run()).run
        assert first is not None
        await parts.ended()
        for run, one in zip((first, first + 1), shown, strict=True):
            played = {name: value for name, value in one.items() if name != "segments"}  # an experiment by now
            assert parts.runs.load_experiment(run).settings == played
        assert parts.live_state.tuning.lambdas.lam_q == 0.8

    stepped(database, IDEAL, work)


def test_paused_queue_explains_how_to_continue(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        queue = parts.ordered_runs.queue
        for segments in (LONG, SHORT):
            await queue.add(sequence(segments), WHO)
        run = (await queue.run()).run
        while parts.live_state.mode != "experiment":
            await asyncio.sleep(0.0)
        await parts.supervisor.send(Stop())
        await parts.ended()
        assert queue.view().problem == (
            f"held because run {run} ended as stopped; start the queue again to go on with the first that waits"
        )
        await parts.actuator.reset(WHO)
        await queue.run()
        await parts.ended()
        view = queue.view()
        assert (view.items, view.running, view.problem) == ([], False, "")

    stepped(database, IDEAL, work)


def test_dry_run_reports_its_settings(database: Database, bank: Bank) -> None:
    async def left() -> bool:
        return False

    async def work(parts: Parts) -> None:
        await started(parts, bank)
        played = await parts.ordered_runs.dry_run(sequence(b=0.5), OPERATOR, left)
        expected = {**own(bank).to_document(), "b": 0.5, "seed": 0}
        assert (played.status, played.settings) == ("completed", expected)
        assert parts.live_state.tuning.choice == own(bank)

    stepped(database, IDEAL, work)
