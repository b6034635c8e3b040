"""The active tuning: stored over restarts, overridden by experiments, undone."""

import asyncio
import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from backend.banks.tuning_settings import ACTIVE_TUNING_KEY, TuningSettings, compute_default_tuning
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.models.settings import SettingError
from backend.realtime.commands import Stop
from backend.reports.build import build_report
from backend.reports.run_data import load_source
from backend.schemas.experiment import ExperimentRequest
from backend.schemas.tuning import ChosenTuning, TrialRequest, TuningParts, TuningRequest
from backend.services import messages
from backend.services.state import UNDO_STEPS
from backend.services.tuning import RETRY_S, SavedTunings
from backend.services.tuning_state import ActiveTuning, TuningStore, default_tuning, make_active_tuning
from backend.storage import banks, events, runs, settings
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import EndState
from plant.parameters import PlantParameters, load_parameters
from tests.api.conftest import client_with
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.e2e.service import running_service
from tests.experiments.parameter_files import weak_motors
from tests.refusals import refused

# The stored tuning is restored on the same plant.

MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def bank(database: Database) -> Bank:
    with database.session() as session:
        return banks.add(session, "kept", [BankEntry(10.55, MODEL), BankEntry(12.43, MODEL)], "A. Operator")


@pytest.fixture
def chosen(ideal: PlantParameters, bank: Bank) -> ActiveTuning:
    return make_active_tuning(
        ideal, TuningSettings(lam_q=0.8, lam_S=0.6, lam_motor=0.09, b=0.5, interpolate=True), bank
    )


def test_stored_tuning_is_restored(database: Database, ideal: PlantParameters, chosen: ActiveTuning) -> None:
    tuning_store = TuningStore(database)
    assert tuning_store.restore(ideal)[1] == ""
    tuning_store.save(make_active_tuning(ideal, TuningSettings()), "B. Operator")
    tuning_store.save(chosen, "A. Operator")
    restored, message = tuning_store.restore(ideal)
    assert restored.settings == chosen.settings
    assert restored.build_command() == chosen.build_command()
    models = messages.models_in_use(bank=("kept", 1))
    assert message == messages.tuning_restored(who="A. Operator", models=models, settings=chosen.settings.format())


def test_other_parameters_start_with_the_default(
    database: Database, ideal: PlantParameters, chosen: ActiveTuning
) -> None:
    tuning_store = TuningStore(database)
    tuning_store.save(chosen, "A. Operator")
    lab = load_parameters("lab")
    restored, message = tuning_store.restore(lab)
    assert restored.settings == compute_default_tuning(lab).tuning
    assert message.startswith(messages.defaults_active(reason=messages.tuning_of_other_parameters(), moved=""))


def test_default_uses_the_nearest_lambda_in_range(tmp_path: Path) -> None:
    """The service starts with its own parameter file: log, page and data state which λ and why."""
    with running_service(tmp_path, str(weak_motors(tmp_path))) as service, client_with(service, "token") as client:
        tuning, saved = (client.get(f"/api/tuning{path}").raise_for_status().json() for path in ("", "/saved"))
    lam_q = tuning["lam_q"]
    assert tuning["lam_q_min"] <= lam_q < tuning["lam_q_min"] + 1e-3
    message = default_tuning(load_parameters(str(weak_motors(tmp_path))))[1]
    assert message.endswith(f"λ_q 0.5 → {lam_q:g} s")
    assert (saved["lam_q"], saved["who"], saved["moved"]) == (lam_q, None, message)
    with closing(open_database(tmp_path)) as database, database.reading() as session:
        texts = [event.text for event in events.between(session, datetime.min.replace(tzinfo=UTC), None)]
    assert message in texts


def test_default_saved_tuning_fits_the_active_tuning(database: Database, tmp_path: Path) -> None:
    """For any active tuning, reverting to the saved tuning is accepted."""
    weak = load_parameters(str(weak_motors(tmp_path)))
    for choice in (TuningSettings(lam_q=1.2), TuningSettings(lam_q=2.5, lam_S=1.5, lam_motor=0.2, b=1.0)):
        tuning = make_active_tuning(weak, choice)
        saved = SavedTunings(database).load(tuning)
        wanted = {name: getattr(saved, name) for name in TuningParts.model_fields}
        assert tuning.with_request(TuningRequest(**wanted)).settings == TuningSettings(**wanted)
        assert "λ_q 0.5 → " in saved.moved


