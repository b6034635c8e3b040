"""The safety chain as it stands: from the page that holds control to the safety module, each watched by the next."""

from typing import assert_never

from backend.faults import Fault
from backend.realtime.heartbeat import CardGuard
from backend.realtime.process import SILENCE_S
from backend.realtime.supervisor import Supervisor
from backend.schemas.state import ChainLinkView, HolderView, LinkView
from plant.interface import PlantChoice, PlantKind
from plant.safety_card import CardState

LOOP_SILENT_S = 1.0
"""A loop without a new sample for so long [s] is not well."""


def chain(supervisor: Supervisor, holder: HolderView | None, link: LinkView, fault: Fault) -> list[ChainLinkView]:
    """Return the five links of the chain in order."""
    alive = supervisor.alive
    beat_s = supervisor.beat_age_s
    ticks = alive and link.silent_s < LOOP_SILENT_S
    if supervisor.restarting is not None and not ticks:
        return [_page(holder), *_restarting(supervisor, link, fault)]
    return [
        _page(holder),
        ChainLinkView(
            name="service",
            good=beat_s is not None and beat_s < SILENCE_S,
            silent_s=beat_s,
            says="beats" if beat_s is not None else "has no loop to beat for",
        ),
        ChainLinkView(name="loop", good=ticks, silent_s=link.silent_s, says="ticks" if ticks else "does not tick"),
        *behind_loop(supervisor.setup.plant, supervisor.card.state(), supervisor.guard, alive, fault),
    ]


def _restarting(supervisor: Supervisor, link: LinkView, fault: Fault) -> list[ChainLinkView]:
    """Return the links behind the page while the loop process is replaced as planned, drives off: that is no fault."""
    card, guard = supervisor.card.state(), supervisor.guard
    behind = behind_loop(supervisor.setup.plant, card, guard, False, fault)
    sound = not (card.expired or card.safety_tripped or guard.watchdog_lost or fault is Fault.SAFETY_MODULE)
    return [
        ChainLinkView(name="service", good=True, silent_s=None, says="waits for the loop"),
        ChainLinkView(name="loop", good=True, silent_s=None, says=f"is restarted: {link.restarting}"),
        *(one.model_copy(update={"good": one.good or sound}) for one in behind),
    ]


def behind_loop(
    plant: PlantChoice, card: CardState, guard: CardGuard, alive: bool, fault: Fault
) -> tuple[ChainLinkView, ChainLinkView]:
    """Return watchdog and safety module: what is left when the loop is not.

    Only the registers of a card tell of them, and of a rig's card nothing is seen but through its loop. A recording
    has none and moves nothing; what a package has is not seen from here, so it is not called good.
    """
    tripped = fault is Fault.SAFETY_MODULE
    match plant.kind:
        case PlantKind.SIMULATOR | PlantKind.RIG | PlantKind.VIRTUAL_CARD:
            links = _watchdog(card, guard, alive), _safety_module(card.safety_tripped or tripped)
            if plant.kind is PlantKind.RIG and not alive:
                return _last_known(card, links[0]), _last_known(card, links[1])
            return links
        case PlantKind.REPLAY:
            good, says = True, "not needed: a recording is played, nothing moves"
        case PlantKind.PACKAGE:
            good, says = False, f"not seen from here: {plant.name} has to bring its own"
        case _:
            assert_never(plant.kind)
    watchdog = ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)
    unseen = ChainLinkView(name="safety_module", good=good, silent_s=None, says=says)
    return watchdog, _safety_module(tripped) if tripped else unseen


def _page(holder: HolderView | None) -> ChainLinkView:
    if holder is None:
        return ChainLinkView(name="page", good=True, silent_s=None, says="nobody holds control")
    if not holder.page:
        return ChainLinkView(name="page", good=True, silent_s=None, says=f"a script holds control ({holder.name})")
    says = f"{holder.name} is not heard: references are held" if holder.lost else f"{holder.name} is heard"
    return ChainLinkView(name="page", good=not holder.lost, silent_s=holder.silent_s, says=says)


def _watchdog(card: CardState, guard: CardGuard, alive: bool) -> ChainLinkView:
    line = "drive-enable on" if card.drive_enabled else "drive-enable off, zero volts"
    if guard.watchdog_lost:
        says = f"dead, not seen for {guard.watchdog_silent_s:.1f} s: {line}; reset starts a new one"
    elif card.expired:
        says = f"expired after {card.watchdog_s:g} s without a write: {line}"
    elif card.armed:
        says = f"armed, {line}"
    else:
        says = f"disarmed, {line}"
    good = alive and card.armed and not card.expired and not guard.watchdog_lost
    return ChainLinkView(name="watchdog", good=good, silent_s=None, says=says)


def _safety_module(tripped: bool) -> ChainLinkView:
    says = "tripped: the motors are cut" if tripped else "watching"
    return ChainLinkView(name="safety_module", good=not tripped, silent_s=None, says=says)


def _last_known(card: CardState, link: ChainLinkView) -> ChainLinkView:
    says = f"not seen since the loop ended; last known: {link.says}" if card.mirror else "not seen: no loop has run yet"
    return link.model_copy(update={"good": False, "says": says})
