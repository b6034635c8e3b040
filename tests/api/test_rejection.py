"""Disturbance rejection through the service: calibration, loss and preview."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from backend.banks import tuning_settings
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.realtime.program import BiasLost
from backend.realtime.supervisor import LoopExited
from backend.schemas.state import TouchOrder, TouchPoint
from backend.schemas.tuning import TrialRequest, TuningRequest
from backend.storage.database import Database, open_database
from plant.parameters import load_parameters
from tests.api.stepped_service import Parts, stepped
from tests.api.test_touch import WHO, at_rest, newest, push


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


async def learned(parts: Parts) -> None:
    await at_rest(parts)
    await parts.actuator.contact.apply(TouchOrder(learn=True), WHO)


def test_rejection_needs_calibration_and_returns_the_joint(database: Database) -> None:
    async def operate(parts: Parts) -> None:
        tuning_service, contact = parts.actuator.tuning_service, parts.actuator.contact
        with pytest.raises(RequestRejectedError, match="learn it first"):
            await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        with pytest.raises(RequestRejectedError, match="learn it first"):
            await tuning_service.start_trial(TrialRequest(k_ext=0.7, duration_s=5.0), WHO)
        assert parts.live_state.tuning.choice.k_ext == 0.0
        await learned(parts)
        with pytest.raises(OutOfRangeError, match="outside force that is rejected"):
            await tuning_service.apply(TuningRequest(k_ext=1.5), WHO)
        view = await tuning_service.apply(TuningRequest(lam_q=2.0, k_ext=1.0), WHO)
        assert (view.lam_q, view.k_ext) == (2.0, 1.0)
        q = newest(parts, "q")
        await push(parts, 5.0, 1.5)
        assert abs(newest(parts, "q") - q) > 0.02  # it swings back out as it is let go
        with pytest.raises(RequestRejectedError, match="k_ext to 0"):
            await contact.apply(TouchOrder(forget=True), WHO)
        assert len(contact.view().learned) == 1
        assert (await tuning_service.apply(TuningRequest(k_ext=0.0), WHO)).k_ext == 0.0
        assert (await contact.apply(TouchOrder(forget=True), WHO)).learned == []

    stepped(database, load_parameters("lab"), operate)


def test_rejection_is_refused_with_a_noisy_estimate(database: Database) -> None:
    async def operate(parts: Parts) -> None:
        await learned(parts)
        contact = parts.actuator.contact
        contact._points = [TouchPoint(S=10.0, F=0.0, std_N=0.2)]
        with pytest.raises(RequestRejectedError, match=r"moves by 0\.2 N"):
            await parts.actuator.tuning_service.apply(TuningRequest(k_ext=0.5), WHO)

    stepped(database, load_parameters("lab"), operate)


@pytest.mark.parametrize("how", [BiasLost(5), LoopExited("for a test")])
def test_lost_bias_disables_rejection_also_in_restored_tunings(database: Database, how: BiasLost | LoopExited) -> None:
    async def operate(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await learned(parts)
        await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        own = parts.live_state.tuning
        await tuning_service.apply_temporary(replace(own.choice, k_ext=0.0, lam_q=0.9), None, WHO)
        parts.actuator.contact._handle_event(how)
        await tuning_service.restore_operator_tuning()
        assert parts.live_state.tuning.choice == replace(own.choice, k_ext=0.0)

        await learned(parts)
        await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        parts.actuator.contact._handle_event(how)
        assert parts.live_state.tuning.choice.k_ext == 0.0
        assert parts.state().tuning.k_ext == 0.0
        assert parts.supervisor.setup.tuning.k_ext == 0.0
        assert "k_ext" in (await tuning_service.undo(WHO)).model_dump()  # to before it was on

    stepped(database, load_parameters("lab"), operate)


def test_service_starts_without_rejection(database: Database) -> None:
    parameters = load_parameters("lab")
    chosen = []

    async def operate(parts: Parts) -> None:
        await learned(parts)
        await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.9, k_ext=0.7), WHO)

    async def again(parts: Parts) -> None:
        chosen.append(parts.live_state.tuning.choice)

    stepped(database, parameters, operate)
    kept = tuning_settings.load_last_tuning(database, parameters)
    assert kept is not None
    assert kept.tuning.k_ext == 0.7
    stepped(database, parameters, again)
    assert chosen == [replace(kept.tuning, k_ext=0.0)]


def test_rejection_is_previewed(database: Database) -> None:
    async def operate(parts: Parts) -> None:
        preview = partial(parts.actuator.tuning_service.preview, compute=asyncio.to_thread)
        plain = (await preview(2.0, 0.5)).pushed
        assert (plain.k_ext, plain.rejected) == (0.0, None)
        pushed = (await preview(2.0, 0.5, k_ext=1.0)).pushed
        assert pushed.without == plain.without
        assert pushed.rejected is not None
        assert pushed.without.back_s is not None
        assert pushed.rejected.back_s is not None
        assert pushed.rejected.back_s < 0.3 * pushed.without.back_s
        assert pushed.rejected.felt_slow > 3.0 * pushed.without.felt_slow
        with pytest.raises(OutOfRangeError):
            await preview(2.0, 0.5, k_ext=1.5)

    stepped(database, load_parameters("ideal"), operate)
