"""The database: opened, damaged and restored; lengths and names of what is stored."""

import itertools
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sqlalchemy import String, text

from backend import __version__
from backend.banks.tuning_settings import saved_tuning_key
from backend.commissioning.steps import StepId
from backend.errors import STATION_NAME_LENGTH, RequestRejectedError
from backend.experiments import library
from backend.faults import Fault
from backend.identification.fitting import Fit
from backend.identification.models import joint_method_name
from backend.identification.validation import MAX_NOISE_ORDER
from backend.models.document import document_digest
from backend.models.run import Outcome
from backend.schemas.run import SEARCH_NAME_MAX
from backend.services import maintenance
from backend.services.maintenance import DatabaseMonitor
from backend.storage import banks, experiments, identifications, messages, runs
from backend.storage.banks import BankEntry
from backend.storage.database import (
    BackupError,
    Database,
    backup_database,
    find_database_errors,
    open_database,
    require_intact_database,
    restore_database,
)
from backend.storage.events import EventKind
from backend.storage.imports import KINDS
from backend.storage.orm import (
    TAG_MAX,
    Base,
    DamagedError,
    FormulaRow,
    GoneError,
    QueuedRow,
    RunTagRow,
    StorageError,
    StudyRow,
    UnfitError,
)
from backend.storage.runs import EndState, RunKind
from backend.storage.search_index import NO_OUTCOME, ValueSource, insert_new, iterate_parameters
from backend.studies.point import FAILED, LOST, REFUSED
from plant import Message
from plant.interface import FILE_NAME_MAX, NAME_MAX
from plant.parameters import load_parameters
from tests.reasons import assert_reason
from tests.refusals import refused
from tests.storage.test_lineage import NEW_IDENTIFICATION, NEW_RUN

# How the database is opened: durable on disk, writers one after the other, trouble told in one sentence.

PAGE = 4096


def test_every_connection_is_durable_and_checked(sqlite: Database) -> None:
    for connect in (sqlite.session, sqlite.reading):
        with connect() as session:
            assert session.scalar(text("PRAGMA journal_mode")) == "wal"
            assert session.scalar(text("PRAGMA synchronous")) == 2  # FULL
            assert session.scalar(text("PRAGMA foreign_keys")) == 1
            assert session.scalar(text("PRAGMA busy_timeout")) == 5000


def test_an_error_in_a_transaction_stores_nothing(database: Database) -> None:
    def fail_midway() -> None:
        with database.session() as session:
            runs.create(session, NEW_RUN)
            raise KeyError("midway")

    with pytest.raises(KeyError):
        fail_midway()
    with database.reading() as session:
        assert runs.find(session) == []


def test_a_reader_sees_one_state_while_others_write(database: Database) -> None:
    with database.reading() as before:
        assert runs.count(before) == 0
        with database.session() as session:
            runs.create(session, NEW_RUN)
        assert runs.count(before) == 0
    with database.reading() as after:
        assert runs.count(after) == 1


def test_a_second_writer_gets_an_error_after_a_timeout(sqlite: Database, tmp_path: Path) -> None:
    with sqlite.session() as session:
        run = runs.create(session, NEW_RUN)
    other = sqlite3.connect(tmp_path / "sinew.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with sqlite.reading() as session:
        session.connection().connection.cursor().execute("PRAGMA busy_timeout=1")
        assert runs.get(session, run.id) == run
    with refused(StorageError, "database_error", reason="database is locked"), sqlite.session() as session:
        runs.end(session, run.id, EndState.COMPLETED)
    other.close()


def test_an_unusable_data_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "sinew.db").mkdir()
    file, reason = tmp_path / "sinew.db", "unable to open database file"
    with refused(StorageError, "database_unusable", file=file, reason=reason, remedy=""):
        open_database(tmp_path)


