"""Packing loses nothing, whatever the bits; summaries agree with a plain loop."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from backend.recording.codec import BUCKET_TICKS, CodecError, pack_table, summarize_buckets, unpack
from tests.refusals import refused

TABLES = npst.arrays(np.float32, npst.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=130))


@given(TABLES)
@settings(deadline=None)
def test_unpacking_gives_the_same_bits(table: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> None:
    back = unpack(pack_table(table), table.shape[1])
    assert back.dtype == np.float32
    assert back.shape == table.shape
    assert back.tobytes() == table.tobytes()


def test_special_values_survive() -> None:
    table = np.array([[np.nan, np.inf, -np.inf, -0.0, 1e-45, 16777216.0]], np.float32)
    assert unpack(pack_table(table), 6).tobytes() == table.tobytes()


@given(TABLES)
@settings(deadline=None, max_examples=50)
def test_summaries_cover_exactly_the_finite_values(table: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> None:
    low, high = np.split(summarize_buckets(table), 2)
    assert len(low) == math.ceil(len(table) / BUCKET_TICKS)
    for bucket in range(len(low)):
        part = table[bucket * BUCKET_TICKS : (bucket + 1) * BUCKET_TICKS]
        for column in range(table.shape[1]):
            numbers = [value for value in part[:, column] if not math.isnan(value)]
            if numbers:
                assert (low[bucket, column], high[bucket, column]) == (min(numbers), max(numbers))
            else:
                assert math.isnan(low[bucket, column])
                assert math.isnan(high[bucket, column])


@given(st.binary(max_size=200), st.integers(1, 40))
def test_damaged_bytes_are_rejected(damaged: bytes, columns: int) -> None:
    with pytest.raises(CodecError) as caught:
        unpack(damaged, columns)
    assert caught.value.message.code in ("samples_not_unpacked", "samples_are_no_table")


def test_a_wrong_number_of_columns_is_rejected() -> None:
    with refused(CodecError, "samples_are_no_table", size_bytes=24, columns=5):
        unpack(pack_table(np.zeros((3, 2), np.float32)), 5)
