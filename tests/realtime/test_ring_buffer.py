"""The ring buffer keeps every row until it is overwritten, and counts the rows that a reader missed."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.realtime.ring_buffer import WIDTH, Ring, RingError
from plant.errors import InvariantError
from tests.refusals import refused


def row(k: int) -> list[float]:
    return [float(k)] * WIDTH


@given(
    capacity=st.integers(2, 20),
    steps=st.lists(st.tuples(st.integers(0, 30), st.integers(1, 40)), max_size=12),
)
@settings(max_examples=100, deadline=None)
def test_every_row_is_read_once_or_counted_as_missed(capacity: int, steps: list[tuple[int, int]]) -> None:
    ring = Ring.create(capacity)
    appended = position = 0
    for appends, limit in steps:
        for _ in range(appends):
            ring.append(row(appended))
            appended += 1
        first, rows, missed = ring.read(position, limit)
        assert first == position + missed
        assert rows.shape[1:] == (WIDTH,)
        np.testing.assert_array_equal(rows, np.arange(first, first + len(rows))[:, None].repeat(WIDTH, axis=1))
        kept = min(appended, capacity - 1)
        assert missed == max(0, appended - kept - position)
        assert len(rows) == min(limit, appended - first)
        position = first + len(rows)
    ring.close()


class OvertakenRing(Ring):
    """A ring buffer whose writer appends while the reader copies."""

    appended_meanwhile = 0

    def _copy(self, first: int, end: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        rows = super()._copy(first, end)
        for k in range(self.count, self.count + self.appended_meanwhile):
            self.append(row(k))
        return rows


@pytest.mark.parametrize(("meanwhile", "intact_from"), [(0, 3), (1, 4), (4, 7), (9, 12)])
def test_rows_overtaken_during_the_copy_are_dropped(meanwhile: int, intact_from: int) -> None:
    ring = OvertakenRing.create(8)
    for k in range(10):
        ring.append(row(k))
    ring.appended_meanwhile = meanwhile  # type: ignore[attr-defined]  # create() makes its own class
    first, rows, missed = ring.read(3, 100)
    assert (first, missed) == (intact_from, intact_from - 3)
    assert [values[0] for values in rows] == list(range(intact_from, 10))
    ring.close()


def test_another_process_appends_to_the_same_ring_buffer() -> None:
    ring = Ring.create(100)
    program = (
        "import sys; from backend.realtime.ring_buffer import Ring, WIDTH\n"
        "ring = Ring.attach(int(sys.argv[1]))\n"
        "for k in range(42): ring.append([k] * WIDTH)\n"
    )
    subprocess.run([sys.executable, "-c", program, str(ring.fd)], pass_fds=[ring.fd], check=True, timeout=60)
    assert ring.count == 42
    newest = ring.newest()
    assert newest is not None
    np.testing.assert_array_equal(newest, row(41))
    ring.close()


def test_rows_read_remain_valid_after_the_ring_buffer_is_closed() -> None:
    ring = Ring.create(4)
    assert ring.newest() is None
    ring.append(row(7))
    _, rows, _ = ring.read(0, 10)
    fd = ring.fd
    ring.close()
    ring.close()
    np.testing.assert_array_equal(rows, [row(7)])
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(fd)


def test_a_process_without_standard_input_closes_its_ring_buffer() -> None:
    program = (
        "import os; from backend.realtime.ring_buffer import Ring\n"
        "os.close(0); ring = Ring.create(4); assert ring.fd == 0, ring.fd; ring.close()\n"
        "try: os.fstat(0)\n"
        "except OSError as gone: print(gone.errno == 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout == "True\n"


def test_foreign_memory_is_rejected() -> None:
    fd = os.memfd_create("other")
    os.ftruncate(fd, 4096)
    with refused(RingError, "not_a_ring_buffer", fd=fd):
        Ring.attach(fd)
    os.close(fd)


def test_a_ring_buffer_of_another_version_is_rejected() -> None:
    ring = Ring.create(4)
    ring._header[2] = WIDTH + 1
    with refused(RingError, "ring_buffer_of_other_version", width=WIDTH + 1, expected=WIDTH):
        Ring.attach(ring.fd)
    ring.close()


def test_a_reader_beyond_the_newest_row_raises() -> None:
    ring = Ring.create(8)
    ring.append(row(0))
    for since in (-1, 2, 500):
        with pytest.raises(InvariantError, match=f"row {since} "):
            ring.read(since, 1)
    assert ring.read(1, 5)[0] == 1
    ring.close()


@pytest.mark.parametrize("spoilt", [-1, 0, 2, 10**6])
def test_the_writer_corrects_a_count_changed_by_another_process(spoilt: int) -> None:
    ring = Ring.create(8)
    other = Ring.attach(os.dup(ring.fd))
    for k in range(5):
        ring.append(row(k))
    other._header[3] = spoilt
    with pytest.raises(InvariantError, match=f"counted {spoilt} rows where 5 "):
        ring.append(row(5))
    assert other.count == 6
    assert [int(r[0]) for r in other.read(0, 10)[1]] == [0, 1, 2, 3, 4, 5]
    other._header[3] = spoilt
    with pytest.raises(InvariantError):
        ring.count_in(2)
    assert other.count == 8
    ring.append(row(8))
    with pytest.raises(InvariantError, match="9 rows at once"):
        ring.count_in(9)
    assert ring.count == 9
    other.close()
    ring.close()
