"""Runs the server: hears the live stream of the service on a data folder, and comes back to it when it was away."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from backend.foxglove.door import HOST, Door
from backend.foxglove.publisher import Publisher
from backend.foxglove.tickets import Tickets

AGAIN_S = 1.0
LIVE = "/api/live"
SILENT_S = 10.0
"""The state comes twice a second: a service that says nothing for so long does not answer."""


@dataclass(frozen=True)
class Source:
    """``address`` is where a service answers; ``token`` the viewer's, empty where it asks for none."""

    address: str
    token: str


async def relay(
    look: Callable[[], Source | None], key_of: Callable[[Source], str], port: int, say: Callable[[str], None]
) -> None:
    """Serve until cancelled. ``look`` finds the service, ``key_of`` the key for its address, ``say`` tells the person.

    Raises OSError where ``port`` is taken, OtherVersionError.
    """
    tickets, told, shown = Tickets(), "", ""
    publisher = Publisher("Sinew", tickets)
    door = Door(publisher.port, tickets)
    try:
        async with door.open(port) as open_on:
            while True:
                source = look()
                if source is None:
                    heard, why = False, "no service works on the folder"
                else:
                    key = key_of(source)
                    await door.let_in(key)
                    if key != shown:
                        say(f"Foxglove or Lichtblick, Open connection: ws://{HOST}:{open_on}/?token={key}")
                        shown = key
                    heard, why = await _listen(source, publisher)
                if heard or why != told:  # once, however long it lasts
                    publisher.say_away(f"{why}: nothing new is shown until it answers")
                    say(f"{why}; it is tried again each second")
                    told = why
                await asyncio.sleep(AGAIN_S)
    finally:
        publisher.close()


async def _listen(source: Source, publisher: Publisher) -> tuple[bool, str]:
    """Publish what the service streams until it ends; return whether there was anything, and why it ended."""
    heard = False
    where = urlsplit(source.address)
    headers = {"Authorization": f"Bearer {source.token}"} if source.token else {}
    try:
        async with connect(
            f"ws://{where.netloc}{where.path}{LIVE}",
            additional_headers=headers,
            compression=None,
            max_size=None,
            proxy=None,
        ) as live:
            while True:
                async with asyncio.timeout(SILENT_S):
                    message = await live.recv()
                publisher.hear(message)
                heard = True
    except ConnectionClosed as closed:
        told = closed.rcvd.reason if closed.rcvd is not None else ""
        why = f"the service at {source.address} has ended the stream{f': {told}' if told else ''}"
    except TimeoutError:
        why = f"the service at {source.address} says nothing any more"
    except (OSError, InvalidHandshake) as error:
        why = f"the service at {source.address} does not answer: {error}"
    return heard, why
