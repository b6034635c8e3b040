"""Packet channel between two processes over a local socket pair."""

import select
import socket

from plant import SinewError

MAX_BYTES = 16_384
"""Longest packet [bytes]: decoded within a third of a period."""

_QUEUE_BYTES = 212_992  # granted by every kernel


class ChannelClosedError(SinewError):
    """The other end is closed."""


class Channel:
    """One end of a SOCK_SEQPACKET pair, non-blocking in both directions."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end
        self._buffer = bytearray(MAX_BYTES)
        self._waiting = select.poll()
        self._waiting.register(end, select.POLLIN)

    def fileno(self) -> int:
        """Return the file descriptor, to wait for packets."""
        return self._socket.fileno()

    def send(self, packet: bytes) -> bool:
        """Send one packet. Raises ChannelClosedError.

        Returns False if the queue of the other end is full.
        """
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return False
        except (BrokenPipeError, ConnectionResetError) as error:
            raise ChannelClosedError from error
        return True

    def receive(self) -> bytes | None:
        """Return the next packet, or None if there is none.

        Raises ChannelClosedError after the last packet.
        """
        if not self._waiting.poll(0):  # the usual case; an exception would take longer
            return None
        try:
            length = self._socket.recv_into(self._buffer)
        except BlockingIOError:
            return None
        except ConnectionResetError as error:
            raise ChannelClosedError from error
        if length == 0:
            raise ChannelClosedError
        return bytes(memoryview(self._buffer)[:length])

    def close(self) -> None:
        """Close this end; the other one detects it."""
        self._socket.close()


def channel_pair() -> tuple[Channel, socket.socket]:
    """Return this side's channel and the socket for the other process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    # The queue must hold the longest program; the kernel grants twice its usual limit.
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _QUEUE_BYTES)
    return Channel(ours), theirs
