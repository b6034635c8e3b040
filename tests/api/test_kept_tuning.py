"""The tuning in force outlives the service, where the plant is still the same."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.api.kept_tuning import KeptTuning
from backend.api.tuning_in_use import TuningInUse, initial
from backend.experiments.kept_choice import NAME
from backend.experiments.tuning_choice import TuningChoice
from backend.storage import Database, banks, open_database, settings
from backend.storage.banks import Bank, BankEntry
from plant.parameters import PlantParameters, load_parameters

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
def chosen(ideal: PlantParameters, bank: Bank) -> TuningInUse:
    return initial(ideal, TuningChoice(lam_q=0.8, lam_S=0.6, lam_motor=0.09, b=0.5, interpolate=True), bank)


def test_what_was_in_force_comes_back(database: Database, ideal: PlantParameters, chosen: TuningInUse) -> None:
    kept = KeptTuning(database)
    assert kept.restore(ideal)[1] == ""
    kept.put(initial(ideal), "B. Operator")
    kept.put(chosen, "A. Operator")
    restored, said = kept.restore(ideal)
    assert restored.choice == chosen.choice
    assert restored.command() == chosen.command()
    assert said == (
        "in force again as A. Operator left it: bank kept, version 1, "
        "λ_q 0.8 s, λ_S 0.6 s, λ_motor 0.09 s, b 0.5, interpolating between entries"
    )


def test_another_plant_starts_with_its_defaults(
    database: Database, ideal: PlantParameters, chosen: TuningInUse
) -> None:
    kept = KeptTuning(database)
    kept.put(chosen, "A. Operator")
    lab = load_parameters("lab")
    restored, said = kept.restore(lab)
    assert restored.choice == initial(lab).choice
    assert "other parameters" in said


def test_a_tuning_kept_before_b_was_says_so(database: Database, ideal: PlantParameters, chosen: TuningInUse) -> None:
    kept = KeptTuning(database)
    kept.put(chosen, "A. Operator")
    with database.session() as session:
        stored = settings.newest(session, NAME)
        assert stored is not None
        old = {name: value for name, value in stored.value.items() if name != "b"}
        settings.put(session, NAME, old, "A. Operator")
    restored, said = kept.restore(ideal)
    assert restored.choice == replace(chosen.choice, b=0.0)
    assert said.endswith("b 0, interpolating between entries; b was not kept at that time: its default")


@pytest.mark.parametrize(("name", "value"), [("bank", 99), ("lam_q", 0.1), ("lam_motor", 3.5), ("b", 1.5)])
def test_what_cannot_be_used_any_more_gives_way_to_the_defaults(
    database: Database, ideal: PlantParameters, chosen: TuningInUse, name: str, value: float
) -> None:
    kept = KeptTuning(database)
    kept.put(chosen, "A. Operator")
    with database.session() as session:
        stored = settings.newest(session, NAME)
        assert stored is not None
        settings.put(session, NAME, {**stored.value, name: value}, "A. Operator")
    restored, said = kept.restore(ideal)
    assert restored.choice == initial(ideal).choice
    assert str(value) in said
