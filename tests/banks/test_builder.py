"""Conditions for a bank, differences of banks, and bank files."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.banks import messages
from backend.banks.builder import (
    BankError,
    NamedEntry,
    _compute_figures,
    build_bank_document,
    compare_entries,
    import_bank,
    merge_entries,
    parse_bank_file,
    require_consistent,
    require_same_parameters,
)
from backend.storage import banks
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.tuning.gains import TuningParameters
from plant.parameters import PlantParameters, load_parameters
from tests.refusals import refused

LAMBDAS = TuningParameters()
FIRST_ENTRY = messages.entry_at_position(position=1)


def entry(S: float, tension_N: float | None = None, **model: float) -> BankEntry:
    values = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342} | model
    return BankEntry(S, values if tension_N is None else {**values, "tension_N": tension_N})


GOOD = (entry(8.24, 10.0), entry(10.55, 20.0), entry(12.43, 30.0), entry(14.06, 40.0))


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def named(*entries: BankEntry) -> list[NamedEntry]:
    return [NamedEntry(f"entry {position}", item) for position, item in enumerate(entries, start=1)]


def test_bank_entries_are_sorted_by_stiffness(ideal: PlantParameters) -> None:
    assert require_consistent(ideal, named(*reversed(GOOD))) == GOOD


@pytest.mark.parametrize(
    ("entries", "code", "values"),
    [
        ((), "no_identifications", {}),
        (
            (GOOD[0], GOOD[1], entry(10.6, 25.0)),
            "entries_too_close",
            {"below": "entry 2", "above": "entry 3", "distance": pytest.approx(0.05)},
        ),
        ((entry(10.0, 30.0), entry(12.0, 20.0)), "tension_does_not_increase", {"F_below": 30.0, "F_above": 20.0}),
        (
            (GOOD[0], entry(10.55, 20.0, K_q=0.066)),
            "gain_unlike_geometry",
            {
                "name": "entry 2",
                "parameter": "K_q",
                "geometric": pytest.approx(0.05),
                "error_percent": pytest.approx(32.0),
            },
        ),
        ((entry(10.55, 20.0, K_S=1.7),), "gain_unlike_geometry", {"parameter": "K_S", "value": 1.7}),
        ((entry(10.55, 20.0, T_q=12.0),), "not_robust", {"name": "entry 1"}),
        ((entry(10.55, 20.0, T_S=float("nan")),), "not_positive", {"parameter": "T_S"}),
        ((entry(-1.0, 20.0),), "not_positive", {"parameter": "S_nominal", "value": -1.0}),
    ],
)
def test_inconsistent_entries_are_rejected(
    ideal: PlantParameters, entries: tuple[BankEntry, ...], code: str, values: dict[str, object]
) -> None:
    with refused(BankError, code, **values):
        require_consistent(ideal, named(*entries))


def test_models_of_another_plant_are_refused(ideal: PlantParameters) -> None:
    require_same_parameters(ideal, "identification 3", json.loads(json.dumps(ideal.to_document())))
    with refused(
        BankError, "other_parameters", name="identification 3", parameter="motor.K_m", recorded=2.91, current=2.86
    ):
        require_same_parameters(ideal, "identification 3", load_parameters("lab").to_document())


def test_the_comparison_of_banks_shows_models_gains_and_robustness(ideal: PlantParameters) -> None:
    slower = entry(10.60, 20.0, T_q=0.45)
    changes = compare_entries(ideal, LAMBDAS, GOOD, merge_entries(GOOD, [slower]))
    assert len(changes) == 4
    untouched, changed = changes[0], changes[1]
    assert untouched.before == untouched.after
    assert changed.before is not None
    assert changed.after is not None
    before, after = changed.before.position, changed.after.position
    assert (before.T, after.T) == (0.342, 0.45)
    # Table 2 with erratum E1, loop gain 1: k_p = (2T - lam)/lam, k_i = T/lam².
    assert before.k_p == pytest.approx((2 * 0.342 - 0.5) / 0.5)
    assert after.k_i == pytest.approx(0.45 / 0.25)
    assert before.M_s is not None
    assert after.M_s is not None
    assert after.M_s > before.M_s + 0.05
    assert changed.after.stiffness.M_s == pytest.approx(changed.before.stiffness.M_s, abs=0.01)


def test_added_and_removed_entries_have_no_counterpart(ideal: PlantParameters) -> None:
    changes = compare_entries(ideal, LAMBDAS, GOOD[:2], GOOD[1:3])
    assert [(change.before is None, change.after is None) for change in changes] == [
        (False, True),
        (False, False),
        (True, False),
    ]


def test_an_unstable_loop_has_no_sensitivity_peak(ideal: PlantParameters) -> None:
    assert _compute_figures(ideal, replace(LAMBDAS, lam_q=0.1), GOOD[1]).position.M_s is None


def test_a_bank_is_unchanged_after_export_and_import(ideal: PlantParameters, database: Database) -> None:
    with database.session() as session:
        bank = banks.add(session, "four points", GOOD, "A. Operator")
    text = json.dumps(build_bank_document(bank))
    imported = import_bank(database, ideal, parse_bank_file(text), "B. Operator")
    assert (imported.name, imported.version, imported.who) == ("four points", 2, "B. Operator")
    assert imported.entries == GOOD
    assert "A. Operator" in imported.note
    assert import_bank(database, ideal, parse_bank_file(text), "B. Operator", "other").name == "other"


@pytest.mark.parametrize(
    ("change", "code", "values"),
    [
        ({"format": "something"}, "file_of_another_format", {}),
        ({"entries": []}, "wrong_number_of_entries", {"maximum": 20}),
        ({"entries": [{"S_nominal": 10.0, "K_q": "a lot"}]}, "not_a_number", {"key": "K_q", "value": "a lot"}),
        ({"entries": [{"S_nominal": 10.0, "gain": 1.0}]}, "unknown_key", {"name": FIRST_ENTRY}),
        ({"entries": [{"K_q": 0.05}]}, "entry_without_stiffness", {"name": FIRST_ENTRY}),
        ({"entries": [{"S_nominal": 10.0}]}, "not_positive", {"parameter": "K_q", "value": None}),
        ({"name": " "}, "no_name", {}),
        ({"name": "a\nb"}, "invalid_name", {}),
        ({"name": "n" * 61}, "file_without_name", {"maximum": 60}),
    ],
)
def test_invalid_bank_files_are_rejected(
    ideal: PlantParameters, database: Database, change: dict[str, object], code: str, values: dict[str, object]
) -> None:
    with database.session() as session:
        document = build_bank_document(banks.add(session, "b", GOOD[:1], "A. Operator"))
    with refused(BankError, code, **values):
        import_bank(database, ideal, {**document, **change}, "B. Operator")


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", "file_is_not_json"),
        ("[]", "file_is_not_an_object"),
        ("x" * 200_000, "file_too_large"),
        ('{"name": "\\ud800"}', "invalid_text_in_file"),
    ],
)
def test_an_invalid_bank_text_is_rejected(text: str, code: str) -> None:
    with refused(BankError, code):
        parse_bank_file(text)
