"""The binary frame, and the requests that the page stamps."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from backend import wire
from backend.api.export import build_openapi_schema
from backend.sample import FIELDS, NAMES, STORED_NAMES

# The frame, decoded as the page does: from the bytes alone.


def rows_of(count: int) -> np.ndarray:
    """Return rows whose values encode row and column."""
    return np.arange(count)[:, None] * 100.0 + np.arange(len(FIELDS))[None, :]


def test_a_frame_is_a_header_followed_by_the_columns() -> None:
    frame = wire.pack_frame(70_000_000_000, rows_of(3), missed=7)
    assert struct.unpack_from("<QII", frame) == (70_000_000_000, 3, 7)
    assert len(frame) == 16 + 4 * 3 * len(STORED_NAMES)
    for position, name in enumerate(STORED_NAMES):
        column = struct.unpack_from("<3f", frame, 16 + 12 * position)
        assert column == tuple(100.0 * row + NAMES.index(name) for row in range(3))


@given(
    rows=arrays(np.float64, st.tuples(st.integers(0, 5), st.just(len(FIELDS))), elements=st.floats(width=32)),
    first_tick=st.integers(0, 2**63),
    missed=st.integers(0, 2**32 - 1),
)
def test_unpacking_reverses_packing(rows: np.ndarray, first_tick: int, missed: int) -> None:
    frame = wire.unpack_frame(wire.pack_frame(first_tick, rows, missed))
    assert (frame.first_tick, frame.missed) == (first_tick, missed)
    stored = [NAMES.index(name) for name in STORED_NAMES]
    np.testing.assert_array_equal(frame.columns, rows[:, stored].T.astype(np.float32))


def test_replacing_the_missed_count_changes_nothing_else() -> None:
    frame = wire.pack_frame(5, rows_of(2))
    marked = wire.unpack_frame(wire.replace_missed_count(frame, 123))
    assert marked.missed == 123
    np.testing.assert_array_equal(marked.columns, wire.unpack_frame(frame).columns)
    assert wire.read_sample_count(frame) == 2


@pytest.mark.parametrize("change", [lambda frame: frame[:-4], lambda frame: frame + b"\0\0\0\0"])
def test_a_frame_of_the_wrong_length_is_rejected(change: "object") -> None:
    assert callable(change)
    with pytest.raises(ValueError, match="cannot be"):
        wire.unpack_frame(change(wire.pack_frame(0, rows_of(2))))


def test_curves_are_a_header_followed_by_the_columns_of_each_signal() -> None:
    q = [np.array([1.0, 2.0], np.float32), np.array([5.0, np.nan], np.float32)]
    S = [np.array([-1.0, -2.0], np.float32), np.array([0.0, 0.5], np.float32)]
    message = wire.pack_curves(7_200, 0.5, [q, S])
    assert struct.unpack_from("<dQII", message) == (0.5, 7_200, 2, 2)
    np.testing.assert_array_equal(struct.unpack_from("<8f", message, 24), [1.0, 2.0, 5.0, np.nan, -1.0, -2.0, 0.0, 0.5])
    assert len(message) == 24 + 4 * 8


# The page stamps exactly the requests that require the control lease; its list is written by hand.

WIRE = Path(__file__).parents[2] / "frontend" / "src" / "wire"
CONTROL_ITSELF = "/api/control"
"""These routes receive their stamp explicitly in the page's code."""


def test_the_page_stamps_exactly_the_requests_that_need_the_control_lease() -> None:
    declared = re.search(r"const COMMANDS =\s*/(.*)/;", (WIRE / "control.ts").read_text(encoding="utf-8"))
    assert declared is not None
    commands = re.compile(declared[1])
    paths = build_openapi_schema()["paths"]
    needs_stamp = {
        (method, path.replace("{id}", "7")): any(
            one["name"] == "Sinew-Control" for one in operation.get("parameters", ())
        )
        for path, methods in paths.items()
        for method, operation in methods.items()
        if method != "get" and not path.startswith(CONTROL_ITSELF)
    }
    assert sum(needs_stamp.values()) > 10
    assert [request for request, stamped in needs_stamp.items() if stamped != bool(commands.match(request[1]))] == []
