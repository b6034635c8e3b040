"""The address that the service listens on."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager


class CannotListenError(Exception):
    """The address cannot be listened on."""


@contextmanager
def listening_on(host: str, port: int) -> Iterator[socket.socket]:
    """Hold the socket that is listened on. Raises CannotListenError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family)
    except OSError as error:
        reason = error.strerror or error
        raise CannotListenError(
            f"cannot listen on {host} port {port}: {reason}; choose another --host or --port"
        ) from None
    with listening:
        yield listening
