"""Documents of earlier versions are read and upgraded."""

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from backend.banks import tuning_settings
from backend.banks.builder import BankError, build_point_model
from backend.banks.tuning_settings import TUNING_NAMES, TuningSettings
from backend.models import upgrades
from backend.models.document import UnreadableDocumentError
from backend.models.run import ACTIVE_TUNING, ENTRY, SAVED_TUNING, SETTINGS, EntryModel
from backend.services.banks import StoredBanks
from backend.services.tuning_state import TuningStore
from backend.storage import banks, settings
from backend.storage.banks import BankEntry, stored_entry_name
from backend.storage.database import Database, open_database
from backend.workers import WorkerProcess
from plant.parameters import load_parameters
from tests.models import earlier
from tests.models import earlier_identifications as identified
from tests.refusals import refused

# Documents of earlier forms are upgraded to the current form; others stay unchanged.

LOOP: dict[str, Any] = {"lam_q": 0.5, "lam_S": 0.42, "interpolate": False}
STORED: dict[str, Any] = {"lam_q": 0.8, "lam_S": 0.6, "lam_motor": 0.09, "interpolate": True, "parameters": "ab"}
CURRENT = {**STORED, **TuningSettings(0.8, 0.6, 0.09, 0.0, 0, interpolate=True).to_document()}
NO_BOUND: dict[str, Any] = {
    **identified.QUALITY,
    "residuals": {"whiteness": identified.BAND, "input_correlation": identified.TEST, "std": 1.0},
}
NO_GRADE = {name: part for name, part in identified.MOTOR_QUALITY.items() if name != "grade"}


def quality_of(kind: str, model: Any) -> Callable[[Any], Any]:
    return lambda quality: upgrades.upgrade_quality(kind, model, quality)


ACTUATOR = quality_of("actuator", identified.ACTUATOR["model"])
MOTORS = quality_of("motor", identified.MOTORS["model"])


@pytest.mark.parametrize(
    ("upgrade", "early", "current"),
    [
        (upgrades.upgrade_run_settings, {"mode": "run", **LOOP}, {"mode": "run", "loop": LOOP}),
        (
            upgrades.upgrade_run_settings,
            {"plan": {"tension_N": 20.0}, "loop": {**LOOP, "u_plan": 7.5}, "version": 1},
            {"plan": {"tension_N": 20.0}, "loop": {**LOOP, "u_plan": 7.5, "motion": "time-optimal"}, "version": 1},
        ),
        (
            upgrades.upgrade_run_settings,
            {"mode": "run", **LOOP, "u_plan": 0.0, "who": "unknown to the reader"},
            {"mode": "run", "loop": {**LOOP, "motion": "lambda"}, "who": "unknown to the reader"},
        ),
        (
            upgrades.upgrade_metrics,
            earlier.METRICS,
            {
                **earlier.METRICS,
                "definitions": 0,
                "figures": [earlier.FIGURES[0], {**earlier.FIGURES[1], "reason": ""}],
            },
        ),
        (
            upgrades.upgrade_criteria,
            [*earlier.CRITERIA, {**earlier.CRITERIA[0], "figure": 1.0, "passed": True}],
            [
                {**earlier.CRITERIA[0], "reason": upgrades.NO_STORED_REASON},
                {**earlier.CRITERIA[0], "figure": 1.0, "passed": True, "reason": ""},
            ],
        ),
        (
            MOTORS,
            {"A": NO_GRADE, "B": identified.MOTOR_QUALITY},
            # The standard errors of motor A are as large as its parameters.
            {"A": {**NO_GRADE, "grade": "not usable"}, "B": identified.MOTOR_QUALITY},
        ),
        (upgrades.upgrade_tuning, STORED, CURRENT),
        (upgrades.upgrade_tuning, {**STORED, "bank": None}, CURRENT),
        (
            upgrades.upgrade_tuning,
            {**STORED, "b": 0.2, "bank": 3, "version": 1},
            {**CURRENT, "b": 0.2, "bank": 3, "version": 1},
        ),
        (upgrades.upgrade_tuning, {**STORED, "u_plan": 7.5}, {**CURRENT, "u_plan": 7.5, "motion": "time-optimal"}),
        (upgrades.upgrade_tuning, {**STORED, "u_plan": 0.0}, CURRENT),
    ],
)
def test_early_documents_are_upgraded_to_the_current_form(
    upgrade: Callable[[Any], Any], early: Any, current: Any
) -> None:
    before = json.dumps(early)
    assert upgrade(early) == current
    assert upgrade(current) is current
    assert json.dumps(early) == before


