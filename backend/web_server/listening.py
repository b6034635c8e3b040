"""The address that the service listens on."""

import ipaddress
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
        listening = socket.create_server((host, port), family=family, dualstack_ipv6=_serves_both(host))
    except OSError as error:
        reason = error.strerror or error
        raise CannotListenError(
            f"cannot listen on {host} port {port}: {reason}; choose another --host or --port"
        ) from None
    with listening:
        yield listening


def served_by(host: str) -> str:
    """Return which addresses a service on ``host`` serves, where that is not plain from it; "" elsewhere."""
    if not _is_any(host):
        return ""
    if ":" not in host:
        return "It listens on every IPv4 address of this machine, not over IPv6; --host :: serves both."
    if _serves_both(host):
        return "It listens on every address of this machine, over IPv6 and IPv4."
    return "It listens on every IPv6 address of this machine, not over IPv4: this system cannot serve both."


def _serves_both(host: str) -> bool:
    return ":" in host and _is_any(host) and socket.has_dualstack_ipv6()


def _is_any(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False
