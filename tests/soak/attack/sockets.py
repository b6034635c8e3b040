"""Sockets that occupy connections without use: idle ones, and request bodies of one byte per second."""

import errno
import selectors
import socket
import time

from tests.soak.attack.crowd import Signals, many_descriptors

OPENED_AT_ONCE = 20
"""Connections begun between two looks at the others, until the crowd is there: with LOOK_S a rate of 1000/s at most."""

OPENED_AGAIN = 4
"""The same after that, in place of those that the service has closed: 200/s at most. More would be a flood."""

LOOK_S = 0.02
GATHERED_S = 15.0
"""A crowd is there when all its sockets are open, or after so long [s] at the latest: the door may refuse some."""

DRIP_S = 1.0
BODY = 100_000


class _Sockets:
    """Open sockets; closed ones are reopened at a bounded rate."""

    def __init__(self, signals: Signals, address: tuple[str, int], count: int, addresses: int) -> None:
        self._signals = signals
        self._address = address
        self._count = count
        self._addresses = addresses
        self._selector = selectors.DefaultSelector()

    def hold(self) -> None:
        many_descriptors()
        begun = dripped = time.monotonic()
        while not self._signals.over.is_set():
            self._fill_up()
            # Polling reports closed sockets immediately, so the pause bounds the rate of reopening.
            time.sleep(LOOK_S)
            for key, _ in self._selector.select(0.0):
                assert isinstance(key.fileobj, socket.socket)
                self._heard(key.fileobj)
            now = time.monotonic()
            if now - dripped > DRIP_S:
                dripped = now
                held = [key.fileobj for key in list(self._selector.get_map().values())]
                self.drip([one for one in held if isinstance(one, socket.socket)])
            if self._signals.now.value >= self._count or now - begun > GATHERED_S:
                self._signals.there.set()

    def greet(self, connected: socket.socket) -> None:
        """Send initial data; idle sockets send nothing."""

    def drip(self, connected: list[socket.socket]) -> None:
        """Send data every second."""

    def _fill_up(self) -> None:
        most = OPENED_AGAIN if self._signals.there.is_set() else OPENED_AT_ONCE
        for _ in range(min(most, self._count - self._signals.now.value)):
            opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            opened.setblocking(False)
            number = self._signals.ever.value % self._addresses
            opened.bind((f"127.0.{1 + number // 250}.{1 + number % 250}", 0))
            if opened.connect_ex(self._address) not in (0, errno.EINPROGRESS):
                opened.close()
                self._signals.failed.value += 1
                return
            self._selector.register(opened, selectors.EVENT_READ)
            self._signals.now.value += 1
            self._signals.ever.value += 1
            self.greet(opened)

    def _heard(self, opened: socket.socket) -> None:
        try:
            over = not opened.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            over = True
        if over:
            self._selector.unregister(opened)
            opened.close()
            self._signals.now.value -= 1


class _SlowBodies(_Sockets):
    """Announces a body and sends one byte per second; every second socket sends a slow header."""

    def greet(self, connected: socket.socket) -> None:
        head = "POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        slow_header = self._signals.ever.value % 2
        said = head if slow_header else f"{head}Content-Length: {BODY}\r\n\r\n"
        try:
            connected.settimeout(0.2)
            connected.send(said.encode())
        except OSError:
            return  # refused; the next poll detects it
        finally:
            connected.setblocking(False)

    def drip(self, connected: list[socket.socket]) -> None:
        for one in connected:
            try:
                one.send(b"x")
            except OSError:
                continue


def idle(signals: Signals, address: tuple[str, int], count: int, addresses: int) -> None:
    """Hold ``count`` idle connections from several loopback addresses."""
    _Sockets(signals, address, count, addresses).hold()


def slow_bodies(signals: Signals, address: tuple[str, int], count: int, addresses: int) -> None:
    """Hold ``count`` requests that never end."""
    _SlowBodies(signals, address, count, addresses).hold()
