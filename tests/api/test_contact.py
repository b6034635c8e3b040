"""Contact detection and disturbance rejection through the service."""

import asyncio
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from backend.banks import tuning_settings
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.realtime.commands import ApplyPush as PushCommand
from backend.realtime.commands import Obstruct
from backend.realtime.messages import compliant_after_contact
from backend.realtime.modes import Mode
from backend.realtime.program import BiasLost
from backend.realtime.supervisor import LoopExited
from backend.sample import INDEX
from backend.schemas.state import TouchOrder, TouchPoint, TouchView
from backend.schemas.tuning import TrialRequest, TuningRequest
from backend.services import messages
from backend.storage import events, runs
from backend.storage.database import Database, open_database
from plant import Message
from plant.dynamics import Obstacle
from plant.interface import InjectedFault, InjectedFaultKind
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.refusals import refused

# Contact detection through the service: calibration, threshold and contacts.

WHO = OPERATOR.name


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


async def at_rest(parts: Parts, S_ref: float = 10.0) -> None:
    if parts.live_state.mode is Mode.OFF:
        await parts.actuator.set_mode(Mode.PRETENSION, WHO)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
    if parts.live_state.mode is Mode.PRETENSION:
        await parts.actuator.set_mode(Mode.RUN, WHO)
    await parts.actuator.set_references(0.2, S_ref, WHO)
    await parts.supervisor.advance(8.0)


async def push(parts: Parts, F_push: float, seconds: float = 1.0) -> None:
    await parts.supervisor.send(PushCommand(F_push, seconds))
    await parts.supervisor.advance(seconds + 0.2)


def newest(parts: Parts, name: str) -> float:
    row = parts.supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX[name]])


def test_calibrated_bias_is_subtracted_at_its_stiffness(database: Database) -> None:
    async def learn(parts: Parts) -> None:
        contact = parts.actuator.contact
        await at_rest(parts, 10.0)
        before = newest(parts, "F_ext_hat")
        assert abs(before) > 0.1
        (point,) = (await contact.apply(TouchOrder(learn=True), WHO)).learned
        assert pytest.approx(10.0, abs=0.05) == point.S
        assert pytest.approx(before, abs=0.2) == point.F
        assert 0.0 < point.std_N < 0.15
        await parts.supervisor.advance(1.0)
        assert newest(parts, "F_ext_hat") == pytest.approx(0.0, abs=0.2)
        await at_rest(parts, 14.0)
        both = (await contact.apply(TouchOrder(learn=True), WHO)).learned
        assert [round(one.S) for one in both] == [10, 14]
        assert both[0] == point
        with refused(
            RequestRejectedError, "bias_not_measured", reason=messages.bias_or_references_changed(duration_s=1.0)
        ):
            await contact.apply(TouchOrder(learn=True), WHO)
        await parts.supervisor.advance(1.1)
        again = (await contact.apply(TouchOrder(learn=True), WHO)).learned
        assert [round(one.S) for one in again] == [10, 14]  # replaces the previous one
        assert pytest.approx(both[1].F, abs=0.1) == again[1].F
        assert parts.state().touch.learned == again
        assert (await contact.apply(TouchOrder(forget=True), WHO)).learned == []
        await parts.supervisor.advance(0.5)
        assert newest(parts, "F_ext_hat") == pytest.approx(both[1].F, abs=0.3)

    stepped(database, load_parameters("lab"), learn)
    with database.reading() as session:
        texts = [event.text for event in events.find(session)]
    assert sum(text.startswith(messages.bias_calibrated(points=[])) for text in texts) == 3
    assert messages.bias_discarded() in texts


