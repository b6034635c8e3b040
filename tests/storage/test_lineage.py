"""Each gain in use can be walked back to the samples and parameters it came from."""

from dataclasses import replace

import pytest

from backend.models.run import MeasuredFigure, Metrics, RunCriterion
from backend.storage import banks, events, identifications, results, runs, settings
from backend.storage.banks import BankEntry
from backend.storage.database import Database
from backend.storage.identifications import NewIdentification
from backend.storage.orm import StorageError, UnknownRecordError
from backend.storage.results import NewResult
from backend.storage.runs import EndState, NewRun, RunKind
from plant.interface import NAME_MAX

NEW_RUN = NewRun(
    kind=RunKind.ACTUATOR_IDENTIFICATION,
    plant="simulator",
    parameters_name="ideal",
    parameters={"r_m": 0.0075},
    who="Ana",
    software="0.1.0",
    settings={"tension_N": 20.0},
)
METRICS = Metrics(
    complete=True,
    played_s=2.0,
    planned_s=2.0,
    figures=(MeasuredFigure("overshoot", "%", "Overshoot", "largest, in per cent of its step", 0.5),),
)
CRITERION = RunCriterion("overshoot", "Overshoot", "<", 1.0, 0.5, "%", passed=True)
NEW_IDENTIFICATION = NewIdentification(
    kind="actuator",
    run_id=None,
    data={"signals": ["theta_A_ref", "q"]},
    method="srivc",
    options={},
    model={"G_q": {"K": 0.05}},
    quality={"fit_percent": 99.0},
    usable=True,
    verdict="usable",
    who="Ana",
    software="0.1.0",
)


def test_a_run_remembers_its_plant_by_its_whole_name(database: Database) -> None:
    name = "x" * NAME_MAX
    with database.session() as session:
        run = runs.create(session, replace(NEW_RUN, plant=name))
    with database.reading() as session:
        assert runs.get(session, run.id).plant == name


