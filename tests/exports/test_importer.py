"""Import of exports of this version and of earlier versions."""

import json
import re
import tracemalloc
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from scipy.io import savemat
from sqlalchemy import text

from backend.exports.base import SEAL, ExportError, ImportRefusedError, export_columns, export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import ImportResult, import_bundle, import_export
from backend.models.document import document_digest
from backend.models.upgrades import NO_STORED_REASON
from backend.recording.codec import compute_recording_digest
from backend.recording.reader import read_samples
from backend.services.downloads import stream_bundle
from backend.storage import identifications, origins, recordings, results, runs
from backend.storage.database import Database
from backend.storage.orm import UnknownRecordError
from tests.exports.stored import NEW, noise, read_all_rows, recorded
from tests.migrations.old_schema import migrated
from tests.models.earlier import BEFORE
from tests.models.earlier_identifications import BAND, QUALITY
from tests.reasons import Reason, TextWith
from tests.refusals import refused

# An export is imported as the original run, or rejected with a reason without storing anything.

CUTS = (700, 1_900)


@pytest.fixture
def run_imported(here: Database) -> int:
    with here.session() as session:
        recorded(session)
        return recorded(session, cuts=CUTS)


def exported(database: Database, run: int, kind: str, folder: Path) -> Path:
    file = folder / f"run.{kind}"
    write_export(export_run(database, run), DataFormat(kind), file)
    return file


def sealed(text: str) -> str:
    """Correct the digest of the metadata of a CSV, if the metadata is a document."""
    head, line, tail = re.split(r"(# sinew-export: .*)\n", text, maxsplit=1)
    try:
        said = json.loads(line.removeprefix("# sinew-export: "))
    except ValueError:
        return text
    said.pop(SEAL)
    return f"{head}# sinew-export: {json.dumps(said | {SEAL: document_digest(said)}, ensure_ascii=False)}\n{tail}"


@pytest.mark.parametrize("kind", DataFormat)
def test_an_imported_run_has_its_samples_gaps_parameters_and_settings(
    here: Database, there: Database, run_imported: int, kind: DataFormat, tmp_path: Path
) -> None:
    taken = import_export(there, exported(here, run_imported, kind, tmp_path), "Ben")
    assert taken == ImportResult(run=1, was=2, new=True)
    with here.reading() as one, there.reading() as other:
        before, after = runs.get(one, run_imported), runs.get(other, 1)
        assert vars(after) == vars(before) | {"id": 1}
        assert compute_recording_digest(other, 1) == compute_recording_digest(one, run_imported)
        theirs, ours = read_samples(one, run_imported), read_samples(other, 1)
        np.testing.assert_array_equal(ours.t, theirs.t)
        np.testing.assert_array_equal(ours.columns["q"], theirs.columns["q"])
        kept = recordings.get(other, 1)
        assert (kept.missed, kept.problem) == (10, "the disk was full")
        assert origins.of_runs(other, [1])[1].sentence == f"imported from run.{kind}, originally run 2"
    assert import_export(there, tmp_path / f"run.{kind}", "Ben") == ImportResult(run=1, was=2, new=False)
    assert import_export(here, tmp_path / f"run.{kind}", "Ben") == ImportResult(run=2, was=2, new=False)


@pytest.mark.parametrize("kind", DataFormat)
def test_an_export_with_one_changed_byte_is_rejected(
    here: Database, there: Database, run_imported: int, kind: DataFormat, tmp_path: Path
) -> None:
    file = exported(here, run_imported, kind, tmp_path)
    whole, before = file.read_bytes(), read_all_rows(there)
    changed = bytearray(whole)
    if kind is DataFormat.CSV:
        place = whole.rindex(b"1", 0, whole.rindex(b"\n", 0, -1))
        changed[place] = ord("2")
    else:
        changed[int(0.6 * len(whole))] ^= 0x10
    file.write_bytes(bytes(changed))
    with pytest.raises(ImportRefusedError):
        import_export(there, file, "Ben")
    file.write_bytes(whole[: int(0.7 * len(whole))])
    with pytest.raises(ImportRefusedError):
        import_export(there, file, "Ben")
    assert read_all_rows(there) == before


