"""The two ends of the channel: packets over a local socket pair, each whole or not at all."""

import select
import socket

from plant import SinewError

MAX_BYTES = 16_384
"""Longest packet: what is decoded within a third of a period."""

_QUEUE_BYTES = 212_992  # what every kernel grants


class ChannelClosedError(SinewError):
    """The other end is gone."""


class Channel:
    """One end of a SOCK_SEQPACKET pair; neither sending nor receiving ever waits."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end
        self._buffer = bytearray(MAX_BYTES)
        self._waiting = select.poll()
        self._waiting.register(end, select.POLLIN)

    def fileno(self) -> int:
        """File descriptor, to wait on for packets."""
        return self._socket.fileno()

    def send(self, packet: bytes) -> bool:
        """Send one packet; False when the other end does not read and its queue is full. Raises ChannelClosedError."""
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return False
        except (BrokenPipeError, ConnectionResetError) as error:
            raise ChannelClosedError from error
        return True

    def receive(self) -> bytes | None:
        """Take the next packet, None when there is none. Raises ChannelClosedError at the end of all packets."""
        if not self._waiting.poll(0):  # as in nearly every tick: an exception would take longer
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
        """Close this end; the other one notices."""
        self._socket.close()


def channel_pair() -> tuple[Channel, socket.socket]:
    """Return this side's channel and the socket to hand to the other process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    # The longest program has to find room as a whole; the kernel grants twice its usual limit.
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _QUEUE_BYTES)
    return Channel(ours), theirs
