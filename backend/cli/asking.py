"""A person at the terminal: asked in words on standard error, answering with a line."""

import asyncio
import os
import sys
import threading
from contextlib import suppress

from backend.cli.output import angles, errors
from backend.units import in_words

GIVE_UP = "q"


class GivenUpError(Exception):
    """The person does not go on, or there are no answers left."""


class Terminal:
    """Lines from standard input. Belongs to one asyncio event loop.

    They are read by a thread of their own, straight from the descriptor: the wait for a line can be given up then, and
    the thread holds no lock when the program ends.
    """

    def __init__(self) -> None:
        self._answers: asyncio.Queue[str | None] = asyncio.Queue()
        self._typed = sys.stdin.isatty()
        self._ended = False
        threading.Thread(target=self._read, args=(asyncio.get_running_loop(),), daemon=True).start()

    async def confirmed(self, words: str) -> None:
        """Ask for something to be done, and wait until it is confirmed. Raises GivenUpError."""
        await self.answer(f"{words}.", "Enter when done")

    async def answer(self, words: str, how: str) -> str:
        """Ask, and return the line that is typed from now on. Raises GivenUpError."""
        while self._typed and not self._answers.empty():  # an Enter of before confirms nothing, an end stays one
            self._ended = self._answers.get_nowait() is None or self._ended
        say(f"  > {words} [{how}, {GIVE_UP} to give up]")
        answer = None if self._ended else await self._answers.get()
        if answer is None:
            self._ended = True
            raise GivenUpError("no answer: standard input has come to its end")
        if answer.lower() == GIVE_UP:
            raise GivenUpError("given up")
        return answer

    def phase(self, name: str) -> None:
        """Tell what goes on."""
        say(f"    {name} …", style="dim")

    def _read(self, loop: asyncio.AbstractEventLoop) -> None:
        rest = b""
        with suppress(RuntimeError):  # of an event loop that has ended
            with suppress(OSError):  # of a terminal that is gone
                while part := os.read(sys.stdin.fileno(), 4096):
                    *lines, rest = (rest + part).split(b"\n")
                    for line in lines:
                        loop.call_soon_threadsafe(self._answers.put_nowait, line.decode(errors="replace").strip())
            loop.call_soon_threadsafe(self._answers.put_nowait, None)


def say(words: str, style: str = "") -> None:
    """Print on standard error, angles as they are read."""
    errors.print(in_words(words, angles()), style=style, highlight=False, markup=False, soft_wrap=True)
