"""The service's own look at the card's registers, which it shares with the loop and the watchdog."""

import asyncio
import logging
from asyncio.subprocess import Process

from backend.supervision import Part
from plant.safety_card import WATCHDOG_S, Card, Stillness

PART = Part("The watch over the card's watchdog", "A watchdog that dies now is found by the loop alone.")

LOOK_S = 0.05
"""How often the service looks [s]."""

LAST_RESORT_S = WATCHDOG_S + 0.1
"""The outputs of a dead loop are cleared by the service after so long without a write [s]: the watchdog comes first."""

_LOG = logging.getLogger(__name__)


class CardGuard:
    """Looks at one card; ``problem`` says what is wrong with its watchdog.

    Clearing the outputs is the last resort where the loop and the watchdog are both dead. It works because the service
    holds the simulator's registers. Into a rig's card nobody but the loop can look: what is shown of it is a mirror,
    and what is left behind a dead loop is that card's own watchdog and the safety module.
    """

    def __init__(self, card: Card) -> None:
        self.problem = ""
        self._card = card
        self._looks = Stillness(LOOK_S)
        self._writes = Stillness(LOOK_S)

    @property
    def watchdog_silent_s(self) -> float:
        """For how long the watchdog has not been seen to look [s]."""
        return self._looks.still_s

    @property
    def watchdog_lost(self) -> bool:
        """Whether nobody would take the drives away if the loop died: found by the loop, or seen here."""
        state = self._card.state()
        seen_dead = state.armed and state.drive_enabled and self._looks.still_s > WATCHDOG_S
        return state.watchdog_dead or (seen_dead and not state.mirror)

    def look(self, loop_gone: bool) -> bool:
        """Look once, at the times LOOK_S apart; return whether there is anything left to guard."""
        state = self._card.state()
        self._looks.seen(state.looks)
        unwritten_s = self._writes.seen(state.writes)
        if self.watchdog_lost and not self.problem:
            self._tell("the card's watchdog is dead: reset starts a new loop with a new one")
        if loop_gone and state.drive_enabled and unwritten_s > LAST_RESORT_S:
            if state.mirror:  # it stays as it is: what was last known
                if not self.problem:
                    self._tell(
                        f"the loop is dead: the rig's card cuts the drives by its watchdog, {state.watchdog_s:g} s "
                        "after the last write, which cannot be seen from here; look at the rig, then reset"
                    )
                return False
            self._card.expire()
            self._tell(
                "the loop and the card's watchdog were both dead: the service cleared the outputs itself; "
                "look at the rig, then reset"
            )
        return not loop_gone or self._card.state().drive_enabled

    async def run(self, loop: Process | None) -> None:
        """Look until the loop process has ended, or is known to have ended, and the drives are off."""
        while self.look(loop_gone=loop is None or loop.returncode is not None):
            await asyncio.sleep(LOOK_S)

    def _tell(self, problem: str) -> None:
        self.problem = problem
        _LOG.error(problem)