def test_a_backup_is_complete_and_never_overwrites(sqlite: Database, tmp_path: Path) -> None:
    with sqlite.session() as session:
        run = runs.create(session, replace(NEW_RUN, note="kept"))
    target = tmp_path / "copies" / "monday.db"
    backup_database(sqlite.engine, target)
    copied = open_database(target.parent, f"sqlite:///{target}")
    with copied.reading() as session:
        assert runs.get(session, run.id) == run
    assert find_database_errors(copied.engine) == []
    copied.close()
    with refused(BackupError, "backup_exists", file=target):
        backup_database(sqlite.engine, target)
    (tmp_path / "file").touch()
    below = tmp_path / "file" / "below.db"
    with refused(BackupError, "backup_not_written", file=below):
        backup_database(sqlite.engine, below)


def test_check_finds_inconsistencies(database: Database) -> None:
    assert find_database_errors(database.engine) == []
    with database.session() as session:
        session.execute(text("DROP TABLE report"))
    assert any("report" in problem for problem in find_database_errors(database.engine))


def test_check_finds_dangling_references(sqlite: Database, tmp_path: Path) -> None:
    careless = sqlite3.connect(tmp_path / "sinew.db")
    names = "run_id, fields, period_s, missed, problem, size_bytes"
    careless.execute(f"INSERT INTO recording ({names}) VALUES (77, '[]', 0.001, 0, '', 0)")
    careless.commit()
    careless.close()
    assert find_database_errors(sqlite.engine) == [messages.references_broken(table="recording")]


