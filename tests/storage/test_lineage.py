"""The lineage of runs and gains."""

import hashlib
import itertools
import json
import struct
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from backend.models.run import MeasuredFigure, Metrics, RunCriterion
from backend.recording.codec import compute_recording_digest, pack_table
from backend.schemas.run import LineageKind, LineageNode
from backend.services import record_messages
from backend.services.lineage import RunHistory
from backend.storage import banks, commissioning, events, identifications, recordings, results, runs, settings
from backend.storage.banks import BankEntry
from backend.storage.commissioning import NewStepResult
from backend.storage.database import Database, Session
from backend.storage.identifications import NewIdentification
from backend.storage.orm import StorageError, UnknownRecordError
from backend.storage.recordings import Chunk
from backend.storage.results import NewResult
from backend.storage.runs import EndState, NewRun, RunKind
from plant.interface import NAME_MAX
from plant.parameters import load_parameters
from tests.models.earlier_identifications import ACTUATOR
from tests.refusals import refused

# Each gain in use can be walked back to the samples and parameters it came from.

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
    figures=(MeasuredFigure("overshoot", "%", "Overshoot", "largest overshoot, in percent of its step", 0.5),),
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


def test_a_run_stores_the_full_name_of_its_plant(database: Database) -> None:
    name = "x" * NAME_MAX
    with database.session() as session:
        run = runs.create(session, replace(NEW_RUN, plant=name))
    with database.reading() as session:
        assert runs.get(session, run.id).plant == name


def test_a_bank_is_traced_back_to_its_run(database: Database) -> None:
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


def test_a_bank_with_the_same_name_is_the_next_version(database: Database) -> None:
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


def test_a_bank_with_an_unknown_identification_is_rejected_as_a_whole(database: Database) -> None:
    with pytest.raises(StorageError, match=r"(?i)foreign key"), database.session() as session:
        banks.add(session, "bench", [BankEntry(8.24, {}, identification_id=99)], who="Ana")
    with database.reading() as session:
        assert banks.find(session) == []


def test_the_first_end_state_remains(database: Database) -> None:
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
        with refused(UnknownRecordError, "record_not_found", record="run", number=7):
            runs.get(session, 7)
        with refused(UnknownRecordError, "record_not_found", record="bank", number=7):
            banks.get(session, 7)
        with refused(UnknownRecordError, "record_not_found", record="identification", number=7):
            identifications.get(session, 7)


