"""Takes connections off the listening socket, and hands over those that say something.

A connection that says nothing costs a descriptor and nothing else. asyncio's own way of accepting takes a whole backlog
at a time and, without descriptors left, tries again a thousand times a second, with a traceback in the log for each.
"""

import asyncio
import errno
import logging
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from backend.web_server.places import Place, Places

BACKLOG = 512
"""Connections that the kernel keeps until they are taken: a flood of them is through in some tens of milliseconds."""

SILENCE_S = 10.0
"""So long a connection may say nothing."""

TURN_S = 0.005
"""So long [s] connections are taken before others have their turn."""

FIRST_BYTES = 16 * 1024

PAUSE_S = 0.05
"""Pause [s] after the kernel has refused to give a connection."""

_OUT_OF_RESOURCES = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}
_log = logging.getLogger(__name__)


class Listener:
    """Accepts on one listening socket until closed. ``protocol`` makes the protocol of a connection.

    ``highest`` is the largest descriptor for a new connection: those above are for the rest of the service.
    """

    def __init__(
        self, listening: socket.socket, places: Places, protocol: Callable[[Place], asyncio.Protocol], highest: int
    ) -> None:
        self.places = places
        self.protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._listening = listening
        self._highest = highest
        self._retry: asyncio.TimerHandle | None = None
        listening.setblocking(False)
        listening.listen(BACKLOG)
        self._accept_from_now_on()

    def close(self) -> None:
        """Accept nothing more. The listening socket stays open."""
        self._loop.remove_reader(self._listening)
        if self._retry is not None:
            self._retry.cancel()

    def _accept_from_now_on(self) -> None:
        self._retry = None
        self._loop.add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        until = self._loop.time() + TURN_S
        for _ in range(self.places.room.guests // 2):
            if self._loop.time() > until:
                return
            try:
                connection, address = self._listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._accept_later(error)
                return
            if connection.fileno() > self._highest and not self.places.make_room():
                _log.warning("a connection was refused: no descriptors left for it")
                connection.close()
                continue
            _Newcomer(self, connection, str(address[0]))

    def _accept_later(self, error: OSError) -> None:
        """Leave the connections in the kernel for a moment."""
        _log.error("cannot accept connections at present: %s", error)
        if error.errno in _OUT_OF_RESOURCES:
            self.places.make_room()
        self._loop.remove_reader(self._listening)
        self._retry = self._loop.call_later(PAUSE_S, self._accept_from_now_on)


class _Newcomer:
    """A connection until its first words are handed over, or its end."""

    def __init__(self, listener: Listener, connection: socket.socket, address: str) -> None:
        self._listener = listener
        self._connection = connection
        self._loop = asyncio.get_running_loop()
        self._handover: asyncio.Task[None] | None = None
        self._sent_away = False
        connection.setblocking(False)
        with suppress(
            OSError
        ):  # gone already; an answer in two parts would else wait 40 ms for the first one's receipt
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._place = Place(address, self._end)
        listener.places.enter(self._place)
        self._patience = self._loop.call_later(SILENCE_S, self._end)
        # Under a crowd it has waited in the kernel, and its words with it: each turn of the event loop counts then.
        self._listen()
        if self._handover is None and not self._sent_away:
            self._loop.add_reader(connection, self._listen)

    def _listen(self) -> None:
        try:
            words = self._connection.recv(FIRST_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            words = b""
        if not words:
            self._end()
            return
        self._patience.cancel()
        self._loop.remove_reader(self._connection)
        self._place.first_words = words
        self._place.is_answered = lambda: True  # gives way last: its words are not read yet
        self._handover = self._loop.create_task(self._hand_over())

    async def _hand_over(self) -> None:
        """Give the connection to a protocol, which takes over ``place.end``."""
        try:
            factory = partial(self._listener.protocol, self._place)
            transport, _ = await self._loop.connect_accepted_socket(factory, self._connection)
        except OSError:
            self._listener.places.leave(self._place)
            return
        except Exception:
            _log.exception("a connection could not be handed over")
            self._listener.places.leave(self._place)
            self._connection.close()
            return
        if self._sent_away:
            transport.abort()

    def _end(self) -> None:
        self._listener.places.leave(self._place)
        self._sent_away = True
        if self._handover is None:
            self._patience.cancel()
            self._loop.remove_reader(self._connection)
            self._connection.close()