def test_the_band_of_one_lag_is_upgraded_to_the_bound_of_the_test() -> None:
    """The bound is 2.807 standard deviations for two lags, and 2.576 for one."""
    upgraded = ACTUATOR({"G_q": NO_BOUND, "G_S": identified.QUALITY})
    test = upgraded["G_q"]["residuals"].pop("whiteness")
    assert test.pop("bound") == pytest.approx([0.1 * 2.8070 / 2.5758] * 2, rel=1e-4)
    assert test == {name: part for name, part in identified.BAND.items() if name != "band"}
    assert upgraded["G_q"]["residuals"] == {"input_correlation": identified.TEST, "std": 1.0}
    assert upgraded["G_S"] == identified.QUALITY
    unknown = {**identified.BAND, "band": [None, 1.7e308]}
    unbounded = {**NO_BOUND, "residuals": {"whiteness": unknown, "input_correlation": unknown}}
    assert ACTUATOR({"G_q": unbounded, "G_S": unbounded})["G_S"]["residuals"]["whiteness"]["bound"] == [None, None]


@pytest.mark.parametrize(
    ("upgrade", "document"),
    [
        (upgrades.upgrade_run_settings, {"mode": "run", **LOOP, "b": "half"}),
        (upgrades.upgrade_run_settings, {"mode": "run", "loop": {**LOOP, "u_plan": 10**400}}),
        (upgrades.upgrade_run_settings, {"mode": "run", **LOOP, "version": 2}),
        (upgrades.upgrade_run_settings, {"loop": [1]}),
        (upgrades.upgrade_run_settings, [1]),
        (upgrades.upgrade_metrics, {**earlier.METRICS, "played_s": "long"}),
        (upgrades.upgrade_metrics, {**earlier.METRICS, "figures": 3}),
        (upgrades.upgrade_metrics, {**earlier.METRICS, "figures": [1]}),
        (upgrades.upgrade_metrics, None),
        (upgrades.upgrade_criteria, [{**earlier.CRITERIA[0], "bound": None}]),
        (upgrades.upgrade_criteria, {"a": 1}),
        (ACTUATOR, {"G_q": NO_BOUND, "G_S": {}}),
        (ACTUATOR, {"G_q": {**NO_BOUND, "residuals": {"whiteness": {**identified.BAND, "band": ["wide"]}}}}),
        (ACTUATOR, {"G_q": {**NO_BOUND, "residuals": {"whiteness": {**identified.BAND, "band": [10**400]}}}}),
        (ACTUATOR, {"G_q": 3}),
        (MOTORS, {"A": NO_GRADE}),
        (MOTORS, {"A": {**NO_GRADE, "rms_counts": "few"}, "B": NO_GRADE}),
        (quality_of("motor", {}), {"A": NO_GRADE, "B": NO_GRADE}),
        (quality_of("spring", identified.SPRINGS["model"]), identified.SPRINGS["quality"]),
        (quality_of("unknown", {}), {"A": 1}),
        (upgrades.upgrade_tuning, {**STORED, "lam_q": None}),
        (upgrades.upgrade_tuning, {**STORED, "b": "half"}),
        (upgrades.upgrade_tuning, LOOP),
        (upgrades.upgrade_tuning, 3),
    ],
)
def test_unreadable_documents_are_not_upgraded(upgrade: Callable[[Any], Any], document: Any) -> None:
    before = json.dumps(document)
    assert upgrade(document) is document
    assert json.dumps(document) == before


@pytest.mark.parametrize("K_m", [0.0, None])
def test_a_motor_without_gain_is_graded_not_usable(K_m: float | None) -> None:
    motor = {**identified.MOTOR, "parameters": {**identified.FITTED, "K_m": K_m}}
    upgrade = quality_of("motor", {"A": motor, "B": identified.MOTOR})
    assert upgrade({"A": NO_GRADE, "B": NO_GRADE})["A"]["grade"] == "not usable"


def test_upgrading_a_record_upgrades_all_its_documents() -> None:
    run = {"settings": {"mode": "run", **LOOP}, "who": "Ana"}
    assert upgrades.upgrade_record("run", run) == {"settings": {"mode": "run", "loop": LOOP}, "who": "Ana"}
    result = upgrades.upgrade_record("result", {"metrics": earlier.METRICS, "criteria": earlier.CRITERIA})
    assert result["metrics"]["definitions"] == 0
    assert result["criteria"][0]["reason"] == upgrades.NO_STORED_REASON
    found = {"kind": "motor", "model": identified.MOTORS["model"], "quality": {"A": NO_GRADE, "B": NO_GRADE}}
    assert upgrades.upgrade_record("identification", found)["quality"]["B"]["grade"] == "not usable"
    assert upgrades.upgrade_record("bank", {"name": "bench"}) == {"name": "bench"}


