"""The banks of a run come with it, whenever it used them, and go by their numbers here; each station has its own."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.exports import bundle
from backend.exports.base import ExportError, export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import ImportResult, import_bundle
from backend.exports.importer import import_export as take_in_alone
from backend.models.run import find_bank_changes
from backend.storage import banks, identifications, origins, results, runs
from backend.storage.banks import BankEntry
from backend.storage.database import Database
from backend.storage.runs import RunKind
from tests.exports.stored import ESTIMATE, NEW, boxes, recorded


def test_a_run_that_was_imported_alone_is_given_its_bank(
    here: Database, there: Database, run: int, file: Path, tmp_path: Path
) -> None:
    with there.session() as session:  # which has the number of the run's own
        banks.add(session, "other", [BankEntry(1.0, {"tension_N": 1.0})], who="Eve")
    write_export(export_run(here, run), DataFormat.PARQUET, tmp_path / "run.parquet")
    alone = take_in_alone(there, tmp_path / "run.parquet", "Ben").run
    with there.reading() as session:
        assert "bank" not in runs.get(session, alone).settings["loop"]
        assert origins.of_runs(session, [alone])[alone].carried == {"banks": [1]}
    (gains,) = [box for box in boxes(there, alone).values() if box.kind == "gains"]
    assert gains.no_sha256 == "its bank was not imported with it: a bundle has it"
    assert import_bundle(there, file, "Ben", tmp_path) == ImportResult(run=alone, was=run, new=True)
    with there.reading() as session:
        found = runs.get(session, alone)
        assert (found.bank_id, found.settings["loop"]["bank"]) == (2, 2)
    assert list(boxes(there, alone)) == list(boxes(here, run))
    assert import_bundle(there, file, "Ben", tmp_path) == ImportResult(run=alone, was=run, new=False)


BY_NUMBER = {"do": "tuning", "bank": 2}
BY_SETTING = {"do": "tuning", "bank": "which"}
COMPUTED = {"do": "tuning", "bank": "1 + 1"}


def changing_bank(database: Database, *changes: dict[str, Any]) -> int:
    """Store a run that began with one bank and changes to another."""
    which = {"name": "which", "kind": "integer", "symbol": "n", "meaning": "a bank", "default": 1}
    parts = [part for change in changes for part in (change, {"do": "hold", "duration_s": 1.0})]
    own: Any = {"format": 1, "name": "own", "title": "Own", "settings": [{**which, "minimum": 1, "maximum": 2}]}
    own["phases"] = [{"name": "a", "title": "A", "parts": [{"do": "choose", "by": "way", "of": {"x": parts}}]}]
    plan = {"experiment": json.dumps(own), "which": 2, "way": "x"}
    named = {"symbol": "", "unit": "1", "meaning": ""}
    with database.session() as session:
        numbers = []
        for name in ("one", "two"):
            estimate = identifications.add(session, replace(ESTIMATE, run_id=recorded(session)))
            entry = BankEntry(10.5, {"tension_N": float(estimate.id)}, estimate.id)
            numbers.append(banks.add(session, name, [entry], who="Ana").id)
        declared = [{"name": "bank", "value": numbers[0], **named}, {"name": "which", "value": 2, **named}]
        settings = {"plan": plan, "loop": {"bank": numbers[0]}, "declared": declared, "version": 1}
        new = replace(NEW, kind=RunKind.EXPERIMENT, settings=settings, bank_id=numbers[0])
        return recorded(session, new)


@pytest.mark.parametrize("change", [BY_NUMBER, BY_SETTING])
def test_banks_that_a_run_changes_to_come_along(
    here: Database, there: Database, change: dict[str, Any], tmp_path: Path
) -> None:
    run = changing_bank(here, change)
    with there.session() as session:
        for name in ("a", "b", "c"):
            banks.add(session, name, [BankEntry(1.0, {"tension_N": 1.0})], who="Eve")
    file = tmp_path / "run.zip"
    file.write_bytes(b"".join(bundle.write_bundle(here, run, None, tmp_path)))
    taken = import_bundle(there, file, "Ben", tmp_path).run
    with there.reading() as session:
        found = runs.get(session, taken)
        of_name = {bank.name: bank.id for bank in banks.find(session)}
    assert found.bank_id == found.settings["loop"]["bank"] == of_name["one"] == 4
    assert find_bank_changes(found.settings).numbers == {of_name["two"]} == {5}
    which = 5 if change is BY_SETTING else 2
    assert [one["value"] for one in found.settings["declared"]] == [4, which]
    assert found.settings["plan"]["which"] == which
    before, after = boxes(here, run), boxes(there, taken)
    assert sorted(after) == sorted(before)
    assert sorted(box.title for box in after.values() if box.bank) == ["one v1", "two v1"]
    assert import_bundle(there, file, "Ben", tmp_path) == ImportResult(run=taken, was=run, new=False)
    assert import_bundle(here, file, "Ana", tmp_path) == ImportResult(run=run, was=run, new=False)


def test_a_bank_whose_number_is_computed_is_told(here: Database, tmp_path: Path) -> None:
    run = changing_bank(here, COMPUTED)
    with pytest.raises(ExportError, match=r"run 3 computes the number of a bank that it changes to, 1 \+ 1"):
        b"".join(bundle.write_bundle(here, run, None, tmp_path))
    (gains,) = [box for box in boxes(here, run).values() if box.kind == "gains"]
    assert gains.no_sha256 == "it computes the numbers of its banks: 1 + 1"


def test_stations_on_one_database_each_get_their_own(there: Database, run: int, file: Path, tmp_path: Path) -> None:
    other = Database(there.engine, station="rig-b")
    taken = [import_bundle(database, file, "Ben", tmp_path) for database in (there, other)]
    assert [one.new for one in taken] == [True, True]
    for database, one in zip((there, other), taken, strict=True):
        with database.reading() as session:
            found = runs.get(session, one.run)
            assert found.bank_id is not None
            assert banks.own(session, found.bank_id).name == "bench"
            assert len(identifications.find(session)) == 1
            assert results.newest(session, one.run) is not None
        assert import_bundle(database, file, "Ben", tmp_path) == ImportResult(one.run, run, new=False)
