"""What the vendor's server is given in place of a message: a number, which only this process can turn into the message.

That server listens on a port that asks nobody for a token. Whoever finds it hears numbers.
"""

import struct

_TICKET = struct.Struct("<Q")
_HEAD = struct.Struct("<BIQ")
"""Of a frame with a message: what it is, the subscription, the time [ns]."""

MESSAGE = 1
"""First byte of a frame with a message (Foxglove WebSocket protocol, Message Data)."""

KEPT = 8192
"""So many messages are kept: more than any queue on the way holds."""


class Tickets:
    """The newest messages by their numbers."""

    def __init__(self, kept: int = KEPT) -> None:
        self._kept: list[tuple[int, bytes]] = [(-1, b"")] * kept
        self._next = 0

    def ticket_for(self, message: bytes) -> bytes:
        """Keep a message; return what goes in its place."""
        number, self._next = self._next, self._next + 1
        self._kept[number % len(self._kept)] = (number, message)
        return _TICKET.pack(number)

    def redeemed(self, frame: bytes) -> bytes | None:
        """Return a frame of the vendor's server with the message in it; None where that is not kept any more."""
        if frame[:1] != bytes([MESSAGE]):
            return frame
        if len(frame) != _HEAD.size + _TICKET.size:
            return None
        (number,) = _TICKET.unpack_from(frame, _HEAD.size)
        kept, message = self._kept[number % len(self._kept)]
        return frame[: _HEAD.size] + message if kept == number else None