def test_default_after_other_parameters_is_moved_into_range(
    database: Database, chosen: ActiveTuning, tmp_path: Path
) -> None:
    tuning_store = TuningStore(database)
    tuning_store.save(chosen, "A. Operator")
    weak = load_parameters(str(weak_motors(tmp_path)))
    restored, message = tuning_store.restore(weak)
    assert restored.settings == replace(
        TuningSettings(), lam_q=restored.settings.lam_q, u_plan=restored.settings.u_plan
    )
    assert restored.settings.u_plan > 0.0
    default, moved = default_tuning(weak)
    assert (default.settings, default.settings.lam_q > 0.5) == (restored.settings, True)
    assert message == messages.defaults_active(reason=messages.tuning_of_other_parameters(), moved=moved)
    assert moved.endswith(f"λ_q 0.5 → {restored.settings.lam_q:g} s")


@pytest.mark.parametrize(("name", "value"), [("bank", 99), ("lam_q", 0.1), ("lam_motor", 3.5), ("b", 1.5)])
def test_unusable_stored_tuning_is_replaced_by_the_default(
    database: Database, ideal: PlantParameters, chosen: ActiveTuning, name: str, value: float
) -> None:
    tuning_store = TuningStore(database)
    tuning_store.save(chosen, "A. Operator")
    with database.session() as session:
        stored = settings.newest(session, ACTIVE_TUNING_KEY)
        assert stored is not None
        settings.save(session, ACTIVE_TUNING_KEY, {**stored.value, name: value}, "A. Operator")
    restored, message = tuning_store.restore(ideal)
    assert restored.settings == compute_default_tuning(ideal).tuning
    assert str(value) in message


# The temporary tuning of a run, and the restored tuning of the operator.

IDEAL = load_parameters("ideal")
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
def active_bank(database: Database) -> Bank:
    """A bank that is active at the next start, with λ of the operator."""
    with database.session() as session:
        made = banks.add(session, "lent", [BankEntry(10.55, MODEL)], WHO)
    return made


def own(bank: Bank) -> TuningSettings:
    return replace(compute_default_tuning(IDEAL).tuning, lam_q=0.55, lam_S=0.45, bank=bank.id)


async def started(parts: Parts, bank: Bank) -> None:
    """The operator's tuning active, with the bank."""
    await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.55, lam_S=0.45), WHO)
    await parts.actuator.tuning_service.use_bank(bank, WHO)
    assert parts.live_state.tuning.settings == own(bank)


def sequence(segments: str = SHORT, **settings: float | bool) -> ExperimentRequest:
    return ExperimentRequest(name="sequence", settings={"segments": segments, **settings})


def test_temporary_tuning_is_used_stored_and_reported_and_then_restored(database: Database, active_bank: Bank) -> None:
    during: list[TuningSettings] = []

    async def work(parts: Parts) -> int:
        await started(parts, active_bank)
        run = await parts.ordered_runs.start_experiment(sequence(**ASKED), WHO)
        during.append(parts.live_state.tuning.settings)
        shown = parts.state()
        assert (shown.tuning.b, shown.tuning.bank) == (1.0, None)
        assert shown.own_tuning is not None
        assert (shown.own_tuning.b, shown.own_tuning.bank and shown.own_tuning.bank.id) == (0.0, active_bank.id)
        with refused(RequestRejectedError, "run_contains_tuning"):
            await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.9), WHO)
        await parts.ended()
        assert parts.live_state.tuning.settings == own(active_bank)
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
        texts = [event.text for event in events.between(session, stored.started_at, None)]
    assert TuningSettings.from_values(stored.settings["loop"]) == asked
    assert stored.bank_id is None
    declared = {item["name"]: item["value"] for item in stored.settings["declared"]}
    assert {name: declared[name] for name in ASKED} == ASKED
    given_back = "λ_q 0.7 → 0.55 s, λ_S 0.6 → 0.45 s, b 1 → 0, bank geometry → 1, interpolate yes → no"
    assert (
        messages.tuning_after_run(difference=f"{given_back}, motion time-optimal → lambda, U_plan 6 → 8.5 V") in texts
    )
    source = load_source(database, run)
    assert source.columns["lam_q"] == pytest.approx(0.7)
    facts = {fact.label: fact.text for fact in build_report(source).facts}
    assert facts["Tuning"] == "λ_q = 0.7 s, λ_S = 0.6 s, λ_motor = 0.0854 s, b = 1"
    law = "motion time-optimal within U_plan = 6 V"
    assert facts["Controller"] == f"cascade, geometric gains, 20 N operating point; {law}"


