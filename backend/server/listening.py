"""The address on which the service listens, and its shutdown."""

import ipaddress
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn

from backend.server import messages
from plant import ErrorCode, SinewError

# Shutdown ------------------------------------------------------------------------------------------
# Shutdown of the service, and its cause.


KILLED_BY = 128
"""Exit status of a process ended by a signal, minus the number of the signal."""


class Ending:
    """Cause of the shutdown, for the parts that record it."""

    cause = "service ended"


class EndingServer(uvicorn.Server):
    """Web server that shuts down on signals, and stores the cause in ``ending``."""

    def __init__(self, config: uvicorn.Config, ending: Ending) -> None:
        super().__init__(config)
        self._ending = ending

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Shut down on SIGHUP too: a closed terminal or a lost connection sends it.

        A service started with nohup ignores it, which is preserved. Uvicorn raises the signal again at the end: by
        default that kills the process, and resources released at the interpreter's exit would be reported as leaked.
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
        """Begin the shutdown."""
        if not self.should_exit:
            self._ending.cause = f"service ended by {signal.Signals(sig).name}"
        super().handle_exit(sig, frame)


def _leave_in_order_by(*numbers: signal.Signals) -> None:
    """Let signals that would kill this process exit its interpreter.

    The exit status is the one a shell reports for them.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in numbers:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(KILLED_BY + number)


def browser_address(host: str, port: int) -> str:
    """Return the address for a browser of this machine.

    ``host`` is the one the service listens on.
    """
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{reached}]:{port}" if ":" in reached else f"http://{reached}:{port}"


# Listening -----------------------------------------------------------------------------------------
# The address on which the service listens.


class CannotListenError(SinewError):
    """The service cannot listen on the address."""

    category = ErrorCode.UNAVAILABLE


@contextmanager
def listening_socket(host: str, port: int) -> Iterator[socket.socket]:
    """Open the listening socket for the block. Raises CannotListenError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, dualstack_ipv6=_is_dual_stack(host))
    except OSError as error:
        message = messages.cannot_listen(host=host, port=port, reason=str(error.strerror or error))
        raise CannotListenError(message) from None
    with listening:
        yield listening


def describe_served_addresses(host: str) -> str:
    """Return which addresses a service on ``host`` serves, "" if that is obvious."""
    if not _is_any(host):
        return ""
    if ":" not in host:
        return "The service listens on every IPv4 address of this machine, but not on IPv6; --host :: serves both."
    if _is_dual_stack(host):
        return "The service listens on every IPv6 and IPv4 address of this machine."
    return "The service listens on every IPv6 address of this machine, but not on IPv4: this system cannot serve both."


def _is_dual_stack(host: str) -> bool:
    return ":" in host and _is_any(host) and socket.has_dualstack_ipv6()


def _is_any(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False