def test_calibration_is_refused_while_an_input_acts_or_the_joint_moves(database: Database) -> None:
    async def moving(parts: Parts) -> None:
        async def why() -> str:
            with pytest.raises(RequestRejectedError) as error:
                await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=2.0), WHO)
            assert parts.state().touch.learned == []
            assert parts.state().touch.contact_N == 0.0
            reason = error.value.message.values["reason"]
            assert isinstance(reason, Message)
            assert error.value.message.code == "bias_not_measured"
            return reason.code

        assert await why() == "external_force_not_available"
        await parts.actuator.set_mode(Mode.PRETENSION, WHO)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        await parts.supervisor.advance(1.5)
        assert await why() == "not_held_in_mode_run"
        await at_rest(parts)
        await push(parts, 1.0, 0.5)
        assert await why() == "joint_is_pushed"
        await parts.supervisor.send(Obstruct(Obstacle(1.0, 0.25, 5e3, 1.0)))
        await parts.actuator.set_references(0.27, 10.0, WHO)
        await parts.supervisor.advance(6.0)
        assert await why() == "joint_presses_obstacle"
        await parts.supervisor.send(Obstruct(None))
        await parts.actuator.set_references(0.6, 10.0, WHO)
        await parts.supervisor.advance(1.0)
        assert await why() == "joint_not_at_rest"

    stepped(database, load_parameters("lab"), moving)


def test_contact_reaction_needs_calibration_and_low_noise(database: Database) -> None:
    async def arm(parts: Parts) -> None:
        contact = parts.actuator.contact
        await at_rest(parts)
        with refused(RequestRejectedError, "contact_reaction_needs_bias"):
            await contact.apply(TouchOrder(contact_N=1.5), WHO)
        for contact_N in (0.5, 31.0, -1.0):
            with pytest.raises(OutOfRangeError) as error:
                await contact.apply(TouchOrder(learn=True, contact_N=contact_N), WHO)
            assert error.value.quantity == "contact_N"
        armed = await contact.apply(TouchOrder(learn=True, contact_N=1.5), WHO)
        assert armed.contact_N == 1.5
        with refused(RequestRejectedError, "contact_reaction_needs_bias"):
            await contact.apply(TouchOrder(forget=True), WHO)
        assert parts.state().touch == armed
        assert (await contact.apply(TouchOrder(forget=True, contact_N=0.0), WHO)).contact_N == 0.0
        await push(parts, 5.0)
        assert parts.live_state.mode is Mode.RUN

    stepped(database, load_parameters("lab"), arm)


def test_contact_is_shown_until_the_next_mode_change(database: Database) -> None:
    async def touched(parts: Parts) -> None:
        await at_rest(parts)
        await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=1.5), WHO)
        recorded = parts.state().recording_run
        await push(parts, 5.0)
        state = parts.state()
        assert state.mode is Mode.COMPLIANCE
        assert state.recording_run == recorded
        assert state.touch.felt is not None
        assert 1.5 < state.touch.felt.F_ext_hat < 2.5
        assert state.touch.felt.contact_N == 1.5
        with pytest.raises(RequestRejectedError, match=re.escape(compliant_after_contact())):
            await parts.actuator.set_references(0.0, 10.0, WHO)
        await parts.actuator.set_mode(Mode.RUN, WHO)
        state = parts.state()
        assert state.touch.felt is None
        assert state.touch.contact_N == 1.5
        await parts.actuator.set_references(0.0, 10.0, WHO)

    stepped(database, load_parameters("lab"), touched)
    with database.reading() as session:
        texts = [event.text for event in events.find(session)]
        states = {run.end_state for run in runs.find(session)}
    assert any(text.startswith("contact: ") and "contact reaction" in text for text in texts)
    assert "failed" not in states


def test_new_zeros_and_a_new_loop_discard_the_calibration(database: Database) -> None:
    async def restart_loop(parts: Parts) -> None:
        await at_rest(parts)
        await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=1.5), WHO)
        for broken, is_known in (
            (InjectedFault(InjectedFaultKind.SAFETY_TRIP), True),
            (InjectedFault(InjectedFaultKind.JUMP), False),
        ):
            await parts.actuator.inject_fault(broken, WHO)
            await parts.supervisor.advance(0.5)
            assert parts.live_state.mode is Mode.TRIPPED
            await parts.actuator.inject_fault(None, WHO)
            await parts.supervisor.advance(0.5)
            await parts.actuator.reset(WHO)
            await at_rest(parts)
            touch = parts.state().touch
            assert (touch.contact_N == 1.5, len(touch.learned) == 1) == (is_known, is_known)
        await push(parts, 5.0)
        assert parts.live_state.mode is Mode.RUN
        await parts.supervisor.advance(2.0)
        await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=1.5), WHO)
        parts.supervisor.dead = True
        parts.actuator.contact._handle_event(LoopExited("killed"))
        assert parts.state().touch == TouchView(contact_N=0.0, learned=[], felt=None)

    stepped(database, load_parameters("lab"), restart_loop)


