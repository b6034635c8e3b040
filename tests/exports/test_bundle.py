"""Bundles of runs with their lineage."""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.exports import bundle
from backend.exports.base import ExportError, ImportRefusedError, export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import ImportResult, import_bundle
from backend.exports.importer import import_export as take_in_alone
from backend.models.document import document_digest
from backend.models.run import find_bank_changes
from backend.reports.evidence import ReportManifest, read_manifest
from backend.reports.verification import Verified, read_stored_samples, verify_report
from backend.services import record_messages
from backend.services.downloads import stream_bundle
from backend.storage import banks, identifications, origins, results, runs
from backend.storage.banks import BankEntry
from backend.storage.database import Database
from backend.storage.runs import RunKind
from tests.exports.stored import ESTIMATE, NEW, boxes, has_no_unpacked_files, read_all_rows, recorded
from tests.reasons import Reason, TextWith
from tests.refusals import refused

# A bundle transfers a run with its lineage to an empty installation; every change of the bundle is reported.


def test_a_bundle_is_imported_into_an_empty_installation_with_its_lineage(
    here: Database, there: Database, run: int, file: Path, tmp_path: Path
) -> None:
    with there.session() as session:  # so that all numbers differ
        recorded(session)
    assert import_bundle(there, file, "Ben", tmp_path / "there") == ImportResult(run=3, was=2, new=True)
    before, after = boxes(here, run), boxes(there, 3)
    assert list(after) == list(before)
    assert {key.split()[0] for key in after} == {
        "run", "gains", "bank", "identification", "data", "parameters", "calibration",
    }  # fmt: skip
    assert [node.title for node in after.values() if node.bank] == ["bench v1"]
    with here.reading() as one, there.reading() as other:
        theirs, ours = runs.get(one, run), runs.get(other, 3)
        assert ours.started_at == theirs.started_at
        assert ours.bank_id is not None
        assert banks.get(other, ours.bank_id).entries[0].identification_id == 1
        assert ours.settings["loop"]["bank"] == ours.bank_id
        first, second = results.newest(one, run), results.newest(other, 3)
        assert first is not None
        assert second is not None
        assert (second.metrics, second.criteria) == (first.metrics, first.criteria)
    assert has_no_unpacked_files(tmp_path / "there")


def test_a_report_from_a_bundle_is_verified_after_the_import(there: Database, file: Path, tmp_path: Path) -> None:
    run = import_bundle(there, file, "Ben", tmp_path).run
    with there.reading() as session:
        kept = results.newest_report(session, run, "html")
        assert kept is not None
        page = kept.content.decode()
    report_manifest = read_manifest(page)
    assert isinstance(report_manifest, ReportManifest)
    columns, number = read_stored_samples(there, report_manifest)
    assert number == run
    assert verify_report(page, columns) == Verified((), ())


def test_a_second_import_of_a_bundle_is_reported_and_changes_nothing(
    here: Database, there: Database, run: int, file: Path, tmp_path: Path
) -> None:
    assert import_bundle(there, file, "Ben", tmp_path).new
    before = read_all_rows(there)
    assert import_bundle(there, file, "Ben", tmp_path) == ImportResult(run=2, was=2, new=False)
    assert read_all_rows(there) == before
    before = read_all_rows(here)
    assert import_bundle(here, file, "Ben", tmp_path) == ImportResult(run=run, was=2, new=False)
    assert read_all_rows(here) == before


def test_an_imported_run_can_be_bundled_again(
    there: Database, run: int, file: Path, tmp_path: Path, here: Database
) -> None:
    taken = import_bundle(there, file, "Ben", tmp_path)
    file.write_bytes(b"".join(stream_bundle(there, taken.run, tmp_path)))
    assert import_bundle(here, file, "Ana", tmp_path) == ImportResult(run=run, was=taken.run, new=False)


def test_every_changed_byte_of_a_bundle_is_detected(there: Database, file: Path, tmp_path: Path) -> None:
    whole, before = file.read_bytes(), read_all_rows(there)
    for place in range(0, len(whole), len(whole) // 40):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(ImportRefusedError):
            import_bundle(there, file, "Ben", tmp_path / "there")
    for length in (0, 10, 100, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:length])
        with pytest.raises(ImportRefusedError):
            import_bundle(there, file, "Ben", tmp_path / "there")
    assert read_all_rows(there) == before
    assert has_no_unpacked_files(tmp_path / "there")


