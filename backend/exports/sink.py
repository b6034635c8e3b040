"""A file that is handed on in pieces while it is written."""

import io
from typing import Any


class Sink(io.BufferedIOBase):
    """What a library writes into; ``taken`` returns what has come since it was last asked."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._written = 0

    def writable(self) -> bool:
        """Say that it is."""
        return True

    def write(self, data: Any, /) -> int:
        """Keep a piece."""
        piece = bytes(data)
        self._pieces.append(piece)
        self._written += len(piece)
        return len(piece)

    def tell(self) -> int:
        """Return how much was written in all [bytes]."""
        return self._written

    def taken(self) -> bytes:
        """Return what came since, and keep it no longer."""
        pieces, self._pieces = self._pieces, []
        return b"".join(pieces)
