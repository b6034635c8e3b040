"""The state of samples, of the safety chain and of trips."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from backend.faults import FAULTS, Fault
from backend.realtime.commands import Inject, SetMode
from backend.realtime.heartbeat import WatchdogMonitor
from backend.realtime.modes import MODES, Mode
from backend.realtime.supervisor import Restart, Supervisor
from backend.recording.flight import FlightRecorder, Quota
from backend.sample import NAMES
from backend.schemas.state import ChainLinkView, LinkView, MarkKind, ReferencesView
from backend.services import messages
from backend.services.event_log import MarkAdded
from backend.services.state import Observation, build_downstream_links, build_safety_chain, read_references
from backend.storage import events, flights
from backend.storage.database import Database, open_database
from plant.interface import InjectedFault, InjectedFaultKind, PlantChoice, PlantKind
from plant.parameters import load_parameters
from plant.safety_card import Card, CardState
from tests.api.stepped_service import OPERATOR, Parts, stepped

# Watchdog and safety module in the safety chain of each plant.

PATIENCE_S = 120.0
SEEN = (PlantKind.SIMULATOR, PlantKind.RIG, PlantKind.VIRTUAL_CARD)


def behind(kind: PlantKind, fault: Fault = Fault.NONE) -> tuple[ChainLinkView, ChainLinkView]:
    """Return the two links of a running loop with default registers: nothing is armed."""
    card = Card.create()
    return build_downstream_links(
        PlantChoice(kind, package="servo-bench"), card.state(), WatchdogMonitor(card), True, fault
    )


@pytest.mark.parametrize("kind", SEEN)
def test_links_follow_the_registers_of_a_card(kind: PlantKind) -> None:
    watchdog, module = behind(kind)
    assert (watchdog.good, watchdog.says) == (False, messages.watchdog_disarmed(drives_enabled=False))
    assert (module.good, module.says) == (True, messages.safety_module_monitoring())


@pytest.mark.parametrize("planned", [True, False])
def test_a_planned_restart_is_no_fault_of_the_safety_chain(planned: bool) -> None:
    card = Card.create()
    restart = Restart("applying run 3", 0.0) if planned else None
    stand_in = SimpleNamespace(
        is_alive=False, heartbeat_age_s=None, restarting=restart, card=card, watchdog_monitor=WatchdogMonitor(card),
        setup=SimpleNamespace(plant=PlantChoice(PlantKind.SIMULATOR)),
    )  # fmt: skip
    link = LinkView(alive=False, silent_s=3.0, starts=1, restarting="applying run 3" if planned else "")
    links = {one.name: one for one in build_safety_chain(cast(Supervisor, stand_in), None, link, Fault.NONE)}
    assert list(links) == ["page", "service", "loop", "watchdog", "safety_module"]
    assert [one.good for one in links.values()] == [True, planned, planned, planned, True]
    assert links["loop"].says == (
        messages.loop_restarting(purpose="applying run 3") if planned else messages.no_new_samples()
    )


def test_links_of_a_package_are_unknown() -> None:
    for link in behind(PlantKind.PACKAGE):
        assert (link.good, link.says) == (False, messages.not_monitored(plant="servo-bench"))


def test_recording_needs_no_watchdog() -> None:
    for link in behind(PlantKind.REPLAY):
        assert (link.good, link.says) == (True, messages.not_needed_in_replay())


@pytest.mark.parametrize("kind", PlantKind)
def test_tripped_safety_module_is_shown_for_each_plant(kind: PlantKind) -> None:
    watchdog, module = behind(kind, Fault.SAFETY_MODULE)
    assert (watchdog.name, module.name) == ("watchdog", "safety_module")
    assert (module.good, module.says) == (False, messages.safety_module_tripped())


@pytest.mark.parametrize("kind", [PlantKind.SIMULATOR, PlantKind.VIRTUAL_CARD])
def test_registers_of_a_simulated_card_are_read_without_a_loop(kind: PlantKind) -> None:
    card = Card.create()
    card.expire()
    watchdog, module = build_downstream_links(PlantChoice(kind), card.state(), WatchdogMonitor(card), False, Fault.NONE)
    assert (watchdog.good, watchdog.says) == (False, messages.watchdog_expired(timeout_s=0.0, drives_enabled=False))
    assert (module.good, module.says) == (True, messages.safety_module_monitoring())


def test_last_known_registers_of_a_rig_are_shown_without_a_loop() -> None:
    """The service's own read clears the registers of a simulated card, not the last values of a rig's loop."""
    card = Card.create()
    guard = WatchdogMonitor(card)
    rig = PlantChoice(PlantKind.RIG)
    for link in build_downstream_links(rig, card.state(), guard, False, Fault.NONE):
        assert (link.good, link.says) == (False, messages.unknown_without_loop())
    card.mirror(CardState(0, 0, True, True, False, False, False, True, 0.05, 1.0, 2.0))
    watchdog, module = build_downstream_links(rig, card.state(), guard, True, Fault.NONE)
    assert (watchdog.good, module.good) == (True, True)
    asyncio.run(asyncio.wait_for(guard.run(None), PATIENCE_S))
    assert "which the service cannot observe" in guard.problem
    links = build_downstream_links(rig, card.state(), guard, False, Fault.NONE)
    states = messages.watchdog_armed(drives_enabled=True), messages.safety_module_monitoring()
    assert [(link.good, link.says) for link in links] == [
        (False, messages.unknown_since_loop_ended(state=state)) for state in states
    ]


# The state of the newest sample: an active reference is shown as one, all else as measured.

SAMPLE = {"q": 0.1, "S": 3.73}


@pytest.mark.parametrize(
    ("sample", "shown"),
    [
        (None, (0.0, None, False)),
        ({"q_ref": nan, "S_ref": nan, "S": nan}, (0.1, None, False)),
        ({"q_ref": 0.2, "S_ref": 10.0}, (0.2, 10.0, True)),
        ({"q_ref": nan, "S_ref": nan}, (0.1, 3.73, False)),
        ({"q_ref": 0.2, "S_ref": nan}, (0.2, 3.73, False)),
    ],
)
def test_measured_values_are_not_shown_as_references(
    sample: dict[str, float] | None, shown: tuple[float, float | None, bool]
) -> None:
    q_ref, S_ref, in_force = shown
    references = read_references(None if sample is None else {**SAMPLE, **sample})
    assert references == ReferencesView(q_ref=q_ref, S_ref=S_ref, in_force=in_force)


def test_all_values_of_a_state_are_of_one_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop trips between two reads of the ring buffer: mode and references are of one sample."""
    rest = dict.fromkeys(NAMES, 0.0) | {"q": 0.1, "S": 3.73}
    running = rest | {"mode": MODES.index(Mode.RUN), "tick": 1.0, "q_ref": 0.2, "S_ref": 10.0}
    tripped = rest | {"mode": MODES.index(Mode.TRIPPED), "tick": 2.0, "q_ref": nan, "S_ref": nan}
    tripped["fault"] = FAULTS.index(Fault.OPERATOR_LOST)
    seen = {"running": (Mode.RUN, None, True, 1), "tripped": (Mode.TRIPPED, "operator_lost", False, 2)}
    samples: list[dict[str, float]] = []
    monkeypatch.setattr(Observation, "sample", lambda _: samples.pop() if samples else tripped)

    async def states(parts: Parts) -> None:
        for reads_before in range(12):
            samples[:] = [running] * reads_before
            state = parts.state()
            fault = state.fault and state.fault.code
            assert (state.mode, fault, state.references.in_force, state.tick) == seen[
                "running" if reads_before else "tripped"
            ]

    database = open_database(tmp_path)
    stepped(database, load_parameters("ideal"), states)
    database.close()