def test_restart_during_an_experiment_uses_the_operators_tuning(database: Database, active_bank: Bank) -> None:
    async def broken_off(parts: Parts) -> None:
        await started(parts, active_bank)
        await parts.ordered_runs.start_experiment(sequence(LONG, **ASKED), WHO)
        await parts.ordered_runs.close()

    async def again(parts: Parts) -> TuningSettings:
        return parts.live_state.tuning.settings

    stepped(database, IDEAL, broken_off)
    assert stepped(database, IDEAL, again) == own(active_bank)


def test_stop_and_loop_exit_restore_the_tuning(database: Database, active_bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        await started(parts, active_bank)
        await parts.ordered_runs.start_experiment(sequence(LONG, **ASKED), WHO)
        while parts.live_state.mode != "experiment":
            await asyncio.sleep(0.0)
        await parts.supervisor.send(Stop())
        await parts.ended()
        assert parts.live_state.fault == "stop_pressed"
        assert parts.live_state.tuning.settings == own(active_bank)
        await parts.actuator.reset(WHO)
        await parts.ordered_runs.start_experiment(sequence(SHORT, **ASKED), WHO)
        parts.supervisor.dead = True
        await parts.ended()
        assert parts.live_state.tuning.settings == own(active_bank)
        assert (
            parts.supervisor.setup.tuning == make_active_tuning(IDEAL, own(active_bank), active_bank).build_command()
        )  # the tuning of a new loop

    stepped(database, IDEAL, work)


def test_failed_restore_is_reported_until_it_succeeds(database: Database, active_bank: Bank) -> None:
    async def until(problems: bool, parts: Parts) -> list[str]:
        while bool(found := parts.state().problems) is not problems:
            await asyncio.sleep(0.01)
        return found

    why = "a gain is not a finite number"

    async def work(parts: Parts) -> None:
        await started(parts, active_bank)
        await parts.ordered_runs.start_experiment(sequence(SHORT, lam_q=0.7), WHO)
        parts.supervisor.refuses = why
        shown_problems = await until(True, parts)
        assert shown_problems == [
            messages.tuning_not_restored(
                tuning=messages.tuning_of_operator(), difference="λ_q 0.7 → 0.55 s", reason=why, retry_s=RETRY_S
            )
        ]
        assert parts.live_state.tuning.settings.lam_q == 0.7  # and that tuning is shown as active
        parts.supervisor.refuses = ""
        await until(False, parts)
        assert parts.live_state.tuning.settings == own(active_bank)
        await parts.ended()

        await parts.actuator.tuning_service.start_trial(TrialRequest(lam_q=0.8, duration_s=1.0), WHO)
        parts.supervisor.refuses = why
        shown_problems = await until(True, parts)
        before = messages.tuning_before_trial()
        assert shown_problems[0] == messages.tuning_not_restored(
            tuning=before, difference="λ_q 0.8 → 0.55 s", reason=why, retry_s=RETRY_S
        )
        parts.supervisor.refuses = ""
        await until(False, parts)
        assert parts.live_state.tuning.settings == own(active_bank)

    stepped(database, IDEAL, work)


def test_refused_tuning_changes_nothing(database: Database, active_bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        await started(parts, active_bank)
        for each_settings, refusal in (
            ({"lam_q": 0.1}, OutOfRangeError),
            ({"b": 1.5}, OutOfRangeError),
            ({"bank": 99}, UnknownRecordError),
            ({"seed": 5}, SettingError),
        ):
            with pytest.raises(refusal):
                await parts.ordered_runs.start_experiment(sequence(**each_settings), WHO)
            assert (parts.live_state.tuning.settings, parts.live_state.overridden_tuning) == (own(active_bank), None)
        await parts.actuator.tuning_service.start_trial(TrialRequest(lam_q=0.9, duration_s=60.0), WHO)
        with refused(RequestRejectedError, "trial_in_progress"):
            await parts.ordered_runs.start_experiment(sequence(), WHO)
        await parts.actuator.tuning_service.end_trial(False, WHO)

    stepped(database, IDEAL, work)


def test_queue_checks_added_experiments_and_runs_them_as_shown(database: Database, active_bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        queue = parts.ordered_runs.queue
        await started(parts, active_bank)
        for each_settings, refusal in (
            ({"bank": 99}, UnknownRecordError),
            ({"lam_q": 0.1}, OutOfRangeError),
            ({"seed": 5}, SettingError),
        ):
            with pytest.raises(refusal):
                await queue.add(sequence(**each_settings), WHO)
        assert queue.view().items == []
        await queue.add(sequence(bank=0), WHO)
        await queue.add(sequence(), WHO)
        await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.8), WHO)  # after they were added
        shown = [item.settings for item in queue.view().items]
        assert [(one["lam_q"], one["bank"], one["segments"]) for one in shown] == [
            (0.55, 0, SHORT),
            (0.55, active_bank.id, SHORT),
        ]
        first = (await queue.run()).run
        assert first is not None
        await parts.ended()
        for run, one in zip((first, first + 1), shown, strict=True):
            played = {name: value for name, value in one.items() if name != "segments"}  # an experiment by now
            assert parts.runs.load_experiment(run).settings == played
        assert parts.live_state.tuning.lambdas.lam_q == 0.8

    stepped(database, IDEAL, work)


def test_paused_queue_explains_how_to_continue(database: Database, active_bank: Bank) -> None:
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
            messages.queue_paused(cause=messages.run_not_completed(run=run or 0, end_state=EndState.STOPPED), waiting=1)
        )
        await parts.actuator.reset(WHO)
        await queue.run()
        await parts.ended()
        view = queue.view()
        assert (view.items, view.running, view.problem) == ([], False, "")

    stepped(database, IDEAL, work)