def remade(file: Path, change: Callable[[dict[str, bytes]], None], compression: int = zipfile.ZIP_STORED) -> None:
    """Rewrite a bundle with changed members and a correct digest."""
    with zipfile.ZipFile(file) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.comment = bytes(bundle.DIGEST_LENGTH)
        for name, content in members.items():
            archive.writestr(name, content)
    whole = buffer.getvalue()[: -bundle.DIGEST_LENGTH]
    file.write_bytes(whole + hashlib.sha256(whole).hexdigest().encode())


def edited(name: str, change: Callable[[Any], None]) -> Callable[[dict[str, bytes]], None]:
    def edit(members: dict[str, bytes]) -> None:
        document = json.loads(members[name])
        change(document)
        members[name] = json.dumps(document).encode()

    return edit


HUGE = "1e999"
"""Stands in records without quotes: a number that JSON can write and nothing can hold."""


def first(document: Any, kind: str) -> Any:
    return next(record["document"] for record in document["records"] if record["kind"] == kind)


def last(document: Any) -> Any:
    """Return the run for which the bundle was written."""
    return [record["document"] for record in document["records"] if record["kind"] == "run"][-1]


@pytest.mark.parametrize(
    ("change", "code", "values"),
    [
        (
            edited("records.json", lambda d: first(d, "bank").update(name="other")),
            "content_changed",
            {"name": "bank 1"},
        ),
        (
            edited("records.json", lambda d: first(d, "result").update(software="2")),
            "content_changed",
            {"name": "result 1"},
        ),
        (edited("records.json", lambda d: first(d, "run")["parameters"].clear()), "content_changed", {"name": "run 1"}),
        (
            edited("records.json", lambda d: d["records"][0]["carried"].update(x=1)),
            "content_changed",
            {"name": "run 1"},
        ),
        (edited("manifest.json", lambda d: d.update(format=2)), "manifest_of_another_format", {"version": 1}),
        (edited("manifest.json", lambda d: d.update(run=1)), "records_of_another_run", {"run_id": 1}),
        (
            edited("manifest.json", lambda d: d["records"].update({"bank 1": "0"})),
            "record_differs_from_manifest",
            {"record": "bank 1"},
        ),
        (
            edited("manifest.json", lambda d: d["members"].pop("reports/2.html")),
            "member_not_in_manifest",
            {"member": "reports/2.html"},
        ),
        (
            lambda m: m.update({"recordings/2.parquet": m["recordings/1.parquet"]}),
            "content_changed",
            {"name": "recordings/2.parquet"},
        ),
        (lambda m: m.update({"reports/2.html": b"<html>"}), "content_changed", {"name": "reports/2.html"}),
        (lambda m: m.pop("recordings/1.parquet"), "member_missing", {"member": "recordings/1.parquet"}),
        (lambda m: m.pop("manifest.json"), "bundle_without_member", {"member": "manifest.json"}),
        (lambda m: m.update({"../../escaped.json": b""}), "member_not_allowed", {"member": "../../escaped.json"}),
        (lambda m: m.update({"/escaped.json": b""}), "member_not_allowed", {"member": "/escaped.json"}),
        (
            lambda m: m.update({"recordings/9.parquet": b""}),
            "member_not_in_manifest",
            {"member": "recordings/9.parquet"},
        ),
        (
            lambda m: m.update({"records.json": b"[" * 100_000}),
            "member_unreadable",
            {"member": "records.json", "reason": Reason("nested_too_deeply")},
        ),
    ],
)
def test_the_rejection_of_a_bundle_names_the_change(
    there: Database,
    file: Path,
    tmp_path: Path,
    change: Callable[[dict[str, bytes]], None],
    code: str,
    values: dict[str, object],
) -> None:
    before = read_all_rows(there)
    remade(file, change)
    with refused(ImportRefusedError, code, **values):
        import_bundle(there, file, "Ben", tmp_path / "there")
    assert read_all_rows(there) == before