# A trip that the commissioning provokes, and a stop of a replay, are planned: no alarm, no flight record.


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.mark.parametrize("provoked", [Fault.NONE, Fault.SAFETY_MODULE, Fault.SLACK])
def test_only_the_provoked_trip_is_expected(database: Database, provoked: Fault) -> None:
    expected = provoked is Fault.SAFETY_MODULE

    async def work(parts: Parts) -> None:
        live_state, supervisor = parts.live_state, parts.supervisor
        recorder = FlightRecorder(database, lambda: supervisor.ring, Quota(9, 10**9), live_state.is_expected)
        supervisor.listen(recorder.on_event)
        marks: list[tuple[MarkKind, str]] = []
        parts.events.subscribe(MarkAdded, lambda added: marks.append((added.mark.kind, added.mark.text)))
        live_state.provoked_fault = provoked
        await supervisor.send(SetMode(Mode.PRETENSION))
        await supervisor.advance(0.1)
        await supervisor.send(Inject(InjectedFault(InjectedFaultKind.SAFETY_TRIP)))
        await supervisor.advance(0.1)

        fault = parts.state().fault
        assert fault is not None
        assert (fault.code, fault.expected) == (Fault.SAFETY_MODULE, expected)
        assert "F_A = " in fault.message
        (kind,) = [kind for kind, text in marks if "safety module" in text]
        assert kind is (MarkKind.NOTE if expected else MarkKind.TRIP)
        recorder.close()
        with database.reading() as session:
            assert len(flights.find(session)) == (0 if expected else 1)
        assert live_state.is_expected(Fault.NONE) is False

    stepped(database, load_parameters("ideal"), work)


def test_no_stop_of_a_recording_is_an_alarm_and_any_other_plant_error_is_one(database: Database) -> None:
    async def work(parts: Parts) -> None:
        for kind in PlantKind:
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            for fault in (Fault.PLANT_ERROR, Fault.FORCE_LIMIT, Fault.STOP_PRESSED):
                assert parts.live_state.is_expected(fault) is (kind is PlantKind.REPLAY)

    stepped(database, load_parameters("ideal"), work)


# A loop that failed with an internal error is not reset: a new one is started.


def test_reset_starts_a_new_loop_after_an_internal_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database = open_database(tmp_path)
    started: list[str] = []

    async def restart(_supervisor: Supervisor, purpose: str) -> None:
        started.append(purpose)

    def fail(*_: object) -> int:
        raise ZeroDivisionError("a gain of zero")

    async def work(parts: Parts) -> None:
        monkeypatch.setattr(parts.supervisor._stepped._loop._step, "detect_faults", fail)
        await parts.supervisor.advance_until(lambda: parts.live_state.fault is Fault.INTERNAL_ERROR, timeout_s=5.0)
        assert parts.supervisor.is_alive
        await parts.actuator.reset(OPERATOR.name)

    monkeypatch.setattr(Supervisor, "restart", restart)
    stepped(database, load_parameters("ideal"), work)
    with database.reading() as session:
        texts = [event.text for event in events.find(session, limit=100)]
    database.close()
    assert len(started) == 1
    assert "control loop restarted" in texts
    assert any("ZeroDivisionError" in text for text in texts)
