"""Connections as an impolite client holds them."""

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager


def connected(address: tuple[str, int], said: bytes = b"") -> socket.socket:
    """Return a connection that has said something, or nothing."""
    connection = socket.create_connection(address, 30)
    if said:
        connection.sendall(said)
    return connection


def everything_from(connection: socket.socket) -> bytes:
    """Return what comes until the other end closes."""
    received = bytearray()
    try:
        while piece := connection.recv(65536):
            received += piece
    except ConnectionResetError:
        pass
    return bytes(received)


@contextmanager
def many(address: tuple[str, int], count: int, said: bytes = b"") -> Iterator[list[socket.socket]]:
    """Hold many connections."""
    with ExitStack() as stack:
        yield [stack.enter_context(connected(address, said)) for _ in range(count)]


def is_closed(connection: socket.socket) -> bool:
    """Return whether the other end has closed."""
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except ConnectionResetError:
        return True
    except BlockingIOError:
        return False


def seconds_until_refused(connection: socket.socket, piece: bytes, pause_s: float) -> float:
    """Send ``piece`` again and again until the other end takes no more; a minute at most."""
    begun = time.monotonic()
    while time.monotonic() - begun < 60.0:
        try:
            connection.sendall(piece)
        except OSError:
            break
        time.sleep(pause_s)
    return time.monotonic() - begun
