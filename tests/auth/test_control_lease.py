"""The order in which the commands of a page are executed."""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any

import pytest

from backend.auth.control_lease import BUSY_S, GAP_S, WAITING, CommandSequencer
from backend.errors import RequestRejectedError


class SkippingSelector(selectors.DefaultSelector):
    """Skips a wait without ready descriptors and adds it to the simulated time."""

    skipped_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        found = super().select(0 if timeout else timeout)
        if not found and timeout is not None:
            self.skipped_s += max(timeout, 0.0)
        return found


class SimulatedTimeLoop(asyncio.SelectorEventLoop):
    """An event loop with simulated time, which a slow machine does not delay."""

    def __init__(self) -> None:
        self._waits = SkippingSelector()
        super().__init__(self._waits)

    def time(self) -> float:
        return self._waits.skipped_s


def run(session: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=SimulatedTimeLoop) as runner:
        runner.run(session)


class CommandLog:
    """Runs commands and logs when they begin and end."""

    def __init__(self) -> None:
        self.turns = CommandSequencer()
        self.entries: list[str] = []

    async def command(self, number: int, arrives_s: float = 0.0, takes_s: float = 0.0) -> None:
        await asyncio.sleep(arrives_s)
        try:
            async with self.turns.turn(number):
                self.entries.append(f"{number} begins")
                await asyncio.sleep(takes_s)
                self.entries.append(f"{number} ends")
        except RequestRejectedError as error:
            self.entries.append(f"{number} {error.code}")

    def play(self, *commands: tuple[int, float, float]) -> list[str]:
        async def together() -> None:
            await asyncio.gather(*(self.command(*command) for command in commands))

        run(together())
        return self.entries


def test_a_command_waits_until_its_predecessor_is_answered() -> None:
    entries = CommandLog().play((2, 0.0, 0.0), (3, 0.0, 0.0), (1, 0.05, 0.1))
    assert entries == ["1 begins", "1 ends", "2 begins", "2 ends", "3 begins", "3 ends"]


def test_a_command_waits_GAP_S_for_a_missing_predecessor() -> None:
    entries = CommandLog().play((1, 0.0, 0.0), (3, 0.0, 0.0), (4, 0.0, 0.0), (2, GAP_S + 0.5, 0.0))
    assert entries == ["1 begins", "1 ends", "3 begins", "3 ends", "4 begins", "4 ends", "2 stale_command"]


def test_a_command_waits_BUSY_S_for_an_unanswered_predecessor() -> None:
    entries = CommandLog().play((1, 0.0, BUSY_S + 0.5), (2, 0.0, 0.0))
    assert entries == ["1 begins", "2 begins", "2 ends", "1 ends"]


def test_a_repeated_command_number_is_executed_once() -> None:
    assert sorted(CommandLog().play((1, 0.0, 0.1), (1, 0.0, 0.0), (2, 0.0, 0.0), (2, 0.05, 0.0))) == [
        "1 begins",
        "1 ends",
        "1 stale_command",
        "2 begins",
        "2 ends",
        "2 stale_command",
    ]


def test_a_failed_command_does_not_block_the_next() -> None:
    turns = CommandSequencer()

    async def play() -> None:
        with pytest.raises(ValueError, match="broken"):
            async with turns.turn(1):
                raise ValueError("broken")
        async with asyncio.timeout(GAP_S / 2), turns.turn(2):
            pass

    run(play())


def test_the_number_of_waiting_commands_of_a_page_is_limited() -> None:
    entries = CommandLog().play(*((number, 0.0, 0.0) for number in range(2, WAITING + 4)))
    assert entries.count("34 too_many_commands") == 1
    assert len([note for note in entries if note.endswith("ends")]) == WAITING
