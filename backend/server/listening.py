"""The address that the service listens on, and how the service ends."""

import ipaddress
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn

from plant import ErrorCode, SinewError

# Ending --------------------------------------------------------------------------------------------
#
# How the service is told to end, and by what it was.


KILLED_BY = 128
"""Exit status of what a signal ended, less the number of the signal."""


class Ending:
    """Why the service ends, for those parts that put it on record."""

    cause = "service ended"


class EndingServer(uvicorn.Server):
    """A web server that ends in order by any signal that means so, and leaves in ``ending`` which one it was."""

    def __init__(self, config: uvicorn.Config, ending: Ending) -> None:
        super().__init__(config)
        self._ending = ending

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """End in order on SIGHUP too: a terminal that is closed, or a connection that is cut, sends it.

        Whoever started the service with nohup has it ignored, and that stays. Uvicorn raises the signal once more at
        the end: by default that kills, and what is released at the end of an interpreter would be told as leaked.
        """
        _leave_in_order_by(signal.SIGTERM, signal.SIGHUP)
        with super().capture_signals():
            before = signal.getsignal(signal.SIGHUP)
            if before is signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
                yield
                return
            signal.signal(signal.SIGHUP, self.handle_exit)
            try:
                yield
            finally:
                signal.signal(signal.SIGHUP, before)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end."""
        if not self.should_exit:
            self._ending.cause = f"service ended by {signal.Signals(sig).name}"
        super().handle_exit(sig, frame)


def _leave_in_order_by(*numbers: signal.Signals) -> None:
    """Let signals that would kill this process end its interpreter, with the status that a shell gives for them."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in numbers:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(KILLED_BY + number)


def browser_address(host: str, port: int) -> str:
    """Return where a browser of this machine reaches a service that listens on ``host``."""
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{reached}]:{port}" if ":" in reached else f"http://{reached}:{port}"


# Listening -----------------------------------------------------------------------------------------
#
# The address that the service listens on.


class CannotListenError(SinewError):
    """The address cannot be listened on."""

    category = ErrorCode.UNAVAILABLE


@contextmanager
def listening_socket(host: str, port: int) -> Iterator[socket.socket]:
    """Hold the socket that is listened on. Raises CannotListenError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, dualstack_ipv6=_is_dual_stack(host))
    except OSError as error:
        reason = error.strerror or error
        raise CannotListenError(
            f"cannot listen on {host} port {port}: {reason}; choose another --host or --port"
        ) from None
    with listening:
        yield listening


def describe_served_addresses(host: str) -> str:
    """Return which addresses a service on ``host`` serves, where that is not plain from it; "" elsewhere."""
    if not _is_any(host):
        return ""
    if ":" not in host:
        return "It listens on every IPv4 address of this machine, not over IPv6; --host :: serves both."
    if _is_dual_stack(host):
        return "It listens on every address of this machine, over IPv6 and IPv4."
    return "It listens on every IPv6 address of this machine, not over IPv4: this system cannot serve both."


def _is_dual_stack(host: str) -> bool:
    return ":" in host and _is_any(host) and socket.has_dualstack_ipv6()


def _is_any(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False