def test_upgraded_session_settings_contain_the_motion() -> None:
    upgraded = upgrades.upgrade_run_settings({"mode": "run", **LOOP, "u_plan": 7.5})
    assert SETTINGS.read(upgraded, "it").loop.budget == 7.5


# Banks and tunings without a version are read; an unreadable one is replaced, and the reason is reported.

LAB = load_parameters("lab")
OTHER = TuningSettings(lam_q=0.6, b=0.25)
BEFORE: dict[str, Any] = {**OTHER.to_document(), "parameters": tuning_settings.compute_parameters_digest(LAB)}
MODEL = {"K_q": 0.05, "T_q": 0.35, "K_S": 0.72, "T_S": 0.34, "tension_N": 20.0}


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


def store_last_tuning(database: Database, document: Any) -> None:
    with database.session() as session:
        settings.save(session, tuning_settings.ACTIVE_TUNING_KEY, document, "Ana")


def test_tunings_stored_without_version_are_restored(database: Database) -> None:
    store_last_tuning(database, BEFORE)
    restored = tuning_settings.load_last_tuning(database, LAB)
    assert restored is not None
    assert (restored.tuning, restored.same_plant) == (OTHER, True)
    assert ACTIVE_TUNING.write(ACTIVE_TUNING.read(BEFORE, "it")) == {**BEFORE, "version": 1}
    parts = {name: part for name, part in OTHER.to_document().items() if name != "bank"}
    assert SAVED_TUNING.write(SAVED_TUNING.read(parts, "it")) == {**parts, "version": 1}


def test_every_part_of_a_tuning_is_stored(database: Database) -> None:
    tuning_settings.store_tuning(database, OTHER, LAB, "Ana")
    with database.reading() as session:
        stored = settings.newest(session, tuning_settings.ACTIVE_TUNING_KEY)
    assert stored is not None
    assert stored.value == {**BEFORE, "version": 1}
    assert set(TUNING_NAMES) <= set(stored.value)


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ({**BEFORE, "version": 2}, "stored by Ana: the active tuning of version 2 cannot be read"),
        ({**BEFORE, "b": "half"}, "the active tuning cannot be read, field b"),
        ({**BEFORE, "bank": None}, "the active tuning cannot be read, field bank"),
        (OTHER.to_document(), "the active tuning cannot be read, field parameters: it is missing"),
    ],
)
def test_an_unreadable_saved_tuning_is_replaced_by_the_defaults(database: Database, document: Any, reason: str) -> None:
    store_last_tuning(database, document)
    tuning, message = TuningStore(database).restore(LAB)
    assert message.startswith("defaults active: ")
    assert reason in message
    assert tuning.settings != OTHER


def test_entries_of_earlier_banks_are_read(database: Database) -> None:
    with database.session() as session:
        bank = banks.add(session, "earlier", [BankEntry(10.5, MODEL), BankEntry(8.0, {"K_q": 0.05})], "Ana")
    weak, stiff = bank.entries
    assert ENTRY.write(stiff.known) == {**MODEL, "version": 1}
    assert (stored_entry_name(stiff), build_point_model(stiff).K_S) == ("20 N", 0.72)
    assert weak.known == EntryModel(K_q=0.05)
    with refused(BankError, "entry_without_models", missing="T_q, K_S, T_S"):
        build_point_model(weak)
    values = {"owner": "the entry at 9.00 N·m/rad of a bank", "label": "its models", "field": "K_S"}
    with refused(UnreadableDocumentError, "document_unreadable", **values):
        assert BankEntry(9.0, {**MODEL, "K_S": "much"}).known


def test_an_unreadable_bank_is_listed_with_the_reason(database: Database) -> None:
    with database.session() as session:
        banks.add(session, "good", [BankEntry(10.5, MODEL)], "Ana")
        banks.add(session, "newer", [BankEntry(8.0, {**MODEL, "version": 2})], "Ana")
    tuning, _ = TuningStore(database).restore(LAB)
    with closing(WorkerProcess(lambda _cause: None)) as worker:
        newer, good = StoredBanks(database, worker, lambda: tuning).list_banks()
    assert (good.name, len(good.entries), good.note) == ("good", 1, "")
    assert (newer.name, newer.entries) == ("newer", [])
    assert "of version 2 cannot be read" in newer.note
