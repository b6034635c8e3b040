"""Raw connections of a misbehaving client."""

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager


def connected(address: tuple[str, int], sent: bytes = b"") -> socket.socket:
    """Return a connection after sending ``sent``."""
    connection = socket.create_connection(address, 30)
    if sent:
        connection.sendall(sent)
    return connection


def everything_from(connection: socket.socket) -> bytes:
    """Return all received bytes until the other end closes."""
    received = bytearray()
    try:
        while piece := connection.recv(65536):
            received += piece
    except ConnectionResetError:
        pass
    return bytes(received)


@contextmanager
def many(address: tuple[str, int], count: int, sent: bytes = b"") -> Iterator[list[socket.socket]]:
    """Open many connections."""
    with ExitStack() as stack:
        yield [stack.enter_context(connected(address, sent)) for _ in range(count)]


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
    """Send ``piece`` repeatedly until the other end refuses it, for one minute at most."""
    begun = time.monotonic()
    while time.monotonic() - begun < 60.0:
        try:
            connection.sendall(piece)
        except OSError:
            break
        time.sleep(pause_s)
    return time.monotonic() - begun