def forged(change: Callable[[Any], None], *, alone: bool = False) -> Callable[[dict[str, bytes]], None]:
    """Change records and correct all hashes; ``alone`` omits samples and report."""

    def forge(members: dict[str, bytes]) -> None:
        document, manifest = json.loads(members["records.json"]), json.loads(members["manifest.json"])
        for name in [name for name in members if alone and "/" in name]:
            del members[name], manifest["members"][name]
        change(document)
        text = json.dumps(document)
        members["records.json"] = text.replace(f'"{HUGE}"', HUGE).encode()
        manifest["members"]["records.json"]["sha256"] = hashlib.sha256(members["records.json"]).hexdigest()
        manifest["records"] = {
            bundle.get_record_name(record): document_digest(record) for record in document["records"]
        }
        members["manifest.json"] = json.dumps(manifest).encode()

    return forge


@pytest.mark.parametrize(
    ("change", "code", "values"),
    [
        (
            lambda d: first(d, "result").update(run_id=9),
            "record_refused",
            {"record": "result 1", "reason": Reason("record_not_before", kind="run", number=9)},
        ),
        (
            lambda d: first(d, "result").update(metrics={"version": 1}),
            "record_refused",
            {"record": "result 1"},
        ),
        (
            lambda d: first(d, "identification").update(usable="yes"),
            "record_refused",
            {"reason": Reason("part_unfit", part="usable of the identification", value="yes")},
        ),
        (
            lambda d: first(d, "identification").update(model=[]),
            "record_refused",
            {"record": "identification 1"},
        ),
        (
            lambda d: d["records"].append(d["records"][0] | {"kind": "setting", "number": 1}),
            "record_refused",
            {"reason": Reason("unknown_record_kind", record="setting")},
        ),
        (
            lambda d: first(d, "run").update(who="Bob"),
            "recording_refused",
            {"member": "recordings/1.parquet", "reason": Reason("recording_of_another_run")},
        ),
        (lambda d: d["records"].reverse(), "record_refused", {"reason": Reason("record_not_before")}),
        (
            lambda d: first(d, "bank").pop("note"),
            "record_refused",
            {"reason": Reason("wrong_parts_of_record", record="bank")},
        ),
        (
            lambda d: first(d, "bank")["entries"][0].update(S_nominal="x"),
            "record_refused",
            {"reason": Reason("part_unfit", part="S_nominal of the bank entry", value="x")},
        ),
        (
            lambda d: first(d, "bank")["entries"][0].update(S_nominal=-5),
            "record_refused",
            {"reason": Reason("part_unfit", part="S_nominal of the bank entry", value=-5)},
        ),
        (
            lambda d: first(d, "bank")["entries"][0].update(model={"x": 1}),
            "record_refused",
            {"reason": Reason("part_unfit", part="model of the bank entry", value={"x": 1})},
        ),
        (
            lambda d: first(d, "bank").update(entries=5),
            "record_refused",
            {"reason": Reason("part_unfit", part="entries of the bank", value=5)},
        ),
        (
            lambda d: first(d, "bank").update(created_at="0001-01-01T00:00:00+14:00"),
            "record_refused",
            {"reason": Reason("part_unfit", part="created_at of the bank")},
        ),
        (
            lambda d: first(d, "bank").update(note=HUGE),
            "member_unreadable",
            {"reason": Reason("number_too_large", number="1e999")},
        ),
        (
            lambda d: first(d, "bank").update(note="\ud800"),
            "member_unreadable",
            {"reason": TextWith("an unpaired surrogate")},
        ),
        (
            lambda d: first(d, "bank").update(note="\0"),
            "member_unreadable",
            {"reason": TextWith("a control character")},
        ),
        (
            lambda d: last(d)["parameters"].update(zz={"a": {"value": 10**400}}),
            "member_unreadable",
            {"reason": Reason("too_many_digits", digits=401, maximum=18)},
        ),
        (
            lambda d: last(d)["parameters"].update(zz={"a": {"value": -(10**400)}}),
            "member_unreadable",
            {"reason": Reason("too_many_digits", digits=401, maximum=18)},
        ),
        (lambda d: d["records"][-1].update(number=10**17), "invalid_records", {"maximum": 2147483647}),
        (
            lambda d: first(d, "result").update(metrics=[]),
            "record_refused",
            {"reason": Reason("part_unfit", part="metrics of the result", needed="an object")},
        ),
        (
            lambda d: last(d).update(parameters=[]),
            "record_refused",
            {"reason": Reason("part_unfit", part="parameters of the run", needed="an object")},
        ),
        (
            lambda d: last(d).update(kind="nonsense"),
            "record_refused",
            {"reason": Reason("part_unfit", part="kind of the run", value="nonsense")},
        ),
        (
            lambda d: last(d).update(end_state="flying"),
            "record_refused",
            {"reason": Reason("part_unfit", part="end_state of the run", value="flying")},
        ),
        (
            lambda d: last(d).update(end_state="running"),
            "record_refused",
            {"reason": Reason("exported_run_not_over")},
        ),
        (
            lambda d: last(d).update(ended_at="1999-01-01T00:00:00+00:00"),
            "record_refused",
            {"reason": Reason("part_unfit", part="ended_at of the run", value="1999-01-01T00:00:00+00:00")},
        ),
        (
            lambda d: last(d)["settings"]["loop"].update(bank=55),
            "record_refused",
            {"reason": Reason("part_unfit", part="settings.loop.bank of the run", value=55, needed="its bank_id, 1")},
        ),
        (
            lambda d: d["records"][0]["carried"].update(calibrations={"x": 1}),
            "record_refused",
            {"reason": Reason("part_unfit", part="carried.calibrations")},
        ),
        (
            lambda d: d["records"][0]["carried"].update(banks=["1"]),
            "record_refused",
            {"reason": Reason("part_unfit", part="carried.banks")},
        ),
        (
            lambda d: d["records"][1]["carried"].update(x=1),
            "record_refused",
            {"reason": Reason("part_unfit", part="a part of the document", value="x")},
        ),
    ],
)
def test_forged_records_with_correct_hashes_are_rejected(
    there: Database, file: Path, tmp_path: Path, change: Callable[[Any], None], code: str, values: dict[str, object]
) -> None:
    before = read_all_rows(there)
    # without samples only the record of the run is checked
    remade(file, forged(change, alone=code != "recording_refused"))
    with refused(ImportRefusedError, code, **values):
        import_bundle(there, file, "Ben", tmp_path / "there")
    assert read_all_rows(there) == before
    assert has_no_unpacked_files(tmp_path / "there")