def test_check_finds_a_damaged_file(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        for _ in range(200):
            runs.create(session, NEW_RUN)
    database.close()
    file = tmp_path / "sinew.db"
    content = bytearray(file.read_bytes())
    content[-3 * PAGE :] = b"\xff" * 3 * PAGE
    file.write_bytes(content)
    damaged = open_database(tmp_path)
    assert any("damaged" in problem for problem in find_database_errors(damaged.engine))
    damaged.close()


# A missing, replaced, empty or damaged database is reported, never replaced silently, and can be restored.


@contextmanager
def refused_with_backup(kind: type[StorageError], code: str, data: Path) -> Iterator[None]:
    """Expect a refusal of the database of this folder, whose remedy is the backup of monday."""
    with pytest.raises(kind) as caught:
        yield
    message, remedy = caught.value.message, caught.value.message.values["remedy"]
    assert isinstance(remedy, Message)
    assert (message.code, message.values["file"], remedy.code) == (code, data / "sinew.db", "restore_a_backup")
    assert (remedy.values["folder"], remedy.values["newest"]) == (data, ["monday.db"])


def store_runs(database: Database, count: int) -> None:
    with database.session() as session:
        for _ in range(count):
            runs.create(session, NEW_RUN)


def count_runs(data: Path) -> int:
    with closing(open_database(data)) as database, database.reading() as session:
        return runs.count(session)


def damage(file: Path) -> None:
    """Overwrite some pages in the middle, like a failing disk."""
    with file.open("r+b") as opened:
        opened.seek(file.stat().st_size // PAGE // 2 * PAGE)
        opened.write(b"\xff" * 3 * PAGE)


@pytest.fixture
def database_database_monitor(tmp_path: Path) -> Iterator[Database]:
    """A database with 200 runs and a backup of it."""
    with closing(open_database(tmp_path)) as opened:
        store_runs(opened, 200)
        backup_database(opened.engine, tmp_path / "backups" / "monday.db")
        yield opened


def delete_folder(data: Path) -> None:
    shutil.rmtree(data)


def move_file(data: Path) -> None:
    (data / "sinew.db").rename(data / "moved.db")


def replace_file(data: Path) -> None:
    shutil.copy(data / "sinew.db", data / "other.db")
    os.replace(data / "other.db", data / "sinew.db")


def delete_log(data: Path) -> None:
    (data / "sinew.db-wal").unlink()


@pytest.mark.parametrize("takes_away", [delete_folder, move_file, replace_file, delete_log])
def test_a_deleted_or_moved_database_file_is_not_written(
    database_database_monitor: Database, tmp_path: Path, takes_away: Callable[[Path], None]
) -> None:
    store_runs(database_database_monitor, 1)
    takes_away(tmp_path)
    with refused(GoneError, "database_file_replaced"):
        store_runs(database_database_monitor, 1)
    with database_database_monitor.reading() as session:
        assert runs.count(session) == 201  # what is there can still be read


def test_a_restored_file_is_written_again(database_database_monitor: Database, tmp_path: Path) -> None:
    aside = tmp_path.rename(tmp_path.with_name(f"{tmp_path.name}-aside"))
    with pytest.raises(GoneError):
        store_runs(database_database_monitor, 1)
    aside.rename(tmp_path)
    store_runs(database_database_monitor, 1)
    assert count_runs(tmp_path) == 201


def test_an_emptied_file_is_rejected_with_the_names_of_the_backups(
    database_database_monitor: Database, tmp_path: Path
) -> None:
    database_database_monitor.close()
    os.truncate(tmp_path / "sinew.db", 0)
    with refused_with_backup(DamagedError, "database_empty", tmp_path):
        open_database(tmp_path)
    assert (tmp_path / "sinew.db").stat().st_size == 0


def test_damaged_pages_are_found_and_the_remedy_works(database_database_monitor: Database, tmp_path: Path) -> None:
    require_intact_database(database_database_monitor, tmp_path)
    database_database_monitor.close()
    damage(tmp_path / "sinew.db")
    with closing(open_database(tmp_path)) as damaged, refused_with_backup(DamagedError, "database_damaged", tmp_path):
        DatabaseMonitor(damaged, tmp_path).check_small_database()
    restore_database(tmp_path / "backups" / "monday.db", tmp_path / "sinew.db")
    assert count_runs(tmp_path) == 200


def test_a_large_file_is_checked_in_the_background(
    database_database_monitor: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maintenance, "is_quick_to_check", lambda _file: False)
    database_database_monitor.close()
    damage(tmp_path / "sinew.db")
    with closing(open_database(tmp_path)) as damaged:
        watched = DatabaseMonitor(damaged, tmp_path)
        watched.check_small_database()
        assert watched.problem == ""
        watched.start_check()
        watched.wait_for_check(60.0)
        assert "monday.db" in watched.problem
        assert_reason(watched.problem, "damaged_database")


@pytest.mark.parametrize(("content", "code"), [(b"", "database_empty"), (b"junk" * 4096, "database_unusable")])
def test_a_backup_can_replace_a_file_that_is_no_database(
    database_database_monitor: Database, tmp_path: Path, content: bytes, code: str
) -> None:
    database_database_monitor.close()
    (tmp_path / "sinew.db").write_bytes(content)
    (tmp_path / "sinew.db-wal").write_bytes(b"of another time")
    with refused_with_backup(StorageError, code, tmp_path):
        open_database(tmp_path)
    restore_database(tmp_path / "backups" / "monday.db", tmp_path / "sinew.db")
    assert count_runs(tmp_path) == 200
    (kept,) = tmp_path.glob("sinew.before-restore-*.db")
    assert kept.read_bytes() == content


def test_an_interrupted_start_leaves_no_empty_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_short(_engine: object) -> None:
        assert not (tmp_path / "sinew.db").exists()
        raise sqlite3.OperationalError("power cut")

    with monkeypatch.context() as patched:
        patched.setattr("backend.storage.database.upgrade", cut_short)
        with pytest.raises(sqlite3.OperationalError):
            open_database(tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert count_runs(tmp_path) == 0


# Each text that the program composes fits its column; a longer one is refused on SQLite as on PostgreSQL.

LONGEST_PERSON = "x" * 40 + " (viewer) 999"
"""A name at sign-in has at most 40 characters; the role and a number may follow it."""


def methods() -> Iterable[str]:
    """Yield each method that two channels can have, as ``Fit`` names the estimator of one."""
    channels = ["ARX with low-pass prefilter"]
    for order, low_pass, drive in itertools.product(range(MAX_NOISE_ORDER + 1), (0.0, 0.9), (None, object())):
        problem = SimpleNamespace(whitening=np.ones(order + 1), low_pass=low_pass)
        channels.append(Fit(cast(Any, SimpleNamespace(problem=problem)), cast(Any, drive)).method)
    for G_q, G_S in itertools.product(channels, repeat=2):
        yield joint_method_name({"G_q": G_q, "G_S": G_S})


DIGEST = [document_digest({})]
STATIONS = ["x" * STATION_NAME_LENGTH]
PEOPLE = [LONGEST_PERSON]
SOFTWARE = [__version__, f"{__version__}.post123.dev123+g{'0' * 12}"]
COMPOSED: dict[str, Iterable[str]] = {
    "bank.name": ["x" * 60],  # as the API bounds it
    "queued_experiment.name": ["x" * 60],  # as the API bounds it
    "bring_up.step": StepId,
    "bring_up.fingerprint": DIGEST,
    "chunk.sha256": DIGEST,
    "event.kind": EventKind,
    "experiment.name": library.READY_NAMES,
    "flight_record.fault": Fault,
    "formula.name": ["x" * 20],  # as the API bounds it
    "formula.unit": ["x" * 20],
    "identification.kind": ["actuator", "motor", "spring"],
    "identification.method": [*methods(), "least squares on position", "least-squares polynomials"],
    "identification.software": SOFTWARE,
    "origin.kind": KINDS,
    "origin.sha256": DIGEST,
    "parameter_value.parameters_sha256": DIGEST,
    "report.format": ["html", "pdf"],
    "result.software": SOFTWARE,
    "run.kind": RunKind,
    "run.plant": ["x" * NAME_MAX],
    "run.software": SOFTWARE,
    "run.end_state": EndState,
    "run_index.kind": RunKind,
    "run_index.parameters_sha256": DIGEST,
    "run_index.end_state": EndState,
    "run_index.outcome": [*Outcome, NO_OUTCOME],
    "run_tag.tag": ["x" * TAG_MAX],
    "setting.name": [
        saved_tuning_key(2**31 - 1),
        f"search/{'x' * SEARCH_NAME_MAX}",
        f"viewer-preferences/{LONGEST_PERSON}",
        f"people at the {'x' * NAME_MAX}",
    ],
    "study.name": ["x" * 40],  # as its text bounds it
    "study.title": ["x" * 100],
    "study.runner": [f"{'x' * 64}:{2**22}"],
    "study_point.state": [*EndState, REFUSED, FAILED, LOST],
    "value_name.source": ValueSource,
    "value_name.name": [name for name, _ in iterate_parameters(load_parameters("lab").to_document())],
    "bring_up.wiring": ["x" * FILE_NAME_MAX],
    "run.parameters_name": ["x" * FILE_NAME_MAX],
}
assert StudyRow.metadata is QueuedRow.metadata is FormulaRow.metadata is Base.metadata, "their tables count too"
BOUNDED = {
    str(column): column.type.length
    for table in Base.metadata.sorted_tables
    for column in table.columns
    if isinstance(column.type, String) and column.type.length
}
WHO_AND_WHERE = {"who": PEOPLE, "station": STATIONS}
"""Columns that many tables have."""


@pytest.mark.parametrize("column", BOUNDED)
def test_composed_texts_fit_their_columns(column: str) -> None:
    composed = list(COMPOSED.get(column) or WHO_AND_WHERE[column.partition(".")[2]])
    assert composed
    assert [words for words in map(str, composed) if len(words) > BOUNDED[column]] == []


def test_each_list_belongs_to_an_existing_column() -> None:
    assert set(COMPOSED) <= set(BOUNDED)


@pytest.mark.parametrize("column", BOUNDED)
def test_a_too_long_text_is_rejected_with_column_and_length(sqlite: Database, column: str) -> None:
    table, _, name = column.partition(".")
    (row,) = (mapper.class_ for mapper in Base.registry.mappers if mapper.class_.__tablename__ == table)
    longer = "x" * (BOUNDED[column] + 1)
    refusal = partial(refused, UnfitError, "text_too_long", column=column, text=longer, maximum=BOUNDED[column])
    with sqlite.session() as session, refusal(), session.begin_nested():
        session.add(row(**{name: longer}))
    with refusal(), sqlite.session() as session:
        insert_new(session, row, [{name: longer}])


def test_the_longest_text_is_stored_and_one_more_character_is_rejected(database: Database) -> None:
    longest = "ö" * BOUNDED["identification.method"]
    refusal = refused(UnfitError, "text_too_long", column="identification.method", text=f"{longest}x", maximum=200)
    with refusal, database.session() as session:
        identifications.add(session, replace(NEW_IDENTIFICATION, method=f"{longest}x"))
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        added = identifications.add(session, replace(NEW_IDENTIFICATION, run_id=run.id, method=longest))
        insert_new(session, RunTagRow, [{"run_id": run.id, "tag": "ö" * TAG_MAX}])
    with database.reading() as session:
        assert identifications.get(session, added.id).method == longest
        assert session.scalar(text("SELECT tag FROM run_tag")) == "ö" * TAG_MAX


def test_other_columns_of_a_row_with_an_old_too_long_text_can_be_changed(sqlite: Database) -> None:
    with sqlite.session() as session:
        run = runs.create(session, NEW_RUN)
        session.execute(text("UPDATE run SET parameters_name = :longer"), {"longer": "x" * 300})
    with sqlite.session() as session:
        runs.end(session, run.id, EndState.COMPLETED)
    with sqlite.reading() as session:
        assert runs.get(session, run.id).end_state == EndState.COMPLETED


def test_a_value_with_a_too_long_name_is_stored_but_not_indexed(database: Database) -> None:
    values = {"geometry": {name: {"value": 1.0} for name in ("r_m", "x" * 300)}}
    with database.session() as session:
        run = runs.create(session, replace(NEW_RUN, parameters=values))
    with database.reading() as session:
        assert runs.get(session, run.id).parameters == values
        assert list(session.scalars(text("SELECT name FROM value_name WHERE source = 'parameter'"))) == ["geometry.r_m"]


# Two names that people take for one are not both kept: letters of either case, wide letters, spaces.

MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


@pytest.mark.parametrize("alike", ["brief", "BRIEF", "\uff22rief", "Brief\u00a0"])
def test_confusable_names_of_experiments_and_banks_are_rejected(database: Database, alike: str) -> None:
    def add_both(name: str) -> None:
        with database.session() as session:
            experiments.add(session, name, "text", "Ana")
        with database.session() as session:
            banks.add(session, name, [BankEntry(10.55, MODEL)], "Ana")

    add_both("Brief")
    for add in (
        lambda session: experiments.add(session, alike, "other", "Ana"),
        lambda session: banks.add(session, alike, [BankEntry(10.55, MODEL)], "Ana"),
    ):
        with pytest.raises(RequestRejectedError) as caught, database.session() as session:
            add(session)
        message = caught.value.message
        assert (caught.value.code, message.code) == ("name_taken", "name_too_similar")
        assert (message.values["existing"], message.values["name"]) == ("Brief", alike)
    add_both("Briefly")
    with database.session() as session:
        assert experiments.add(session, "Brief", "other", "Ana").version == 2
        assert banks.add(session, "Brief", [BankEntry(10.55, MODEL)], "Ana").version == 2
        assert (
            banks.add(session, alike, [BankEntry(10.55, MODEL)], "Ana", number=77).version == 1
        )  # a copy for a dry run
    with database.reading() as session:
        assert {one.name for one in experiments.newest(session)} == {"Brief", "Briefly"}