def test_bank_walks_back_to_run(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        found = identifications.add(session, replace(NEW_IDENTIFICATION, run_id=run.id))
        entry = BankEntry(S_nominal=10.55, model=found.model, identification_id=found.id)
        bank = banks.add(session, "bench", [entry], who="Ana")
    with database.reading() as session:
        identification_id = banks.get(session, bank.id).entries[0].identification_id
        assert identification_id is not None
        run_id = identifications.get(session, identification_id).run_id
        assert run_id is not None
        assert runs.get(session, run_id).parameters == {"r_m": 0.0075}


def test_same_name_makes_next_version(database: Database) -> None:
    low, high = BankEntry(8.24, {"K": 1.0}), BankEntry(14.06, {"K": 2.0})
    with database.session() as session:
        first = banks.add(session, "bench", [low], who="Ana")
        second = banks.add(session, "bench", [high, low], who="Bo")
    with database.reading() as session:
        assert (first.version, second.version) == (1, 2)
        assert banks.get(session, first.id).entries == (low,)
        assert banks.get(session, second.id).entries == (low, high)
        assert [bank.version for bank in banks.find(session, name="bench")] == [2, 1]


def test_bank_without_entries_is_refused(database: Database) -> None:
    with pytest.raises(ValueError, match="choose at least one"), database.session() as session:
        banks.add(session, "empty", [], who="Ana")


def test_entry_of_unknown_identification_is_refused_whole(database: Database) -> None:
    with pytest.raises(StorageError, match=r"(?i)foreign key"), database.session() as session:
        banks.add(session, "bench", [BankEntry(8.24, {}, identification_id=99)], who="Ana")
    with database.reading() as session:
        assert banks.find(session) == []


def test_first_end_state_stays(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        runs.end(session, run.id, EndState.TRIPPED, "force_limit")
        ended = runs.end(session, run.id, EndState.COMPLETED)
    assert (ended.end_state, ended.end_detail) == ("tripped", "force_limit")
    assert ended.ended_at is not None
    assert ended.ended_at >= ended.started_at


def test_interrupted_runs_are_closed_once(database: Database) -> None:
    with database.session() as session:
        open_run = runs.create(session, NEW_RUN)
        done = runs.create(session, NEW_RUN)
        runs.end(session, done.id, EndState.COMPLETED)
    with database.session() as session:
        assert runs.close_interrupted(session) == [open_run.id]
        assert runs.close_interrupted(session) == []
        assert runs.get(session, open_run.id).end_state == EndState.SERVICE_DIED
        assert runs.get(session, done.id).end_state == EndState.COMPLETED


def test_runs_are_found_newest_first_by_kind_and_end(database: Database) -> None:
    with database.session() as session:
        first = runs.create(session, NEW_RUN)
        second = runs.create(session, replace(NEW_RUN, kind=RunKind.TRACKING))
        runs.end(session, first.id, EndState.COMPLETED)
    with database.reading() as session:
        assert [run.id for run in runs.find(session)] == [second.id, first.id]
        assert [run.id for run in runs.find(session, kinds=[RunKind.TRACKING])] == [second.id]
        assert [run.id for run in runs.find(session, ended=EndState.COMPLETED)] == [first.id]
        assert [run.id for run in runs.find(session, limit=1)] == [second.id]
        assert [run.id for run in runs.of_numbers(session, [first.id, 99, second.id])] == [first.id, second.id]
        assert runs.count(session) == 2


def test_unknown_numbers_are_refused(database: Database) -> None:
    with database.reading() as session:
        with pytest.raises(UnknownRecordError, match="no run 7"):
            runs.get(session, 7)
        with pytest.raises(UnknownRecordError, match="no bank 7"):
            banks.get(session, 7)
        with pytest.raises(UnknownRecordError, match="no identification 7"):
            identifications.get(session, 7)


def test_computing_again_keeps_the_first_result(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        assert results.newest(session, run.id) is None
        first = results.add(session, NewResult(run.id, METRICS, (CRITERION,), "0.1.0"))
        second = results.add(session, NewResult(run.id, replace(METRICS, figures=()), (), "0.2.0"))
        assert results.newest(session, run.id) == second
        assert first.id != second.id


def test_report_comes_back_byte_for_byte(database: Database) -> None:
    content = bytes(range(256))
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        results.add_report(session, run.id, "pdf", content)
    with database.reading() as session:
        report = results.newest_report(session, run.id, "pdf")
        assert report is not None
        assert report.content == content
        assert results.newest_report(session, run.id, "html") is None


def test_nan_in_a_document_is_refused_and_nothing_is_stored(database: Database) -> None:
    with pytest.raises((StorageError, ValueError), match="not JSON compliant"), database.session() as session:
        runs.create(session, replace(NEW_RUN, settings={"lam_q": float("nan")}))
    with database.reading() as session:
        assert runs.find(session) == []


def test_events_tell_who_and_when(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        events.add(session, "bank", "bench 2 activated", who="Ana", detail={"bank_id": 2})
        stop = events.add(session, "fault", "stop pressed", who="Bo", run_id=run.id, tick=1234)
    with database.reading() as session:
        assert events.find(session, run_id=run.id) == [stop]
        assert [event.who for event in events.find(session)] == ["Bo", "Ana"]
        assert events.find(session, kind="bank")[0].detail == {"bank_id": 2}


def test_settings_remember_earlier_values(database: Database) -> None:
    with database.session() as session:
        assert settings.newest(session, "active_bank") is None
        settings.save(session, "active_bank", 1, who="Ana")
        settings.save(session, "active_bank", None, who="Bo")
    with database.reading() as session:
        in_force = settings.newest(session, "active_bank")
        assert in_force is not None
        assert (in_force.value, in_force.who) == (None, "Bo")
        assert [setting.value for setting in settings.history(session, "active_bank")] == [None, 1]
