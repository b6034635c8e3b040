"""Banks and tunings without a version are read; one that cannot be read gives way, and says why."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from backend.banks import tuning_settings
from backend.banks.builder import BankError, build_point_model
from backend.banks.tuning_settings import TUNING_NAMES, TuningSettings
from backend.models.document import UnreadableDocumentError
from backend.models.run import ACTIVE_TUNING, ENTRY, SAVED_TUNING, EntryModel
from backend.services.banks import StoredBanks
from backend.services.tuning_state import TuningStore
from backend.storage import banks, settings
from backend.storage.banks import BankEntry, stored_entry_name
from backend.storage.database import Database, open_database
from backend.workers import WorkerProcess
from plant.parameters import load_parameters

LAB = load_parameters("lab")
OTHER = TuningSettings(lam_q=0.6, b=0.25)
BEFORE: dict[str, Any] = {**OTHER.to_document(), "parameters": tuning_settings.compute_parameters_digest(LAB)}
MODEL = {"K_q": 0.05, "T_q": 0.35, "K_S": 0.72, "T_S": 0.34, "tension_N": 20.0}


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


def left(database: Database, document: Any) -> None:
    with database.session() as session:
        settings.save(session, tuning_settings.ACTIVE_TUNING_KEY, document, "Ana")


def test_what_was_kept_before_versions_is_in_force_again(database: Database) -> None:
    left(database, BEFORE)
    kept = tuning_settings.load_last_tuning(database, LAB)
    assert kept is not None
    assert (kept.tuning, kept.same_plant) == (OTHER, True)
    assert ACTIVE_TUNING.write(ACTIVE_TUNING.read(BEFORE, "it")) == {**BEFORE, "version": 1}
    parts = {name: part for name, part in OTHER.to_document().items() if name != "bank"}
    assert SAVED_TUNING.write(SAVED_TUNING.read(parts, "it")) == {**parts, "version": 1}


def test_every_part_of_a_tuning_is_kept(database: Database) -> None:
    tuning_settings.store_tuning(database, OTHER, LAB, "Ana")
    with database.reading() as session:
        stored = settings.newest(session, tuning_settings.ACTIVE_TUNING_KEY)
    assert stored is not None
    assert stored.value == {**BEFORE, "version": 1}
    assert set(TUNING_NAMES) <= set(stored.value)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({**BEFORE, "version": 2}, "left by Ana: the tuning in force is of version 2"),
        ({**BEFORE, "b": "half"}, "the tuning in force cannot be read, field b"),
        ({**BEFORE, "bank": None}, "the tuning in force cannot be read, field bank"),
        (OTHER.to_document(), "the tuning in force cannot be read, field parameters: it is missing"),
    ],
)
def test_a_kept_tuning_that_cannot_be_read_gives_way_to_the_defaults(
    database: Database, document: Any, said: str
) -> None:
    left(database, document)
    tuning, told = TuningStore(database).restore(LAB)
    assert told.startswith("defaults in force: ")
    assert said in told
    assert tuning.choice != OTHER


def test_entries_of_earlier_banks_are_read_as_they_were(database: Database) -> None:
    with database.session() as session:
        bank = banks.add(session, "earlier", [BankEntry(10.5, MODEL), BankEntry(8.0, {"K_q": 0.05})], "Ana")
    weak, stiff = bank.entries
    assert ENTRY.write(stiff.known) == {**MODEL, "version": 1}
    assert (stored_entry_name(stiff), build_point_model(stiff).K_S) == ("20 N", 0.72)
    assert weak.known == EntryModel(K_q=0.05)
    with pytest.raises(BankError, match="has no T_q, K_S, T_S"):
        build_point_model(weak)
    with pytest.raises(UnreadableDocumentError, match=r"the entry at 9\.00 N·m/rad of a bank: its models .* field K_S"):
        assert BankEntry(9.0, {**MODEL, "K_S": "much"}).known


def test_a_bank_that_cannot_be_read_says_so_in_the_list_and_the_others_are_there(database: Database) -> None:
    with database.session() as session:
        banks.add(session, "good", [BankEntry(10.5, MODEL)], "Ana")
        banks.add(session, "newer", [BankEntry(8.0, {**MODEL, "version": 2})], "Ana")
    tuning, _ = TuningStore(database).restore(LAB)
    with closing(WorkerProcess(lambda _cause: None)) as worker:
        newer, good = StoredBanks(database, worker, lambda: tuning).list_banks()
    assert (good.name, len(good.entries), good.note) == ("good", 1, "")
    assert (newer.name, newer.entries) == ("newer", [])
    assert "is of version 2" in newer.note
