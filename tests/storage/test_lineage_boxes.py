"""The lineage of a run as boxes: what came from what, with digests that anybody can compute, and what holds no more."""

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

from backend.recording.codec import compute_recording_digest, pack_table
from backend.schemas.run import LineageKind, LineageNode
from backend.services.lineage import RunHistory
from backend.storage import banks, commissioning, identifications, recordings, runs
from backend.storage.banks import BankEntry
from backend.storage.commissioning import NewStepResult
from backend.storage.database import Database, Session
from backend.storage.identifications import NewIdentification
from backend.storage.recordings import Chunk
from backend.storage.runs import EndState, NewRun, RunKind
from plant.parameters import load_parameters
from tests.models.earlier_identifications import ACTUATOR

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
    """Return the digest of a document as anybody can compute it: JSON without spaces, keys in order."""
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


def test_gains_are_walked_back_to_samples_and_parameters(database: Database) -> None:
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


def test_what_holds_no_more_is_marked_where_it_stands(database: Database) -> None:
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
    assert found[f"identification-{estimate.id}"].out_of_date == f"identified again in run {again}"
    assert found[f"bank-{bank.id}"].out_of_date == "version 2 of it is newer; an entry was identified again"
    data = found[f"data-{source}"]
    assert data.out_of_date == "the samples were deleted"
    assert data.sha256 is None
    assert "deleted" in data.no_sha256
    marks = {node.id: node.out_of_date for node in found.values() if node.kind is LineageKind.PARAMETERS}
    assert sorted(marks.values()) == ["", "the plant has others now: geometry.r_j 0.08, now 0.075"]


def test_calibrations_are_those_of_the_station_when_the_run_began(database: Database) -> None:
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
    assert box.out_of_date == "done again since: tare"


def test_a_recording_has_the_same_digest_however_it_is_cut(database: Database) -> None:
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
    assert boxes(database, missing)[f"run-{missing}"].no_sha256 == "the run is not over"


@pytest.mark.parametrize("largest", [10**9, 1])
def test_a_long_recording_is_not_read_through_while_a_page_waits(database: Database, largest: int) -> None:
    with database.session() as session:
        run = recorded(session, NEW)
    box = boxes(database, run, largest)[f"run-{run}"]
    assert (box.sha256 is None) == (largest == 1)
    assert ("sinew runs lineage" in box.no_sha256) == (largest == 1)
