"""Undo and redo of each part of a tuning."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.banks.tuning_settings import TuningSettings, compute_default_tuning
from backend.errors import RequestRejectedError
from backend.schemas.tuning import ChosenTuning, TrialRequest, TuningRequest
from backend.services.state import UNDO_STEPS
from backend.storage import banks, events
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, open_database
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

IDEAL = load_parameters("ideal")
DEFAULT = compute_default_tuning(IDEAL).tuning
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}
WHO = OPERATOR.name
CHANGES = [
    TuningRequest(lam_q=0.61),
    TuningRequest(lam_S=0.57),
    TuningRequest(lam_motor=0.09),
    TuningRequest(b=0.25),
    TuningRequest(interpolate=True),
    TuningRequest(motion="time-optimal", u_plan=7.0),
]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def bank(database: Database) -> Bank:
    entries = [BankEntry(8.24, {**MODEL, "tension_N": 10.0}), BankEntry(10.55, {**MODEL, "tension_N": 20.0})]
    with database.session() as session:
        return banks.add(session, "walked", entries, WHO)


def in_force(parts: Parts) -> TuningSettings:
    """The tuning in force; what a loop that starts anew is given is the same."""
    assert parts.supervisor.setup.tuning == parts.live_state.tuning.build_command()
    return parts.live_state.tuning.choice


def earlier(parts: Parts) -> TuningSettings | None:
    """What the page shows as what undoing puts back."""
    return settings_of(parts.state().earlier)


def later(parts: Parts) -> TuningSettings | None:
    """What the page shows as what is done again."""
    return settings_of(parts.state().later)


def settings_of(shown: ChosenTuning | None) -> TuningSettings | None:
    if shown is None:
        return None
    values = shown.model_dump()
    return TuningSettings.from_values({**values, "bank": 0 if shown.bank is None else shown.bank.id})


def test_undo_and_redo_of_each_part_of_a_tuning(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        assert earlier(parts) is None
        with pytest.raises(RequestRejectedError, match="left to undo"):
            await tuning_service.undo(WHO)
        await tuning_service.use_bank(bank, WHO)
        for change in CHANGES:
            before = in_force(parts)
            await tuning_service.apply(change, WHO)
            changed = in_force(parts)
            assert changed != before
            assert earlier(parts) == before
            await tuning_service.apply(change, WHO)  # the same again is no change
            assert earlier(parts) == before
            view = await tuning_service.undo(WHO)
            assert TuningSettings.from_values({**view.model_dump(), "bank": bank.id}) == before
            assert (in_force(parts), later(parts)) == (before, changed)
            await tuning_service.redo(WHO)
            assert (in_force(parts), earlier(parts), later(parts)) == (changed, before, None)
            with pytest.raises(RequestRejectedError, match="was undone"):
                await tuning_service.redo(WHO)

    stepped(database, IDEAL, work)
    with database.reading() as session:
        told = [event.text for event in events.find(session, limit=100)]
    assert "undone: λ_q 0.61 → 0.5 s" in told
    assert "done again: λ_q 0.5 → 0.61 s" in told
    assert "undone: b 0.25 → 0" in told
    assert "undone: interpolate yes → no" in told


def test_undo_and_redo_of_all_changes(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        past = [in_force(parts)]
        await tuning_service.use_bank(bank, WHO)
        past.append(in_force(parts))
        for change in CHANGES:
            await tuning_service.apply(change, WHO)
            past.append(in_force(parts))
        for before in reversed(past[:-1]):
            await tuning_service.undo(WHO)
            assert in_force(parts) == before
        assert earlier(parts) is None
        for after in past[1:]:
            await tuning_service.redo(WHO)
            assert in_force(parts) == after
        await tuning_service.undo(WHO)
        await tuning_service.apply(TuningRequest(b=0.75), WHO)  # another way on: what was undone is forgotten
        assert (later(parts), earlier(parts)) == (None, past[-2])
        for n in range(2 * UNDO_STEPS):
            await tuning_service.apply(TuningRequest(b=0.2 + 0.01 * n), WHO)
        for _ in range(UNDO_STEPS):
            await tuning_service.undo(WHO)
        assert earlier(parts) is None

    stepped(database, IDEAL, work)


def test_undo_and_redo_of_a_bank(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        assert parts.state().tuning.entry_name == ""
        await tuning_service.use_bank(bank, WHO)
        assert parts.state().tuning.entry_name == "10 N"
        view = await tuning_service.use_bank(None, WHO)
        assert (view.bank, in_force(parts).bank) == (None, 0)
        await tuning_service.undo(WHO)
        assert in_force(parts).bank == bank.id
        await tuning_service.redo(WHO)

    async def started_again(parts: Parts) -> tuple[TuningSettings, TuningSettings | None]:
        return in_force(parts), earlier(parts)

    stepped(database, IDEAL, work)
    # the next start has the same tuning, and knows the one before it
    assert stepped(database, IDEAL, started_again) == (DEFAULT, replace(DEFAULT, bank=bank.id))


def test_undo_after_a_trial_returns_to_before_it(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await tuning_service.apply(TuningRequest(lam_q=0.6), WHO)
        for lam_q in (0.7, 0.8):
            await tuning_service.start_trial(TrialRequest(lam_q=lam_q, duration_s=60.0), WHO)
            assert earlier(parts) == DEFAULT
            with pytest.raises(RequestRejectedError, match="on trial"):
                await tuning_service.undo(WHO)
        await tuning_service.end_trial(True, WHO)
        assert earlier(parts) == replace(DEFAULT, lam_q=0.6)
        await tuning_service.undo(WHO)
        assert in_force(parts) == replace(DEFAULT, lam_q=0.6)
        await tuning_service.start_trial(TrialRequest(lam_q=0.9, duration_s=60.0), WHO)
        await tuning_service.apply(TuningRequest(b=0.5), WHO)  # chosen from the trial: one step back is before both
        assert in_force(parts) == replace(DEFAULT, lam_q=0.9, b=0.5)
        assert earlier(parts) == replace(DEFAULT, lam_q=0.6)

    stepped(database, IDEAL, work)


def test_temporary_tuning_is_no_undo_step(database: Database, bank: Bank) -> None:
    async def work(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await tuning_service.apply(TuningRequest(lam_q=0.6), WHO)
        await tuning_service.apply_temporary(TuningSettings(lam_q=0.9, b=1.0), None, WHO)
        with pytest.raises(RequestRejectedError, match="its tuning is part of its record"):
            await tuning_service.undo(WHO)
        await asyncio.gather(tuning_service.restore_operator_tuning(), tuning_service.restore_operator_tuning())
        assert (in_force(parts), earlier(parts)) == (replace(DEFAULT, lam_q=0.6), DEFAULT)

    stepped(database, IDEAL, work)