def test_dry_run_reports_its_settings(database: Database, active_bank: Bank) -> None:
    async def left() -> bool:
        return False

    async def work(parts: Parts) -> None:
        await started(parts, active_bank)
        played = await parts.ordered_runs.dry_run(sequence(b=0.5), OPERATOR, left)
        expected = {**own(active_bank).to_document(), "b": 0.5, "seed": 0}
        assert (played.status, played.settings) == ("completed", expected)
        assert parts.live_state.tuning.settings == own(active_bank)

    stepped(database, IDEAL, work)


# Undo and redo of each part of a tuning.

DEFAULT = compute_default_tuning(IDEAL).tuning
CHANGES = [
    TuningRequest(lam_q=0.61),
    TuningRequest(lam_S=0.57),
    TuningRequest(lam_motor=0.09),
    TuningRequest(b=0.25),
    TuningRequest(interpolate=True),
    TuningRequest(motion="time-optimal", u_plan=7.0),
]


@pytest.fixture
def bank_walk(database: Database) -> Bank:
    entries = [BankEntry(8.24, {**MODEL, "tension_N": 10.0}), BankEntry(10.55, {**MODEL, "tension_N": 20.0})]
    with database.session() as session:
        return banks.add(session, "walked", entries, WHO)


def active_tuning(parts: Parts) -> TuningSettings:
    """Return the active tuning; a restarted loop gets the same."""
    assert parts.supervisor.setup.tuning == parts.live_state.tuning.build_command()
    return parts.live_state.tuning.settings


def earlier(parts: Parts) -> TuningSettings | None:
    """Return the tuning that the page shows for undo."""
    return settings_of(parts.state().earlier)


def later(parts: Parts) -> TuningSettings | None:
    """Return the tuning that the page shows for redo."""
    return settings_of(parts.state().later)


def settings_of(shown: ChosenTuning | None) -> TuningSettings | None:
    if shown is None:
        return None
    values = shown.model_dump()
    return TuningSettings.from_values({**values, "bank": 0 if shown.bank is None else shown.bank.id})