def test_a_csv_with_inconsistent_metadata_is_rejected(
    here: Database, there: Database, run_imported: int, tmp_path: Path
) -> None:
    file = exported(here, run_imported, "csv", tmp_path)
    whole, before = file.read_text(encoding="utf-8"), read_all_rows(there)
    for said, other, code, values in (
        ('"format":1', '"format":2', "metadata_of_another_format", {"version": 1}),
        ('"samples":2300', '"samples":2299', "wrong_number_of_samples", {"samples": 2300, "stated": 2299}),
        ('"period_s":0.001', '"period_s":0.0015', "times_not_multiples", {"period_s": 0.0015}),
        ('"of":"run 2"', '"of":"trip 2"', "not_of_a_run", {"content": "trip 2"}),
        (
            '"end_state":"completed"',
            '"end_state":"running"',
            "invalid_run",
            {"reason": Reason("exported_run_not_over")},
        ),
        (
            '"end_state":"completed"',
            '"end_state":7',
            "invalid_run",
            {"reason": Reason("part_unfit", part="end_state of the run", value=7)},
        ),
        (
            '"kind":"actuator_identification",',
            "",
            "invalid_run",
            {"reason": Reason("wrong_parts_of_record", record="run")},
        ),
        ('"who":"Ana"', f'"who":"{"x" * 201}"', "invalid_run", {"reason": Reason("part_unfit", part="who of the run")}),
        ('"run":{', '"run":[],"was":{', "invalid_metadata", {"name": "run"}),
        ("# sinew-export: {", "# sinew-export: [", "metadata_unreadable", {}),
        ('"value":0.075', '"value":0.076', "metadata_changed", {}),
        ("\n0.001,", "\n0.003,", "times_do_not_increase", {}),
        ("\n0.001,", "\nnan,", "times_not_multiples", {}),
        ("t,q,q_ref", "t,q_ref,q", "header_row_differs", {}),
    ):
        assert said in whole
        changed = whole.replace(said, other, 1)
        file.write_text(changed if code == "metadata_changed" else sealed(changed), encoding="utf-8")
        with refused(ImportRefusedError, code, **values):
            import_export(there, file, "Ben")
    assert read_all_rows(there) == before


def test_a_csv_with_a_byte_order_mark_is_imported(
    here: Database, there: Database, run_imported: int, tmp_path: Path
) -> None:
    file = exported(here, run_imported, "csv", tmp_path)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert import_export(there, file, "Ben") == ImportResult(run=1, was=2, new=True)
    with here.reading() as one, there.reading() as other:
        assert compute_recording_digest(other, 1) == compute_recording_digest(one, run_imported)


def test_an_export_that_contradicts_a_stored_run_is_rejected(here: Database, run_imported: int, tmp_path: Path) -> None:
    file = exported(here, run_imported, "csv", tmp_path)
    whole = file.read_text(encoding="utf-8")
    file.write_text(sealed(whole.replace('"who":"Ana"', '"who":"Bob"', 1)), encoding="utf-8")
    with refused(ImportRefusedError, "record_differs", record="run", number=2):
        import_export(here, file, "Ben")


def test_only_exports_of_runs_are_imported(there: Database, tmp_path: Path) -> None:
    trip = export_columns({"t": np.array([0.0, 0.001, 0.002]), "q": np.zeros(3)}, "trip 4")
    write_export(trip, DataFormat.CSV, tmp_path / "trip.csv")
    (tmp_path / "other.csv").write_text("t,q\n0,1\n")
    (tmp_path / "other.parquet").write_bytes(b"PAR1")
    (tmp_path / "other.mat").write_bytes(b"MATLAB" + bytes(300))
    (tmp_path / "other.mcap").write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "binary.csv").write_bytes(b"# \xff\xfe\n")
    (tmp_path / "other.xlsx").write_bytes(b"")
    for name in ("trip.csv", "other.csv", "other.parquet", "other.mat", "other.mcap", "binary.csv", "other.xlsx"):
        with pytest.raises(ImportRefusedError):
            import_export(there, tmp_path / name, "Ben")


SWOLLEN = b" " * (16 << 20)


def mcap_that_swells(file: Path, facts: str) -> None:
    with file.open("wb") as opened:
        writer = Writer(opened, chunk_size=1 << 30)
        writer.start(profile="", library="")
        writer.add_metadata("sinew", {"facts": facts})
        channel = writer.register_channel("/sample", "json", writer.register_schema("s", "jsonschema", b"{}"))
        writer.add_message(channel, 0, SWOLLEN, 0)
        writer.finish()  # type: ignore[no-untyped-call]  # as in the exporter


def mat_that_swells(file: Path, facts: str) -> None:
    savemat(file, {"sinew_export": facts + SWOLLEN.decode()}, do_compression=True)


@pytest.mark.parametrize(
    ("kind", "swell", "code", "values"),
    [
        ("mcap", mcap_that_swells, "chunk_too_large", {"size": pytest.approx(16.75e6, rel=3e-3), "maximum": 8388608}),
        ("mat", mat_that_swells, "file_compressed", {}),
    ],
)
def test_a_decompression_bomb_is_rejected_before_decompression(
    here: Database,
    there: Database,
    run_imported: int,
    kind: str,
    swell: Callable[[Path, str], None],
    code: str,
    values: dict[str, object],
    tmp_path: Path,
) -> None:
    file = tmp_path / f"run.{kind}"
    swell(file, export_run(here, run_imported).facts.to_json())
    assert file.stat().st_size < 1 << 20
    tracemalloc.start()
    with refused(ImportRefusedError, code, **values):
        import_export(there, file, "Ben")
    assert tracemalloc.get_traced_memory()[1] < len(SWOLLEN)
    tracemalloc.stop()


