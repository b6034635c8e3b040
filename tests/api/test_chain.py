"""The end of the safety chain by what is driven: nothing is called good, or off, that nobody looks at."""

import pytest

from backend.api.chain import behind_loop
from backend.api.schemas.state import ChainLinkView
from backend.faults import Fault
from backend.loop.card_guard import CardGuard
from plant.card import Card
from plant.choice import PlantChoice, PlantKind

SEEN = (PlantKind.SIMULATOR, PlantKind.RIG, PlantKind.VIRTUAL_CARD)


def behind(kind: PlantKind, fault: Fault = Fault.NONE) -> tuple[ChainLinkView, ChainLinkView]:
    """The two links while the loop runs and the registers are as they are made: nothing is armed."""
    card = Card.create()
    return behind_loop(PlantChoice(kind, package="servo-bench"), card.state(), CardGuard(card), True, fault)


@pytest.mark.parametrize("kind", SEEN)
def test_the_registers_of_a_card_tell(kind: PlantKind) -> None:
    watchdog, module = behind(kind)
    assert (watchdog.good, watchdog.says) == (False, "disarmed, drive-enable off, zero volts")
    assert (module.good, module.says) == (True, "watching")


def test_what_a_package_has_is_neither_good_nor_off() -> None:
    for link in behind(PlantKind.PACKAGE):
        assert (link.good, link.says) == (False, "not seen from here: servo-bench has to bring its own")


def test_a_recording_needs_none() -> None:
    for link in behind(PlantKind.REPLAY):
        assert (link.good, link.says) == (True, "not needed: a recording is played, nothing moves")


@pytest.mark.parametrize("kind", PlantKind)
def test_a_module_that_has_tripped_is_told_whatever_is_driven(kind: PlantKind) -> None:
    watchdog, module = behind(kind, Fault.SAFETY_MODULE)
    assert (watchdog.name, module.name) == ("watchdog", "safety_module")
    assert (module.good, module.says) == (False, "tripped: the motors are cut")
