"""Ring buffer in shared memory: one writer, any number of readers.

The writer never waits; readers detect rows that were overwritten. The memory is anonymous (memfd) and freed with its
last process, however that ends. Layout: a header of 64-bit integers, then ``capacity`` rows of float64, one per tick;
row k is in slot k modulo ``capacity``. A row is written before it is counted, so a counted row is complete (x86-64 and
similar processors keep the order of stores). A header word is read and written in one access.
"""

import mmap
import os
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from backend.realtime import messages
from backend.sample import FIELDS
from plant import InvariantError, SinewError

WIDTH = len(FIELDS)
_HEADER_WORDS = 8
_MAGIC, _CAPACITY, _WIDTH, _COUNT = range(4)
_MAGIC_VALUE = 0x53494E4557  # "SINEW"
_WORD = 8


class RingError(SinewError):
    """The file descriptor does not hold a ring buffer of this version's samples."""


class SampleRing(Protocol):
    """Destination of the loop's samples: one row of len(FIELDS) numbers per tick."""

    def append(self, row: NDArray[np.float64]) -> None:
        """Publish one row."""
        ...


class Ring:
    """The newest ``capacity`` rows of ``WIDTH`` float64 (``backend.sample.FIELDS``).

    ``rows`` (capacity, WIDTH) is the memory itself.
    """

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._memory = mmap.mmap(fd, os.fstat(fd).st_size)
        self._header: NDArray[np.int64] = np.frombuffer(self._memory, np.int64, _HEADER_WORDS)
        self.capacity = int(self._header[_CAPACITY])
        cells = np.frombuffer(self._memory, np.float64, self.capacity * WIDTH, offset=_HEADER_WORDS * _WORD)
        self.rows: NDArray[np.float64] = cells.reshape(self.capacity, WIDTH)
        self._appended = self.count

    @classmethod
    def create(cls, capacity: int = 65536) -> "Ring":
        """Create an empty ring of ``capacity`` rows (65 s at 1 kHz).

        Its ``fd`` can be passed to another process.
        """
        fd = os.memfd_create("sinew-ring")
        os.ftruncate(fd, _size(capacity))
        header = np.zeros(_HEADER_WORDS, np.int64)
        header[[_MAGIC, _CAPACITY, _WIDTH]] = _MAGIC_VALUE, capacity, WIDTH
        os.pwrite(fd, header.tobytes(), 0)
        return cls(fd)

    @classmethod
    def attach(cls, fd: int) -> "Ring":
        """Map the ring of ``fd`` and own the descriptor.

        Raises RingError if it holds no ring, or one of other samples.
        """
        header = np.frombuffer(os.pread(fd, _HEADER_WORDS * _WORD, 0), np.int64)
        if header.size < _HEADER_WORDS or header[_MAGIC] != _MAGIC_VALUE:
            raise RingError(messages.not_a_ring_buffer(fd=fd))
        if header[_WIDTH] != WIDTH or os.fstat(fd).st_size != _size(int(header[_CAPACITY])):
            raise RingError(messages.ring_buffer_of_other_version(width=int(header[_WIDTH]), expected=WIDTH))
        return cls(fd)

    @property
    def count(self) -> int:
        """Number of rows appended so far."""
        return int(self._header[_COUNT])

    def append(self, row: Sequence[float] | NDArray[np.float64]) -> None:
        """Append one row of ``WIDTH`` values over the oldest. For the writer only.

        Raises InvariantError if another process has changed the count. The row is appended and the count corrected
        nevertheless.
        """
        self.rows[self._appended % self.capacity] = row
        self.count_in(1)

    def count_in(self, rows: int) -> None:
        """Count rows that the writer has stored in ``rows``, each in its slot.

        No reader may still need the rows that they overwrite. Raises InvariantError as ``append`` does, and for more
        rows than slots.
        """
        if not 0 <= rows <= self.capacity:
            raise InvariantError(f"{rows} rows at once in a ring buffer of {self.capacity}")
        count, found = self._appended, self.count
        self._appended = self._header[_COUNT] = count + rows
        if found != count:
            raise InvariantError(f"the ring buffer counted {found} rows where {count} had been appended")

    def read(self, since: int, limit: int) -> tuple[int, NDArray[np.float64], int]:
        """Copy rows ``since``, ``since + 1`` ... (at most ``limit``).

        Returns (index of the first row, rows [n, WIDTH], rows missed): rows that were overwritten before they could be
        copied are omitted at the front and counted as missed; the first row then is ``since + missed``. Raises
        InvariantError for a row that was never appended: its reader would wait forever.
        """
        count = self.count
        if not 0 <= since <= count:
            raise InvariantError(f"row {since} of a ring buffer into which {count} rows have been appended")
        first = max(since, count - self.capacity + 1, 0)
        rows = self._copy(first, min(count, first + limit))
        # The writer has continued and may now be writing row `count` into the slot of row `count - capacity`.
        intact = self.count - self.capacity + 1
        if intact > first:
            rows = rows[intact - first :]
            first = intact
        return first, rows, first - since

    def newest(self) -> NDArray[np.float64] | None:
        """Copy the newest row [WIDTH], None before the first."""
        _, rows, _ = self.read(max(self.count - 1, 0), 1)
        return rows[0] if len(rows) else None

    def _copy(self, first: int, end: int) -> NDArray[np.float64]:
        if end <= first:
            return np.empty((0, WIDTH))
        start, stop = first % self.capacity, (end - 1) % self.capacity + 1
        if start < stop:
            return self.rows[start:stop].copy()
        return np.concatenate((self.rows[start:], self.rows[:stop]))

    def close(self) -> None:
        """Unmap the memory and close the descriptor. Safe to call twice."""
        if self.fd >= 0:
            # A mapping cannot be closed while views of it exist.
            del self._header, self.rows
            self._memory.close()
            os.close(self.fd)
            self.fd = -1

    def __del__(self) -> None:
        """Release the memory with the last reader.

        A restarted loop process gets a new ring.
        """
        if hasattr(self, "rows"):
            self.close()


def _size(capacity: int) -> int:
    return (_HEADER_WORDS + capacity * WIDTH) * _WORD