def test_undo_and_redo_of_each_part_of_a_tuning(database: Database, bank_walk: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        assert earlier(parts) is None
        with refused(RequestRejectedError, "nothing_to_undo"):
            await tuning_service.undo(WHO)
        await tuning_service.use_bank(bank_walk, WHO)
        for change in CHANGES:
            before = active_tuning(parts)
            await tuning_service.apply(change, WHO)
            changed = active_tuning(parts)
            assert changed != before
            assert earlier(parts) == before
            await tuning_service.apply(change, WHO)  # the same values are no change
            assert earlier(parts) == before
            view = await tuning_service.undo(WHO)
            assert TuningSettings.from_values({**view.model_dump(), "bank": bank_walk.id}) == before
            assert (active_tuning(parts), later(parts)) == (before, changed)
            await tuning_service.redo(WHO)
            assert (active_tuning(parts), earlier(parts), later(parts)) == (changed, before, None)
            with refused(RequestRejectedError, "nothing_to_redo"):
                await tuning_service.redo(WHO)

    stepped(database, IDEAL, work)
    with database.reading() as session:
        texts = [event.text for event in events.find(session, limit=100)]
    assert messages.tuning_undone(difference="λ_q 0.61 → 0.5 s") in texts
    assert messages.tuning_redone(difference="λ_q 0.5 → 0.61 s") in texts
    assert messages.tuning_undone(difference="b 0.25 → 0") in texts
    assert messages.tuning_undone(difference="interpolate yes → no") in texts


def test_undo_and_redo_of_all_changes(database: Database, bank_walk: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        past = [active_tuning(parts)]
        await tuning_service.use_bank(bank_walk, WHO)
        past.append(active_tuning(parts))
        for change in CHANGES:
            await tuning_service.apply(change, WHO)
            past.append(active_tuning(parts))
        for before in reversed(past[:-1]):
            await tuning_service.undo(WHO)
            assert active_tuning(parts) == before
        assert earlier(parts) is None
        for after in past[1:]:
            await tuning_service.redo(WHO)
            assert active_tuning(parts) == after
        await tuning_service.undo(WHO)
        await tuning_service.apply(TuningRequest(b=0.75), WHO)  # a new change: the undone changes are discarded
        assert (later(parts), earlier(parts)) == (None, past[-2])
        for n in range(2 * UNDO_STEPS):
            await tuning_service.apply(TuningRequest(b=0.2 + 0.01 * n), WHO)
        for _ in range(UNDO_STEPS):
            await tuning_service.undo(WHO)
        assert earlier(parts) is None

    stepped(database, IDEAL, work)


def test_undo_and_redo_of_a_bank(database: Database, bank_walk: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        assert parts.state().tuning.entry_name == ""
        await tuning_service.use_bank(bank_walk, WHO)
        assert parts.state().tuning.entry_name == "10 N"
        view = await tuning_service.use_bank(None, WHO)
        assert (view.bank, active_tuning(parts).bank) == (None, 0)
        await tuning_service.undo(WHO)
        assert active_tuning(parts).bank == bank_walk.id
        await tuning_service.redo(WHO)

    async def started_again(parts: Parts) -> tuple[TuningSettings, TuningSettings | None]:
        return active_tuning(parts), earlier(parts)

    stepped(database, IDEAL, work)
    # the next start has the same tuning, and the one before it
    assert stepped(database, IDEAL, started_again) == (DEFAULT, replace(DEFAULT, bank=bank_walk.id))


def test_undo_after_a_trial_returns_to_before_it(database: Database, bank_walk: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await tuning_service.apply(TuningRequest(lam_q=0.6), WHO)
        for lam_q in (0.7, 0.8):
            await tuning_service.start_trial(TrialRequest(lam_q=lam_q, duration_s=60.0), WHO)
            assert earlier(parts) == DEFAULT
            with refused(RequestRejectedError, "trial_in_progress"):
                await tuning_service.undo(WHO)
        await tuning_service.end_trial(True, WHO)
        assert earlier(parts) == replace(DEFAULT, lam_q=0.6)
        await tuning_service.undo(WHO)
        assert active_tuning(parts) == replace(DEFAULT, lam_q=0.6)
        await tuning_service.start_trial(TrialRequest(lam_q=0.9, duration_s=60.0), WHO)
        await tuning_service.apply(TuningRequest(b=0.5), WHO)  # chosen from the trial: one undo step is before both
        assert active_tuning(parts) == replace(DEFAULT, lam_q=0.9, b=0.5)
        assert earlier(parts) == replace(DEFAULT, lam_q=0.6)

    stepped(database, IDEAL, work)


def test_temporary_tuning_is_no_undo_step(database: Database, bank_walk: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await tuning_service.apply(TuningRequest(lam_q=0.6), WHO)
        await tuning_service.apply_temporary(TuningSettings(lam_q=0.9, b=1.0), None, WHO)
        with refused(RequestRejectedError, "starting_run_contains_tuning"):
            await tuning_service.undo(WHO)
        await asyncio.gather(tuning_service.restore_operator_tuning(), tuning_service.restore_operator_tuning())
        assert (active_tuning(parts), earlier(parts)) == (replace(DEFAULT, lam_q=0.6), DEFAULT)

    stepped(database, IDEAL, work)