def test_an_unreadable_run_is_rejected_before_the_first_exported_byte(here: Database, tmp_path: Path) -> None:
    with here.session() as session:
        run = recorded(session, NEW, noise(10), cuts=(4,))
        session.connection().exec_driver_sql("UPDATE chunk SET samples = x'00' WHERE first_tick > 7000")
    with refused(ExportError, "run_not_exportable", run_id=1, reason=TextWith("^damaged samples")):
        export_run(here, run)
    with pytest.raises(UnknownRecordError):
        export_run(here, 99)


# Exports of earlier versions are imported once, in the current form.


def rewrite(database: Database, table: str, column: str, change: Callable[[Any], Any]) -> None:
    """Change a document directly in all rows of the database."""
    with database.session() as session:
        for number, value in session.execute(text(f"SELECT id, {column} FROM {table}")).all():
            told = {"value": json.dumps(change(json.loads(value))), "id": number}
            session.execute(text(f"UPDATE {table} SET {column} = :value WHERE id = :id"), told)


def with_limit_alone(settings: Any) -> Any:
    loop = {name: part for name, part in settings.get("loop", {}).items() if name != "motion"}
    return settings | {"loop": loop | {"u_plan": 7.5}}


def without_reasons(items: list[Any]) -> list[Any]:
    return [{name: part for name, part in item.items() if name != "reason"} for item in items]


def without_definitions(metrics: Any) -> Any:
    kept = {name: part for name, part in metrics.items() if name != "definitions"}
    return kept | {"figures": without_reasons(metrics["figures"])}


def with_bands(quality: Any) -> Any:
    channel = QUALITY | {"residuals": {"whiteness": BAND, "input_correlation": BAND}}
    return quality | {"G_q": channel, "G_S": channel}


@pytest.fixture
def earlier(here: Database, run: int) -> Database:
    """Return the exporting installation in the state of an earlier version."""
    rewrite(here, "run", "settings", with_limit_alone)
    rewrite(here, "result", "metrics", without_definitions)
    rewrite(here, "result", "criteria", without_reasons)
    rewrite(here, "identification", "quality", with_bands)
    return here


def test_a_bundle_of_an_earlier_version_is_imported_completely(
    earlier: Database, there: Database, run: int, tmp_path: Path
) -> None:
    file, later = tmp_path / "earlier.zip", tmp_path / "later.zip"
    file.write_bytes(b"".join(stream_bundle(earlier, run, tmp_path)))
    assert import_bundle(there, file, "Ben", tmp_path / "there") == ImportResult(run=2, was=run, new=True)
    before = read_all_rows(there)
    with closing(migrated(earlier, tmp_path / "here", BEFORE)) as here:
        with here.reading() as one, there.reading() as other:
            for number in (1, 2):
                assert runs.get(other, number).settings == runs.get(one, number).settings
            assert runs.get(other, 2).set_to.loop.budget == 7.5
            first, second = results.newest(one, 2), results.newest(other, 2)
            assert first is not None
            assert second is not None
            assert (second.metrics, second.criteria) == (first.metrics, first.criteria)
            assert second.metrics.definitions == 0
            assert {item.reason for item in second.metrics.figures} <= {"", NO_STORED_REASON}
            ours = identifications.of_run(other, 1)
            assert ours.quality == identifications.of_run(one, 1).quality
            assert ours.actuator.quality.G_q.residuals.whiteness.bound[0] == pytest.approx(0.109, abs=5e-4)
        later.write_bytes(b"".join(stream_bundle(here, run, tmp_path)))
        for known in (file, later):
            assert import_bundle(there, known, "Ben", tmp_path / "there") == ImportResult(run=2, was=run, new=False)
            assert import_bundle(here, known, "Ben", tmp_path / "here") == ImportResult(run=2, was=run, new=False)
    assert read_all_rows(there) == before


@pytest.mark.parametrize("kind", DataFormat)
def test_an_export_of_an_earlier_version_is_imported_once(
    earlier: Database, there: Database, run: int, kind: DataFormat, tmp_path: Path
) -> None:
    file, later = tmp_path / f"earlier.{kind}", tmp_path / f"later.{kind}"
    write_export(export_run(earlier, run), kind, file)
    assert import_export(there, file, "Ben") == ImportResult(run=1, was=run, new=True)
    with there.reading() as session:
        assert runs.get(session, 1).set_to.loop.motion == "time-optimal"
    with closing(migrated(earlier, tmp_path / "here", BEFORE)) as here:
        write_export(export_run(here, run), kind, later)
        for known in (file, later):
            assert import_export(there, known, "Ben") == ImportResult(run=1, was=run, new=False)
            assert import_export(here, known, "Ben") == ImportResult(run=run, was=run, new=False)