def test_a_bundle_with_compressed_members_is_rejected(there: Database, file: Path, tmp_path: Path) -> None:
    remade(file, lambda members: members.update({"reports/2.html": bytes(50_000_000)}), zipfile.ZIP_DEFLATED)
    assert file.stat().st_size < 5_000_000
    with refused(ImportRefusedError, "member_compressed", member="records.json"):
        import_bundle(there, file, "Ben", tmp_path / "there")


def test_a_run_that_has_not_ended_is_not_bundled(here: Database, tmp_path: Path) -> None:
    with here.session() as session:
        run = runs.create(session, NEW).id
    with refused(ExportError, "run_not_ended", run_id=1):
        b"".join(stream_bundle(here, run, tmp_path))


# A bundle contains all banks of its run under their local numbers; each station imports its own copy.


def test_a_bundle_adds_the_bank_to_a_run_that_was_imported_without_it(
    here: Database, there: Database, run: int, file: Path, tmp_path: Path
) -> None:
    with there.session() as session:  # with the number of the bank of the run
        banks.add(session, "other", [BankEntry(1.0, {"tension_N": 1.0})], who="Eve")
    write_export(export_run(here, run), DataFormat.PARQUET, tmp_path / "run.parquet")
    alone = take_in_alone(there, tmp_path / "run.parquet", "Ben").run
    with there.reading() as session:
        assert "bank" not in runs.get(session, alone).settings["loop"]
        assert origins.of_runs(session, [alone])[alone].carried == {"banks": [1]}
    (gains,) = [box for box in boxes(there, alone).values() if box.kind == "gains"]
    assert gains.no_sha256 == record_messages.bank_not_imported()
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
def test_a_bundle_contains_the_banks_that_its_run_activates(
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


def test_a_run_with_a_computed_bank_number_is_not_bundled(here: Database, tmp_path: Path) -> None:
    run = changing_bank(here, COMPUTED)
    with refused(ExportError, "run_computes_bank", run_id=3, expression="1 + 1"):
        b"".join(bundle.write_bundle(here, run, None, tmp_path))
    (gains,) = [box for box in boxes(here, run).values() if box.kind == "gains"]
    assert gains.no_sha256 == record_messages.bank_numbers_computed(expressions=["1 + 1"])


def test_each_station_of_a_database_imports_its_own_copy(there: Database, run: int, file: Path, tmp_path: Path) -> None:
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