# Disturbance rejection through the service: calibration, loss and preview.


async def learned(parts: Parts) -> None:
    await at_rest(parts)
    await parts.actuator.contact.apply(TouchOrder(learn=True), WHO)


def test_rejection_needs_calibration_and_returns_the_joint(database: Database) -> None:
    async def operate(parts: Parts) -> None:
        tuning_service, contact = parts.actuator.tuning_service, parts.actuator.contact
        with pytest.raises(RequestRejectedError, match="calibrate it first"):
            await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        with pytest.raises(RequestRejectedError, match="calibrate it first"):
            await tuning_service.start_trial(TrialRequest(k_ext=0.7, duration_s=5.0), WHO)
        assert parts.live_state.tuning.settings.k_ext == 0.0
        await learned(parts)
        with pytest.raises(OutOfRangeError) as caught:
            await tuning_service.apply(TuningRequest(k_ext=1.5), WHO)
        assert (caught.value.quantity, caught.value.value, caught.value.maximum) == ("k_ext", 1.5, 1.0)
        view = await tuning_service.apply(TuningRequest(lam_q=2.0, k_ext=1.0), WHO)
        assert (view.lam_q, view.k_ext) == (2.0, 1.0)
        q = newest(parts, "q")
        await push(parts, 5.0, 1.5)
        assert abs(newest(parts, "q") - q) > 0.02  # the joint returns when it is released
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
        with refused(RequestRejectedError, "rejection_within_noise", std_N=0.2):
            await parts.actuator.tuning_service.apply(TuningRequest(k_ext=0.5), WHO)

    stepped(database, load_parameters("lab"), operate)


@pytest.mark.parametrize("how", [BiasLost(5), LoopExited("for a test")])
def test_lost_bias_disables_rejection_also_in_restored_tunings(database: Database, how: BiasLost | LoopExited) -> None:
    async def operate(parts: Parts) -> None:
        tuning_service = parts.actuator.tuning_service
        await learned(parts)
        await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        own = parts.live_state.tuning
        await tuning_service.apply_temporary(replace(own.settings, k_ext=0.0, lam_q=0.9), None, WHO)
        parts.actuator.contact._handle_event(how)
        await tuning_service.restore_operator_tuning()
        assert parts.live_state.tuning.settings == replace(own.settings, k_ext=0.0)

        await learned(parts)
        await tuning_service.apply(TuningRequest(k_ext=0.7), WHO)
        parts.actuator.contact._handle_event(how)
        assert parts.live_state.tuning.settings.k_ext == 0.0
        assert parts.state().tuning.k_ext == 0.0
        assert parts.supervisor.setup.tuning.k_ext == 0.0
        assert "k_ext" in (await tuning_service.undo(WHO)).model_dump()  # to the tuning before it was enabled

    stepped(database, load_parameters("lab"), operate)


def test_service_starts_without_rejection(database: Database) -> None:
    parameters = load_parameters("lab")
    chosen = []

    async def operate(parts: Parts) -> None:
        await learned(parts)
        await parts.actuator.tuning_service.apply(TuningRequest(lam_q=0.9, k_ext=0.7), WHO)

    async def again(parts: Parts) -> None:
        chosen.append(parts.live_state.tuning.settings)

    stepped(database, parameters, operate)
    saved = tuning_settings.load_last_tuning(database, parameters)
    assert saved is not None
    assert saved.tuning.k_ext == 0.7
    stepped(database, parameters, again)
    assert chosen == [replace(saved.tuning, k_ext=0.0)]


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
