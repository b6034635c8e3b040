"""Watchdog and safety module in the safety chain of each plant."""

import asyncio
from types import SimpleNamespace
from typing import cast

import pytest

from backend.faults import Fault
from backend.realtime.heartbeat import WatchdogMonitor
from backend.realtime.supervisor import Restart, Supervisor
from backend.schemas.state import ChainLinkView, LinkView
from backend.services.state import build_downstream_links, build_safety_chain
from plant.interface import PlantChoice, PlantKind
from plant.safety_card import Card, CardState

PATIENCE_S = 120.0
SEEN = (PlantKind.SIMULATOR, PlantKind.RIG, PlantKind.VIRTUAL_CARD)


def behind(kind: PlantKind, fault: Fault = Fault.NONE) -> tuple[ChainLinkView, ChainLinkView]:
    """The two links while the loop runs and the registers are as they are made: nothing is armed."""
    card = Card.create()
    return build_downstream_links(
        PlantChoice(kind, package="servo-bench"), card.state(), WatchdogMonitor(card), True, fault
    )


@pytest.mark.parametrize("kind", SEEN)
def test_links_follow_the_registers_of_a_card(kind: PlantKind) -> None:
    watchdog, module = behind(kind)
    assert (watchdog.good, watchdog.says) == (False, "disarmed, drive-enable off, zero volts")
    assert (module.good, module.says) == (True, "watching")


@pytest.mark.parametrize("planned", [True, False])
def test_a_planned_restart_is_no_fault_of_the_chain(planned: bool) -> None:
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
    assert links["loop"].says == ("is restarted: applying run 3" if planned else "does not tick")


def test_links_of_a_package_are_unknown() -> None:
    for link in behind(PlantKind.PACKAGE):
        assert (link.good, link.says) == (False, "not seen from here: servo-bench has to bring its own")


def test_recording_needs_no_watchdog() -> None:
    for link in behind(PlantKind.REPLAY):
        assert (link.good, link.says) == (True, "not needed: a recording is played, nothing moves")


@pytest.mark.parametrize("kind", PlantKind)
def test_tripped_safety_module_is_shown_for_each_plant(kind: PlantKind) -> None:
    watchdog, module = behind(kind, Fault.SAFETY_MODULE)
    assert (watchdog.name, module.name) == ("watchdog", "safety_module")
    assert (module.good, module.says) == (False, "tripped: the motors are cut")


@pytest.mark.parametrize("kind", [PlantKind.SIMULATOR, PlantKind.VIRTUAL_CARD])
def test_registers_of_a_simulated_card_are_read_without_a_loop(kind: PlantKind) -> None:
    card = Card.create()
    card.expire()
    watchdog, module = build_downstream_links(PlantChoice(kind), card.state(), WatchdogMonitor(card), False, Fault.NONE)
    assert (watchdog.good, watchdog.says) == (False, "expired after 0 s without a write: drive-enable off, zero volts")
    assert (module.good, module.says) == (True, "watching")


def test_last_known_registers_of_a_rig_are_shown_without_a_loop() -> None:
    """The service's own look, which clears the registers of a simulated card, leaves what the loop knew of a rig's."""
    card = Card.create()
    guard = WatchdogMonitor(card)
    rig = PlantChoice(PlantKind.RIG)
    for link in build_downstream_links(rig, card.state(), guard, False, Fault.NONE):
        assert (link.good, link.says) == (False, "not seen: no loop has run yet")
    card.mirror(CardState(0, 0, True, True, False, False, False, True, 0.05, 1.0, 2.0))
    watchdog, module = build_downstream_links(rig, card.state(), guard, True, Fault.NONE)
    assert (watchdog.good, module.good) == (True, True)
    asyncio.run(asyncio.wait_for(guard.run(None), PATIENCE_S))
    assert "cannot be seen from here" in guard.problem
    links = build_downstream_links(rig, card.state(), guard, False, Fault.NONE)
    since = "not seen since the loop ended; last known: "
    assert [(link.good, link.says) for link in links] == [
        (False, f"{since}armed, drive-enable on"),
        (False, f"{since}watching"),
    ]
