"""What an entry of a bank is called, and how its fit is told."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from backend.storage.banks import BankEntry, active_entry_name, read_fits, stored_entry_name
from backend.storage.identifications import Identification

ENTRIES = (BankEntry(8.24, {"tension_N": 10.0}), BankEntry(10.55, {"tension_N": 20.5}), BankEntry(12.43, {}))
FOUND = Identification(
    kind="actuator",
    run_id=5,
    data={},
    method="output_error",
    options={},
    model={
        "G_q": {"first_order": {"K": 0.05, "T": 0.4, "K_std": 0.001, "T_std": 0.02}},
        "G_S": {"first_order": {"K": -0.5, "T": 0.4, "K_std": 0.005, "T_std": None}},
    },
    quality={
        "G_q": {"fit_percent": 98.17, "grade": "usable"},
        "G_S": {"fit_percent": None, "grade": "usable with caution"},
    },
    usable=True,
    verdict="",
    who="Ana",
    software="0.1.0",
    id=3,
    created_at=datetime.now(UTC),
)


def test_an_entry_goes_by_its_tension_and_without_one_by_its_stiffness() -> None:
    assert [stored_entry_name(entry) for entry in ENTRIES] == ["10 N", "20.5 N", "12.43 N·m/rad"]


@pytest.mark.parametrize(
    ("active", "said"),
    [
        (0.0, "10 N"),
        (0.25, "10 N to 20.5 N, 25 % of the way"),
        (1.0, "20.5 N"),
        (2.0, "12.43 N·m/rad"),
        (7.0, "12.43 N·m/rad"),  # of a bank that has just been changed for one with fewer
    ],
)
def test_what_is_in_use_is_told_by_name(active: float, said: str) -> None:
    assert active_entry_name(ENTRIES, active) == said


def test_a_fit_is_that_of_its_own_identification_with_its_errors() -> None:
    fits = read_fits(FOUND)
    assert fits["G_q"].in_words() == "usable, fit 98.2 %, standard errors: K 2 %, T 5 %"
    assert fits["G_S"].in_words() == "usable with caution, fit not measured, standard errors: K 1 %, T not measured"


def test_an_older_identification_says_what_it_did_not_keep() -> None:
    older = read_fits(replace(FOUND, quality={}, model={}))["G_q"]
    assert older.in_words() == "grade not recorded, fit not measured, standard errors: K not measured, T not measured"
