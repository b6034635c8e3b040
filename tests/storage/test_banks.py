"""Names of bank entries, and the display of their fit."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest

from backend.identification.models import Grade, joint_method_name
from backend.storage import messages
from backend.storage.banks import (
    BankEntry,
    StoredFit,
    active_entry_name,
    read_fits,
    read_method_name,
    stored_entry_name,
)
from backend.storage.identifications import Identification
from tests.models.earlier_identifications import MODEL, QUALITY

ENTRIES = (BankEntry(8.24, {"tension_N": 10.0}), BankEntry(10.55, {"tension_N": 20.5}), BankEntry(12.43, {}))
FOUND = Identification(
    kind="actuator",
    run_id=5,
    data={},
    method="default",
    options={},
    model={
        "S_nominal": 10.5,
        "G_q": MODEL | {"first_order": {"K": 0.05, "T": 0.4, "K_std": 0.001, "T_std": 0.02}},
        "G_S": MODEL | {"first_order": {"K": -0.5, "T": 0.4, "K_std": 0.005, "T_std": None}, "method": None},
    },
    quality={
        "G_q": QUALITY | {"fit_percent": 98.17, "grade": "usable"},
        "G_S": QUALITY | {"fit_percent": None, "grade": "usable with caution"},
    },
    usable=True,
    verdict="",
    who="Ana",
    software="0.1.0",
    id=3,
    created_at=datetime.now(UTC),
)


def test_a_bank_entry_is_named_by_its_tension_or_else_its_stiffness() -> None:
    assert [stored_entry_name(entry) for entry in ENTRIES] == ["10 N", "20.5 N", "12.43 N·m/rad"]


@pytest.mark.parametrize(
    ("active", "said"),
    [
        (0.0, "10 N"),
        (0.25, messages.between_entries(low="10 N", high="20.5 N", share=0.25)),
        (1.0, "20.5 N"),
        (2.0, "12.43 N·m/rad"),
        (7.0, "12.43 N·m/rad"),  # of a bank that has just been changed for one with fewer
    ],
)
def test_the_active_entry_is_shown_by_name(active: float, said: str) -> None:
    assert active_entry_name(ENTRIES, active) == said


def test_a_fit_belongs_to_its_own_identification_with_its_errors() -> None:
    fits = read_fits(FOUND)
    described = {name: fit.in_words() for name, fit in fits.items()}
    assert described["G_q"] == messages.quality_of_fit(
        grade=Grade.USABLE, fit_percent=98.17, K_error_percent=2.0, T_error_percent=5.0
    )
    assert described["G_S"] == messages.quality_of_fit(
        grade=Grade.CAUTION, fit_percent=None, K_error_percent=1.0, T_error_percent=None
    )


@pytest.mark.parametrize(
    ("model", "quality"), [({}, FOUND.quality), (FOUND.model, {}), (FOUND.model, FOUND.quality | {"version": 2})]
)
def test_an_unreadable_identification_has_no_fit(model: dict[str, Any], quality: dict[str, Any]) -> None:
    found = replace(FOUND, model=model, quality=quality)
    assert read_fits(found) == dict.fromkeys(("G_q", "G_S"), StoredFit(None, None, None, None))
    assert read_fits(found)["G_q"].in_words() == messages.quality_of_fit(
        grade=None, fit_percent=None, K_error_percent=None, T_error_percent=None
    )
    assert read_method_name(found) == "default"


def test_a_channel_without_a_method_uses_that_of_the_identification() -> None:
    assert read_method_name(FOUND) == joint_method_name({"G_q": "output error", "G_S": "default"})