def test_a_second_computation_keeps_the_first_result(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        assert results.newest(session, run.id) is None
        first = results.add(session, NewResult(run.id, METRICS, (CRITERION,), "0.1.0"))
        second = results.add(session, NewResult(run.id, replace(METRICS, figures=()), (), "0.2.0"))
        assert results.newest(session, run.id) == second
        assert first.id != second.id


def test_a_report_is_read_back_byte_for_byte(database: Database) -> None:
    content = bytes(range(256))
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        results.add_report(session, run.id, "pdf", content)
    with database.reading() as session:
        report = results.newest_report(session, run.id, "pdf")
        assert report is not None
        assert report.content == content
        assert results.newest_report(session, run.id, "html") is None


def test_nan_in_a_document_is_rejected_and_nothing_is_stored(database: Database) -> None:
    with pytest.raises((StorageError, ValueError), match="not JSON compliant"), database.session() as session:
        runs.create(session, replace(NEW_RUN, settings={"lam_q": float("nan")}))
    with database.reading() as session:
        assert runs.find(session) == []


def test_events_have_author_and_time(database: Database) -> None:
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        events.add(session, "bank", "bench 2 activated", who="Ana", detail={"bank_id": 2})
        stop = events.add(session, "fault", "stop pressed", who="Bo", run_id=run.id, tick=1234)
    with database.reading() as session:
        assert events.find(session, run_id=run.id) == [stop]
        assert [event.who for event in events.find(session)] == ["Bo", "Ana"]
        assert events.find(session, kind="bank")[0].detail == {"bank_id": 2}


def test_settings_store_earlier_values(database: Database) -> None:
    with database.session() as session:
        assert settings.newest(session, "active_bank") is None
        settings.save(session, "active_bank", 1, who="Ana")
        settings.save(session, "active_bank", None, who="Bo")
    with database.reading() as session:
        in_force = settings.newest(session, "active_bank")
        assert in_force is not None
        assert (in_force.value, in_force.who) == (None, "Bo")
        assert [setting.value for setting in settings.history(session, "active_bank")] == [None, 1]


# The lineage of a run as boxes: what came from what, with digests that anybody can compute, and what holds no more.

LAB = load_parameters("lab")
SAMPLES = np.arange(60, dtype=np.float32).reshape(20, 3)
FIELDS = ["q", "S", "F_A"]
NEW = NewRun(RunKind.ACTUATOR_IDENTIFICATION, "simulator", "lab", LAB.to_document(), "Ana", "1.0.0")
ESTIMATE = NewIdentification(
    kind="actuator",
    run_id=None,
    method="default",
    usable=True,
    verdict="usable",
    who="Ana",
    software="1.0.0",
    **ACTUATOR,
)


def sha256(document: Any) -> str:
    """Return the digest of a document in its public form: JSON without spaces, keys in order."""
    return hashlib.sha256(
        json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
    ).hexdigest()


def recorded(session: Session, new: NewRun, cuts: tuple[int, ...] = (0, 20), first_tick: int = 100) -> int:
    """Store a run with ``SAMPLES``, in chunks cut like that."""
    run = runs.create(session, new)
    recordings.begin(session, run.id, FIELDS, 1e-3)
    for begin, end in itertools.pairwise(cuts):
        chunk = Chunk(first_tick + begin, end - begin, b"", pack_table(SAMPLES[begin:end]))
        recordings.add_chunks(session, run.id, [chunk])
    runs.end(session, run.id, EndState.COMPLETED)
    return run.id


def boxes(database: Database, run: int, largest_bytes: int = 10**9) -> dict[str, LineageNode]:
    lineage = RunHistory(database, LAB, lambda: None, largest_bytes).build_lineage(run)
    assert lineage.nodes[0].id == f"run-{run}"
    return {node.id: node for node in lineage.nodes}


def test_gains_are_traced_back_to_samples_and_parameters(database: Database) -> None:
    with database.session() as session:
        source = recorded(session, NEW)
        estimate = identifications.add(session, replace(ESTIMATE, run_id=source))
        bank = banks.add(session, "bench", [BankEntry(10.5, {"S_nominal": 10.5}, estimate.id)], who="Ana")
        settings = {"loop": {"lam_q": 0.6, "bank": bank.id}}
        run = recorded(session, replace(NEW, kind=RunKind.TRACKING, settings=settings, bank_id=bank.id))
    found = boxes(database, run)
    parameters = f"parameters-{sha256(LAB.to_document())[:16]}"
    assert {name: node.origins for name, node in found.items()} == {
        f"run-{run}": ["gains", parameters],
        "gains": [f"bank-{bank.id}"],
        f"bank-{bank.id}": [f"identification-{estimate.id}"],
        f"identification-{estimate.id}": [f"data-{source}"],
        f"data-{source}": [parameters],
        parameters: [],
    }
    assert found[f"bank-{bank.id}"].bank == bank.id
    assert found[f"identification-{estimate.id}"].identification == source
    assert found[f"data-{source}"].run == source
    assert [node.out_of_date for node in found.values()] == [""] * 6
    content = [{"S_nominal": 10.5, "model": {"S_nominal": 10.5}}]
    assert found[f"bank-{bank.id}"].sha256 == sha256(content)
    assert found["gains"].sha256 == sha256(
        {"loop": {"lam_q": 0.6}, "from": sha256(content)}
    )  # whatever the bank's number
    assert found[parameters].sha256 == sha256(LAB.to_document())
    assert found[f"data-{source}"].sha256 == found[f"run-{run}"].sha256
    whole = {"data": ESTIMATE.data, "method": "default", "options": ESTIMATE.options, "model": ESTIMATE.model}
    assert found[f"identification-{estimate.id}"].sha256 == sha256(whole)

    forth = boxes(database, source)
    assert forth[f"identification-{estimate.id}"].origins == [f"run-{source}"]
    assert forth[f"bank-{bank.id}"].origins == [f"identification-{estimate.id}"]
    assert forth["gains"].origins == [parameters]


def test_outdated_sources_are_marked_in_the_lineage(database: Database) -> None:
    document = LAB.to_document()
    other = {**document, "geometry": {**document["geometry"], "r_j": {**document["geometry"]["r_j"], "value": 0.08}}}
    with database.session() as session:
        source = recorded(session, replace(NEW, parameters=other))
        estimate = identifications.add(session, replace(ESTIMATE, run_id=source))
        bank = banks.add(session, "bench", [BankEntry(10.5, {}, estimate.id)], who="Ana")
        run = recorded(session, replace(NEW, kind=RunKind.TRACKING, bank_id=bank.id))
        again = recorded(session, NEW)
        identifications.add(session, replace(ESTIMATE, run_id=again, usable=False))
    assert (
        boxes(database, run)[f"identification-{estimate.id}"].out_of_date == ""
    )  # what is not usable replaces nothing
    with database.session() as session:
        identifications.add(session, replace(ESTIMATE, run_id=again))
        banks.add(session, "bench", [BankEntry(10.5, {})], who="Ana")
        recordings.mark_removed(session, source, "deleted")
        recordings.remove_chunks(session, source, 10)
    found = boxes(database, run)
    assert found[f"identification-{estimate.id}"].out_of_date == record_messages.identified_again(run=again)
    newer, again_at_point = record_messages.newer_version_of_bank(version=2), record_messages.point_identified_again()
    assert found[f"bank-{bank.id}"].out_of_date == f"{newer}; {again_at_point}"
    data = found[f"data-{source}"]
    assert data.out_of_date == record_messages.samples_deleted()
    assert data.sha256 is None
    assert "deleted" in data.no_sha256
    marks = {node.id: node.out_of_date for node in found.values() if node.kind is LineageKind.PARAMETERS}
    assert sorted(marks.values()) == [
        "",
        record_messages.parameters_differ(changes=[("geometry.r_j", 0.08, 0.075)], more=0),
    ]


def test_lineage_has_the_calibrations_of_the_station_at_the_start_of_the_run(database: Database) -> None:
    step = NewStepResult("tare", "card", "f" * 64, True, "", "Ana", calibrations=[{"tendon": "A", "offset": 0.1}])
    with database.session() as session:
        before = commissioning.add(session, step)
        run = recorded(session, replace(NEW, plant="rig"))
        session.execute(
            text("UPDATE run SET started_at = :at"),
            {"at": (datetime.now(UTC) + timedelta(seconds=1)).replace(tzinfo=None)},
        )
        simulated = recorded(session, NEW)
    (box,) = [node for node in boxes(database, run).values() if node.kind is LineageKind.CALIBRATION]
    assert box.sha256 == sha256([{"step": "tare", "fingerprint": "f" * 64, "calibrations": before.calibrations}])
    assert box.out_of_date == ""
    assert not [node for node in boxes(database, simulated).values() if node.kind is LineageKind.CALIBRATION]
    with database.session() as session:
        later = commissioning.add(session, step)
        session.execute(
            text("UPDATE bring_up SET at = :at WHERE id = :id"),
            {"at": (datetime.now(UTC) + timedelta(hours=1)).replace(tzinfo=None), "id": later.id},
        )
    (box,) = [node for node in boxes(database, run).values() if node.kind is LineageKind.CALIBRATION]
    assert box.out_of_date == "repeated since: tare"


def test_the_digest_of_a_recording_does_not_depend_on_its_chunks(database: Database) -> None:
    head = json.dumps({"fields": FIELDS, "period_s": 1e-3}, separators=(",", ":")).encode() + b"\n"
    raw = SAMPLES.astype("<f4").tobytes()
    expected = hashlib.sha256(head + struct.pack("<q", 0) + raw).hexdigest()
    with database.session() as session:
        same = [recorded(session, NEW, cuts, tick) for cuts, tick in (((0, 20), 0), ((0, 7, 20), 5000))]
        missing = runs.create(session, NEW).id
        recordings.begin(session, missing, FIELDS, 1e-3)
        for begin, end in ((0, 7), (9, 20)):
            recordings.add_chunks(session, missing, [Chunk(begin, end - begin, b"", pack_table(SAMPLES[begin:end]))])
    with database.reading() as session:
        assert [compute_recording_digest(session, run) for run in same] == [expected, expected]
        row = 3 * 4
        gap = head + struct.pack("<q", 0) + raw[: 7 * row] + struct.pack("<q", 9) + raw[9 * row :]
        assert compute_recording_digest(session, missing) == hashlib.sha256(gap).hexdigest()
    assert boxes(database, missing)[f"run-{missing}"].no_sha256 == record_messages.run_still_in_progress()


@pytest.mark.parametrize("largest", [10**9, 1])
def test_a_long_recording_is_not_read_completely_while_a_page_waits(database: Database, largest: int) -> None:
    with database.session() as session:
        run = recorded(session, NEW)
    box = boxes(database, run, largest)[f"run-{run}"]
    assert (box.sha256 is None) == (largest == 1)
    assert ("sinew runs lineage" in box.no_sha256) == (largest == 1)
