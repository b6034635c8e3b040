"""The stored tuning is restored on the same plant."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from backend.banks.tuning_settings import ACTIVE_TUNING_KEY, TuningSettings, compute_default_tuning
from backend.schemas.tuning import TuningParts, TuningRequest
from backend.services.tuning import SavedTunings
from backend.services.tuning_state import ActiveTuning, TuningStore, make_active_tuning
from backend.storage import banks, events, settings
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, open_database
from plant.parameters import PlantParameters, load_parameters
from tests.api.conftest import client_with
from tests.e2e.service import running_service
from tests.experiments.parameter_files import weak_motors

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
    restored, said = tuning_store.restore(ideal)
    assert restored.choice == chosen.choice
    assert restored.build_command() == chosen.build_command()
    assert said == (
        "in force again as A. Operator left it: bank kept, version 1, "
        "λ_q 0.8 s, λ_S 0.6 s, λ_motor 0.09 s, b 0.5, interpolating between entries, "
        "lambda motion"
    )


def test_other_parameters_start_with_the_default(
    database: Database, ideal: PlantParameters, chosen: ActiveTuning
) -> None:
    tuning_store = TuningStore(database)
    tuning_store.save(chosen, "A. Operator")
    lab = load_parameters("lab")
    restored, said = tuning_store.restore(lab)
    assert restored.choice == compute_default_tuning(lab).tuning
    assert "other parameters" in said


def test_default_uses_the_nearest_lambda_in_range(tmp_path: Path) -> None:
    """The service itself, with a file of its own: it starts, and journal, page and data say which λ and why."""
    with running_service(tmp_path, str(weak_motors(tmp_path))) as service, client_with(service, "token") as client:
        tuning, saved = (client.get(f"/api/tuning{path}").raise_for_status().json() for path in ("", "/saved"))
    lam_q = tuning["lam_q"]
    assert tuning["lam_q_min"] <= lam_q < tuning["lam_q_min"] + 1e-3
    said = f"the method's default is not offered for these models, the nearest that is: λ_q 0.5 → {lam_q:g} s"
    assert (saved["lam_q"], saved["who"], saved["moved"]) == (lam_q, None, said)
    with closing(open_database(tmp_path)) as database, database.reading() as session:
        told = [event.text for event in events.between(session, datetime.min.replace(tzinfo=UTC), None)]
    assert said in told


def test_default_saved_tuning_fits_the_active_tuning(database: Database, tmp_path: Path) -> None:
    """Whatever is in force: to revert to what is saved is not refused."""
    weak = load_parameters(str(weak_motors(tmp_path)))
    for choice in (TuningSettings(lam_q=1.2), TuningSettings(lam_q=2.5, lam_S=1.5, lam_motor=0.2, b=1.0)):
        tuning = make_active_tuning(weak, choice)
        saved = SavedTunings(database).load(tuning)
        wanted = {name: getattr(saved, name) for name in TuningParts.model_fields}
        assert tuning.with_request(TuningRequest(**wanted)).choice == TuningSettings(**wanted)
        assert "λ_q 0.5 → " in saved.moved


def test_default_after_other_parameters_is_moved_into_range(
    database: Database, chosen: ActiveTuning, tmp_path: Path
) -> None:
    tuning_store = TuningStore(database)
    tuning_store.save(chosen, "A. Operator")
    restored, said = tuning_store.restore(load_parameters(str(weak_motors(tmp_path))))
    assert restored.choice == replace(TuningSettings(), lam_q=restored.choice.lam_q, u_plan=restored.choice.u_plan)
    assert restored.choice.u_plan > 0.0
    assert said == (
        "defaults in force: the tuning of last time was for other parameters; the method's default is not offered for "
        f"these models, the nearest that is: λ_q 0.5 → {restored.choice.lam_q:g} s"
    )


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
    restored, said = tuning_store.restore(ideal)
    assert restored.choice == compute_default_tuning(ideal).tuning
    assert str(value) in said
